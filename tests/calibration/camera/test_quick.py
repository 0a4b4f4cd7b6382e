"""Start values of cameras: positions laid on true ones, against motions that are known."""

import math

import numpy as np
import pytest

from host.calibration.camera.quick import aligned_with, calibrate
from host.calibration.gathered import Gathered
from host.config import RobotConfig
from host.errors import UserError
from host.messages import Bearings, Bodies, FloatArray


class Driving:
    """One teammate drives ahead, to and fro; another stands.

    Not along a circle at one speed: there a delay looks like another mounting.
    """

    noise_m = 0.0

    def positions(self, times: FloatArray, shift_s: float = 0.0) -> FloatArray:
        at = times + shift_s
        moving = np.column_stack((1.3 + 0.6 * np.cos(0.5 * at), 0.8 * np.sin(0.8 * at)))
        standing = np.tile([-0.5, 1.4], (len(times), 1))
        return np.stack((moving, standing), axis=1)


def seen(
    heading: float, shift: tuple[float, float], late_s: float, wrong: float, seed: int
) -> tuple[FloatArray, FloatArray]:
    """What a camera makes of the moving one that is believed in another place than it is."""
    random = np.random.default_rng(seed)
    times = np.sort(random.uniform(0.0, 30.0, 200))
    true = Driving().positions(times - late_s)[:, 0]
    c, s = math.cos(-heading), math.sin(-heading)
    believed = (true - shift) @ np.array([[c, -s], [s, c]]).T
    believed += random.normal(0.0, 0.02, believed.shape)
    outliers = random.uniform(size=len(times)) < wrong
    believed[outliers] = random.uniform(-2.0, 2.0, (int(outliers.sum()), 2))
    return times, believed


@pytest.mark.parametrize("seed", range(5))
def test_heading_place_and_delay_are_found_though_two_fifths_are_wrong(seed: int) -> None:
    found = aligned_with(*seen(0.12, (0.03, -0.02), 0.15, 0.4, seed), Driving())
    assert found is not None
    assert found.delay_s == pytest.approx(0.15)
    assert found.motion.heading == pytest.approx(0.12, abs=0.02), seed
    assert (found.motion.x, found.motion.y) == pytest.approx((0.03, -0.02), abs=0.03)
    assert 0.4 < found.used < 0.8


def test_a_camera_that_saw_nobody_is_an_error_in_words() -> None:
    gathered = Gathered(RobotConfig())
    body = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    for k in range(50):
        gathered.take(Bodies(0.1 * k, np.array([gathered.config.mocap.body, 99]), body))
        gathered.take(Bearings(0.1 * k, np.zeros(0), np.zeros(0), camera="front"))
    with pytest.raises(UserError, match="cannot be aligned"):
        calibrate(gathered)


def test_what_was_found_is_written_for_the_camera_that_saw_it() -> None:
    gathered = Gathered(RobotConfig())
    times, believed = seen(0.1, (0.0, 0.0), 0.1, 0.0, 1)
    frames = np.arange(0.0, 30.0, 0.05)
    numbers = np.array([gathered.config.mocap.body, 99])
    for time, place in zip(frames, Driving().positions(frames)[:, 0], strict=True):
        gathered.take(Bodies(time, numbers, np.array([[0.0, 0.0, 0.0], [*place, 0.0]])))
    for time, (x, y) in zip(times, believed, strict=True):
        bearing, distance = np.array([math.atan2(y, x)]), np.array([math.hypot(x, y)])
        ones = np.array([1e-3])
        gathered.take(
            Bearings(time, bearing, ones, ranges=distance, range_variances=ones, camera="front")
        )
    calibration = calibrate(gathered)
    settings = calibration.new_settings()
    assert calibration.failures == []
    assert settings["camera.front.heading_rad"] == pytest.approx(0.1, abs=0.02)
    assert settings["camera.delay_s"] == pytest.approx(RobotConfig().camera.delay_s + 0.1, abs=0.06)
    assert not any("rear" in key for key in settings)
