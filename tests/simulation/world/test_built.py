"""A robot that is not as its configuration says: what the host knows, and what is true."""

import math

import numpy as np
import pytest

from host.config import RobotConfig
from host.geometry import Path, to_frame
from host.messages import Bodies, Displacement, Message, Scan, Truth
from host.simulation.offline import Simulation
from host.simulation.world.built import built, known
from host.simulation.world.motion_capture import pivots_of
from host.simulation.world.scenarios import parse_scenario

CONFIG = RobotConfig()


def run(text: str, config: RobotConfig = CONFIG) -> tuple[Simulation, list[Message]]:
    simulation = Simulation(parse_scenario(text), config)
    return simulation, list(simulation.messages())


def test_the_host_knows_the_delays_of_a_robot_that_is_as_it_says() -> None:
    scenario = parse_scenario("arena4:lidar_delay_s=0.08,camera_delay_s=0.2")
    for config in (built(CONFIG, scenario), known(CONFIG, scenario)):
        assert (config.lidar.delay_s, config.camera.delay_s) == (0.08, 0.2)
        assert config.wheels == CONFIG.wheels


def test_of_a_misbuilt_robot_it_knows_its_configuration_only() -> None:
    scenario = parse_scenario("misbuilt4")
    true = built(CONFIG, scenario)
    assert known(CONFIG, scenario) == CONFIG
    assert true.wheels.left_radius_m == pytest.approx(1.02 * CONFIG.wheels.left_radius_m)
    assert true.wheels.track_m == pytest.approx(1.05 * CONFIG.wheels.track_m)
    assert math.degrees(true.lidar.heading_rad) == pytest.approx(3.0)
    assert true.camera.delay_s - CONFIG.camera.delay_s == pytest.approx(0.15)
    assert built(true, scenario) == true  # whatever the host has learnt


def test_delays_that_are_known_leave_no_trace_in_the_times() -> None:
    """The same turns, stamped the same, though their bytes come later."""
    _, plain = run("arena4:seconds=3,seed=2")
    _, late = run("arena4:seconds=3,seed=2,lidar_delay_s=0.08,camera_delay_s=0.3")
    scans, others = ([m for m in run if isinstance(m, Scan)] for run in (plain, late))
    assert len(others) >= 15
    for scan, other in zip(scans, others, strict=False):
        assert other.time == pytest.approx(scan.time, abs=1e-3)
        assert np.array_equal(other.ranges, scan.ranges)


def test_delays_that_are_not_known_make_a_scan_look_late() -> None:
    _, plain = run("arena4:seconds=3,seed=2,misbuilt=0.001,posts=0")
    _, late = run("arena4:seconds=3,seed=2,misbuilt=0.001,posts=0,lidar_delay_s=0.08")
    scans, others = ([m for m in run if isinstance(m, Scan)] for run in (plain, late))
    shifts = [b.time - a.time for a, b in zip(scans, others, strict=False)]
    assert np.allclose(shifts, 0.08, atol=1e-3)


def test_odometry_of_wrong_wheels_strays_and_that_of_the_true_ones_does_not() -> None:
    ends = []
    text = "arena4:seconds=20,seed=2,misbuilt=1,wheel_slip=0,mocap_hz=50,mocap_noise_mm=0"
    for config in (CONFIG, built(CONFIG, parse_scenario(text))):
        simulation, messages = run(text, config)
        path = Path(keep_seconds=math.inf)
        for message in messages:
            if isinstance(message, Displacement):
                path.append(message)
        first, last = simulation.arena.poses(np.array([0.0, path.end]))[:, 0]
        true = to_frame(last[None, :2], first)[0]
        ends.append(float(np.hypot(*(path.poses(np.array([path.end]))[0, :2] - true))))
    assert ends[0] > 0.3
    assert ends[1] < 0.03


def test_motion_capture_sees_every_body_where_it_lies_on_its_robot() -> None:
    simulation, messages = run("arena4:seconds=2,misbuilt=1,mocap_hz=100,mocap_noise_mm=0")
    frames = [m for m in messages if isinstance(m, Bodies)]
    truths = {m.time: m for m in messages if isinstance(m, Truth)}
    assert len(frames) == 201
    mocap = simulation.built.mocap
    for frame in frames[::20]:
        assert list(frame.identities) == [1, 2, 3, 4]
        (poses,) = simulation.arena.poses(np.array([frame.time]))
        c, s = np.cos(poses[0, 2]), np.sin(poses[0, 2])
        place = poses[0, :2] + np.array([[c, -s], [s, c]]) @ [mocap.x_m, mocap.y_m]
        assert frame.poses[0, :2] == pytest.approx(place)
        assert frame.poses[1:, :2] == pytest.approx(poses[1:, :2])
        assert frame.poses[:, 2] == pytest.approx(
            poses[:, 2] + [mocap.heading_rad, 0, 0, 0], abs=0.01
        )
        truth = truths.get(round(frame.time, 1))
        if truth is not None:
            seen = to_frame(frame.poses[1:, :2], poses[0])
            assert seen == pytest.approx(truth.positions, abs=1e-6)


def test_a_pivot_beside_its_turret_stays_there_on_the_robot_and_shifts_no_other_random_number() -> (
    None
):
    text = "arena4:seconds=1,seed=3,misbuilt=1,mocap_hz=50"
    straight = [m for m in run(text)[1] if isinstance(m, Bodies)]
    beside = [m for m in run(f"{text},pivot_m=0.02")[1] if isinstance(m, Bodies)]
    pivots = pivots_of(parse_scenario(f"{text},pivot_m=0.02"), 0)
    assert np.hypot(*pivots.T) == pytest.approx([0.0, 0.02, 0.02, 0.02])
    assert len({tuple(pivot) for pivot in pivots.tolist()}) == 4
    for one, other in zip(straight, beside, strict=True):
        assert np.array_equal(one.poses[:, 2], other.poses[:, 2])
        c, s = np.cos(one.poses[:, 2]), np.sin(one.poses[:, 2])
        # The heading has noise of 0.1 deg, of which 20 mm make 0.03 mm.
        moved = np.stack((c * pivots[:, 0] - s * pivots[:, 1], s * pivots[:, 0] + c * pivots[:, 1]))
        assert other.poses[:, :2] - one.poses[:, :2] == pytest.approx(moved.T, abs=2e-4)
