"""The offline simulation: decoded bytes tell the truth, in order, and the same way every time."""

import itertools
import math
import pickle
from dataclasses import astuple, replace
from typing import TypeVar

import numpy as np
import pytest

from host.config import RobotConfig
from host.drivers.x4.commands import SCAN
from host.geometry import Path, to_frame
from host.messages import Bearings, DeviceBytes, Displacement, Message, Scan, Truth
from host.simulation.offline import Simulation
from host.simulation.world.arena import Arena
from host.simulation.world.scenarios import parse_scenario
from host.simulation.world.sensors import SimulatedEncoders

CONFIG = RobotConfig()
Kind = TypeVar("Kind")
CLEAN = "range_noise=0,dropout_share=0,dark_wall_share=0,grazing_deg=90,edge_mrad=0"


def run(text: str) -> list[Message]:
    return list(Simulation(parse_scenario(text), CONFIG).messages())


@pytest.fixture(scope="module")
def messages() -> list[Message]:
    return run("arena4:seconds=12,seed=3")


def of_kind(messages: list[Message], kind: type[Kind]) -> list[Kind]:
    return [message for message in messages if isinstance(message, kind)]


def test_every_sensor_reports_at_its_rate(messages: list[Message]) -> None:
    counts = {kind: len(of_kind(messages, kind)) for kind in (Scan, Displacement, Bearings, Truth)}
    assert counts[Scan] == pytest.approx(12 * 7, abs=3)
    assert counts[Displacement] == pytest.approx(12 * 50, abs=15)
    assert counts[Bearings] == 119  # the last one or two are still under way
    assert counts[Truth] == 121
    bytes_too = len(of_kind(messages, DeviceBytes))
    assert sum(counts.values()) + bytes_too == len(messages)
    for kind in (Scan, Displacement, Bearings, Truth):
        times = [message.time for message in of_kind(messages, kind)]
        assert all(a < b for a, b in itertools.pairwise(times))


def test_messages_come_in_order_of_arrival(messages: list[Message]) -> None:
    arrivals = [m.time + (0.15 if isinstance(m, Bearings) else 0.0) for m in messages]
    # A scan or a displacement arrives when its bytes have: some milliseconds after its time.
    late = np.maximum.accumulate(arrivals) - arrivals
    assert late.max() < 0.03
    bearings = [k for k, m in enumerate(messages) if isinstance(m, Bearings)]
    assert max(late[bearings]) < 1e-9


def test_truth_is_the_others_in_the_frame_of_robot_0(messages: list[Message]) -> None:
    arena = Arena(parse_scenario("arena4:seed=3"))
    for truth in of_kind(messages, Truth)[::20]:
        (poses,) = arena.poses(np.array([truth.time]))
        assert list(truth.identities) == [1, 2, 3]
        c, s = math.cos(poses[0, 2]), math.sin(poses[0, 2])
        expected = (poses[1:, :2] - poses[0, :2]) @ np.array([[c, -s], [s, c]])
        assert truth.positions == pytest.approx(expected)
    simulation = Simulation(parse_scenario("arena4:seed=3"), CONFIG)
    assert simulation.truth(of_kind(messages, Truth)[-1].time).positions == pytest.approx(
        of_kind(messages, Truth)[-1].positions
    )


def test_decoded_scans_show_each_visible_turret_where_it_truly_is() -> None:
    """From the arena through beams, bytes, decoder and sample clock back to the true place."""
    scenario = parse_scenario(f"arena4:seconds=8,seed=5,interference_deg=0,{CLEAN}")
    simulation = Simulation(scenario, CONFIG)
    arena = Arena(scenario)
    errors, seen = [], 0
    for scan in of_kind(list(simulation.messages()), Scan)[2:]:
        points = scan.ranges[:, None] * np.stack((np.cos(scan.angles), np.sin(scan.angles)), 1)
        poses = arena.poses(scan.times)
        for robot in range(1, arena.count):
            expected = to_frame(poses[:, robot, :2], poses[:, 0])  # at each sample's own time
            surface = np.linalg.norm(points - expected, axis=1)
            on_turret = (scan.ranges > 0) & (surface < 0.06)
            errors.extend(surface[on_turret] - 0.0325)
            seen += on_turret.sum() > 0
    assert seen > 60
    # Ranges are whole millimetres; offline, bytes arrive when they should, so times are exact.
    assert np.median(np.abs(errors)) < 0.5e-3
    assert np.quantile(np.abs(errors), 0.95) < 1.5e-3


