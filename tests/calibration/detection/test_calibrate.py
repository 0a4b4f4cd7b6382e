"""Calibration of detection as a whole: what it refuses, and what it asks for while one drives."""

import numpy as np
import pytest

from host.calibration.detection import calibrate as detection
from host.calibration.detection.verdict import detection_advice
from host.calibration.gathered import Gathered
from host.config import Mocap, RobotConfig
from host.errors import UserError
from host.messages import Bearings, Bodies, Scan
from tests.calibration.detection.detection_drive import camera_drive

SMALL = "arena4:seconds=80,seed=4"


def first_seconds(gathered: Gathered, seconds: float) -> Gathered:
    part = Gathered(gathered.config)
    part.bearings = [b for b in gathered.bearings if b.time <= seconds]
    part.bodies = [b for b in gathered.bodies if b.time <= seconds]
    return part


def empty_scan(time: float) -> Scan:
    times = time - np.linspace(0.14, 0.0, 700)
    return Scan(time, times, np.linspace(3.1, -3.1, 700), np.zeros(700))


def body(time: float, *numbers: int) -> Bodies:
    poses = np.array([(float(n), 0.0, 0.0) for n in numbers]).reshape(-1, 3)
    return Bodies(time, np.array(numbers, dtype=np.int64), poses)


def refusal(gathered: Gathered) -> str:
    with pytest.raises(UserError) as caught:
        detection.calibrate(gathered)
    assert caught.value.next_step
    return str(caught.value)


def test_without_motion_capture_nothing_is_fitted() -> None:
    gathered = Gathered(RobotConfig())
    gathered.take(empty_scan(1.0))
    assert "motion capture" in refusal(gathered)


def test_without_teammates_nothing_is_fitted() -> None:
    gathered = Gathered(RobotConfig())
    gathered.take(empty_scan(1.0))
    gathered.take(body(1.0, 1))
    assert "no teammate" in refusal(gathered)


def test_without_scans_and_pictures_nothing_is_fitted() -> None:
    gathered = Gathered(RobotConfig())
    gathered.take(body(1.0, 1, 2))
    assert "nothing to fit detection to" in refusal(gathered)


@pytest.mark.parametrize("sensor", ["lidar", "camera"])
def test_a_sensor_that_ran_at_another_time_is_told(sensor: str) -> None:
    gathered = Gathered(RobotConfig())
    for k in range(20):
        gathered.take(body(0.05 * k, 1, 2))
    if sensor == "lidar":
        gathered.take(empty_scan(100.0))
    else:
        gathered.take(Bearings(100.0, np.zeros(0), np.zeros(0)))
    assert "compared with motion capture" in refusal(gathered)


def test_a_lidar_without_a_single_return_is_fitted_to_failure_not_to_an_error() -> None:
    gathered = Gathered(RobotConfig())
    for k in range(200):
        gathered.take(body(0.05 * k, 1, 2))
    for k in range(1, 60):
        gathered.take(empty_scan(0.15 * k))
    fit = detection.calibrate(gathered)
    assert fit.failures
    assert "lidar.clutter_per_m2" not in fit.new_settings()


def test_a_short_drive_fails_with_advice() -> None:
    fit = detection.calibrate(first_seconds(camera_drive(SMALL), 6.0))
    assert any("drive" in failure for failure in fit.failures)


def test_a_teammate_that_is_not_tracked_for_long_is_no_miss() -> None:
    """One body in three is lost half of the time: what was seen of it then is no clutter."""
    whole = camera_drive(SMALL)
    torn = Gathered(whole.config)
    torn.bearings = whole.bearings
    for frame in whole.bodies:
        kept = (frame.identities != 3) | (frame.time % 20.0 < 10.0)
        torn.take(Bodies(frame.time, frame.identities[kept], frame.poses[kept]))
    keys = "camera.detection_probability", "camera.clutter_per_rad"
    found, expected = (detection.calibrate(g).new_settings() for g in (torn, whole))
    assert found[keys[0]] == pytest.approx(expected[keys[0]], abs=0.03)
    assert found[keys[1]] == pytest.approx(expected[keys[1]], rel=0.4)


def test_advice_says_what_is_missing_and_ends_when_it_is_there() -> None:
    gathered = Gathered(RobotConfig())
    assert detection_advice(gathered) == ["no motion capture yet"]
    whole = camera_drive(SMALL)
    early = detection_advice(first_seconds(whole, 2.0))
    assert any("s so far" in line for line in early)
    assert detection_advice(whole) == []


def test_advice_names_what_a_standing_robot_has_not_seen() -> None:
    gathered = Gathered(RobotConfig())
    gathered.take(empty_scan(1.0))
    for k in range(4000):
        gathered.take(body(0.02 * k, 1, 2))
    asked = " / ".join(detection_advice(gathered))
    assert "rotate all around: 1 of 8" in asked
    assert "further from teammates than 1.5 m: 1.0 m so far" in asked
    assert "let a teammate be seen ahead on the left" in asked


def test_advice_before_this_robot_is_seen_names_its_body() -> None:
    gathered = Gathered(RobotConfig(mocap=Mocap(body=7)))
    gathered.take(empty_scan(1.0))
    gathered.take(body(1.0, 1, 2))
    with pytest.raises(UserError, match="body 7"):
        detection_advice(gathered)