def test_displacements_add_up_to_the_true_motion() -> None:
    steps = of_kind(run("arena4:seconds=10,seed=4,wheel_slip=0"), Displacement)
    path = Path(keep_seconds=100.0)
    for step in steps:
        path.append(step)
    start = steps[0].time - steps[0].interval
    arena = Arena(parse_scenario("arena4:seed=4"))
    (first, last) = arena.poses(np.array([start, steps[-1].time]))[:, 0]
    moved = path.between(start, steps[-1].time)
    assert moved.dpsi == pytest.approx(last[2] - first[2], abs=0.01)
    assert (moved.dx, moved.dy) == pytest.approx(tuple(to_frame(last[:2], first)), abs=0.02)


def test_the_same_scenario_gives_the_same_messages_bit_by_bit(messages: list[Message]) -> None:
    again = run("arena4:seconds=12,seed=3")
    assert len(again) == len(messages)
    for one, other in zip(messages, again, strict=True):
        assert type(one) is type(other)
        for a, b in zip(astuple(one), astuple(other), strict=True):
            assert np.array_equal(a, b)


def test_a_longer_run_begins_as_a_shorter_one(messages: list[Message]) -> None:
    shorter = of_kind(run("arena4:seconds=5.03,seed=3"), Scan)
    for one, other in zip(shorter, of_kind(messages, Scan), strict=False):
        assert np.array_equal(one.ranges, other.ranges)
        assert one.times == pytest.approx(other.times)


def test_one_sensors_noise_leaves_the_others_alone(messages: list[Message]) -> None:
    scenario = replace(
        parse_scenario("arena4:seconds=3,seed=3"), bearing_noise_deg=1.0, wheel_slip=0.1
    )
    other = list(Simulation(scenario, CONFIG).messages())
    for one, two in zip(of_kind(messages, Scan), of_kind(other, Scan), strict=False):
        assert np.array_equal(one.ranges, two.ranges)


def test_identities_name_the_robots_that_were_measured(messages: list[Message]) -> None:
    simulation = Simulation(parse_scenario("arena4:seed=3"), CONFIG)
    off = []
    for frame in of_kind(messages, Bearings):
        truth = simulation.truth(frame.time)
        for bearing, identity in zip(frame.bearings, frame.identities, strict=True):
            if identity >= 0:
                x, y = truth.positions[list(truth.identities).index(identity)]
                off.append(np.angle(np.exp(1j * (bearing - math.atan2(y, x)))))
    assert len(off) > 150
    assert np.std(off) == pytest.approx(math.radians(5.0), rel=0.2)


def test_what_is_forgotten_changes_nothing_that_comes_after_it() -> None:
    kept, forgetful = (Simulation(parse_scenario("arena4:seed=3"), CONFIG) for _ in range(2))
    for simulation in (kept, forgetful):
        simulation.lidar.receive(SCAN, 0.0)
    for now in np.arange(1.0, 41.0):
        assert forgetful.board.transmit(now) == kept.board.transmit(now)
        assert forgetful.lidar.transmit(now) == kept.lidar.transmit(now)
        for time in (now - 2.9, now):
            one, other = (simulation.truth(time) for simulation in (kept, forgetful))
            assert np.array_equal(one.positions, other.positions)
        forgetful.forget(now - 3.0)
    assert np.array_equal(kept.truth(40.0).positions, forgetful.truth(40.0).positions)
    assert not np.array_equal(kept.truth(1.0).positions, forgetful.truth(1.0).positions)


def test_who_forgets_does_not_grow() -> None:
    """The size is that of all that a lone robot's encoders and arena remember, pickled."""
    scenario = parse_scenario("arena4:robots=1,posts=0,speed_mps=0")
    arena = Arena(scenario)
    encoders = SimulatedEncoders(arena, 0, scenario, CONFIG.wheels)
    sizes = []
    for now in np.arange(1.0, 121.0):
        encoders.ticks(now)
        encoders.forget(now - 20.0)
        arena.forget(now - 20.0)
        sizes.append(len(pickle.dumps(encoders)))
    assert max(sizes[80:]) <= 1.1 * max(sizes[40:80])
