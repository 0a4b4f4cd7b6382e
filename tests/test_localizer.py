"""The localizer: order, patience, late readings, and the thread from messages to teammates."""

import dataclasses
import itertools
import math
from collections.abc import Iterable
from typing import TypeGuard

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.config import RobotConfig
from host.estimator.profiles import filter_entry, make
from host.localizer import Localizer
from host.messages import (
    Bearings,
    Displacement,
    Estimate,
    Measurement,
    Message,
    Positions,
    Scan,
    Truth,
)
from host.simulation.offline import Simulation
from host.simulation.world.scenarios import parse_scenario
from tests.malformed import malformed
from tests.perception.scene import Array, Drive, Scene, take_turn

CONFIG = RobotConfig()
DRIVE = Drive(0.35, 1.4)
LANDMARKS = np.array([[1.5, 0.4], [-0.6, 1.0], [0.2, -2.0]])


class Notes:
    """A filter that writes down what it is given."""

    def __init__(self) -> None:
        self.time = 0.0
        self.motions: list[Displacement] = []
        self.measured: list[Positions | Bearings] = []

    def predict(self, motion: Displacement) -> None:
        self.motions.append(motion)
        self.time = motion.time

    def update(self, measurement: Positions | Bearings) -> None:
        self.measured.append(measurement)
        assert measurement.time == self.time

    def estimate(self) -> Estimate:
        none = np.zeros(0)
        return Estimate(
            self.time, np.zeros((0, 2)), np.zeros((0, 2, 2)), none, none, np.zeros(0, dtype=int)
        )


def localizer() -> tuple[Localizer, Notes]:
    notes = Notes()
    return Localizer(CONFIG, notes), notes


def handle_each(
    localizer: Localizer, messages: Iterable[Measurement | Displacement]
) -> list[Estimate]:
    return [estimate for message in messages for estimate in localizer.handle(message)]


def handle_all(localizer: Localizer, messages: Iterable[Measurement | Displacement]) -> int:
    return len(handle_each(localizer, messages))


def positions_at(time: float) -> Positions:
    """The landmarks, as a perfect sensor sees them at `time`."""
    heading = DRIVE.turn_rate * time
    c, s = math.cos(heading), math.sin(heading)
    # 5 cm along the world's x axis, 1 cm along its y axis, turned into the robot frame.
    turned = np.array([[c, s], [-s, c]]) @ np.diag([0.05**2, 0.01**2]) @ np.array([[c, -s], [s, c]])
    return Positions(time, DRIVE.to_robot(LANDMARKS, time), np.tile(turned, (3, 1, 1)))


def bearings_at(time: float, origin: tuple[float, float] = (0.0, 0.0)) -> Bearings:
    x, y = (DRIVE.to_robot(LANDMARKS, time) - origin).T
    return Bearings(time, np.arctan2(y, x), np.full(3, 0.01), origin, identities=np.arange(3))


def empty(time: float) -> Positions:
    return Positions(time, np.zeros((0, 2)), np.zeros((0, 2, 2)))


def standing(end: float) -> list[Displacement]:
    return Drive().displacements(end)


def test_measurements_are_used_in_the_order_of_their_times() -> None:
    ours, notes = localizer()
    times = [0.31, 0.22, 0.4, 0.25, 0.4, 0.28]
    messages = [Positions(t, np.full((1, 2), k), np.eye(2)[None]) for k, t in enumerate(times)]
    assert handle_all(ours, messages) == 0
    assert handle_all(ours, [Displacement(0.5, 0.5, 0.0, 0.0, 0.0)]) == 6
    assert [m.time for m in notes.measured] == sorted(times)
    used = [m.positions[0, 0] for m in notes.measured if isinstance(m, Positions)]
    assert used == [1, 3, 5, 0, 2, 4]  # of two at one time, the first to come
    assert ours.dropped == 0


@given(
    order=st.permutations(range(12)),
    gaps=st.lists(st.floats(0.0, 0.016), min_size=12, max_size=12),
)
def test_any_order_within_the_patience_gives_the_same(order: list[int], gaps: list[float]) -> None:
    times = np.cumsum(gaps) + 1.0
    ours, notes = localizer()
    assert handle_all(ours, [empty(float(times[k])) for k in order]) == 0
    assert len(ours.finish()) == 12
    assert [m.time for m in notes.measured] == times.tolist()


def test_a_measurement_waits_for_its_odometry_but_not_for_ever() -> None:
    ours, notes = localizer()
    assert handle_all(ours, DRIVE.displacements(0.98)) == 0
    assert ours.handle(positions_at(1.0)) == []
    assert ours.handle(bearings_at(1.1)) == []
    (last,) = [d for d in DRIVE.displacements(1.02) if d.time > 1.0]
    missing = [d for d in DRIVE.displacements(1.0) if d.time > 0.98]
    assert handle_all(ours, [*missing[:1], last]) == 1
    assert [m.time for m in notes.measured] == [1.0]
    assert ours.handle(empty(1.29)) == []
    assert len(ours.handle(empty(1.31))) == 1  # odometry that is 0.2 s late is waited for no more
    assert [m.time for m in notes.measured] == [1.0, 1.1]


def test_nothing_waits_for_odometry_that_has_ended() -> None:
    ours, notes = localizer()
    handle_all(ours, DRIVE.displacements(1.0))
    assert ours.handle(positions_at(1.45)) == []  # it could still come
    assert len(ours.handle(positions_at(1.55))) == 2
    assert len(ours.handle(positions_at(1.6))) == 1
    assert len(ours.handle(bearings_at(1.5))) == 1  # late, as pictures are
    assert len(notes.measured) == 4


def test_the_filter_is_told_the_motion_between_measurements() -> None:
    ours, notes = localizer()
    times = [0.11, 0.25, 0.25, 0.6, 0.93]
    odometry = [
        dataclasses.replace(d, translation_variance=2e-6, heading_variance=3e-6)
        for d in DRIVE.displacements(1.0)
    ]
    messages = sorted([*map(positions_at, times), *odometry], key=lambda m: m.time)
    handle_all(ours, messages)
    used = sorted(set(times))
    assert [m.time for m in notes.motions] == used
    assert notes.motions[0].interval == 0.0
    for motion, (before, now) in zip(notes.motions[1:], itertools.pairwise(used), strict=True):
        # The new pose in the old frame is where the old frame sees it: an arc's closed form.
        (old, new) = DRIVE.pose(np.array([before, now]))
        assert (motion.dx, motion.dy) == pytest.approx(
            DRIVE.to_robot(new[None, :2], before)[0].tolist(), abs=1e-4
        )
        assert motion.dpsi == pytest.approx(new[2] - old[2], abs=1e-9)
        assert motion.interval == pytest.approx(now - before)
        assert motion.translation_variance == pytest.approx((now - before) / 0.02 * 2e-6)
        assert motion.heading_variance == pytest.approx((now - before) / 0.02 * 3e-6)


@pytest.mark.parametrize("late", [0.02, 0.15, 0.6])
def test_late_readings_are_carried_into_the_present(late: float) -> None:
    ours, notes = localizer()
    now = 1.5
    camera = (0.08, -0.03)
    handle_all(ours, DRIVE.displacements(now))
    ours.handle(dataclasses.replace(positions_at(now), clearance=np.ones(360)))
    assert handle_all(ours, [positions_at(now - late), bearings_at(now - late, camera)]) == 2
    present, positions, bearings = notes.measured
    assert isinstance(present, Positions)
    assert isinstance(positions, Positions)
    assert isinstance(bearings, Bearings)
    assert present.clearance is not None  # nothing is done to one that comes in time
    assert present.lags is None
    assert positions.time == bearings.time == now

    assert positions.positions == pytest.approx(DRIVE.to_robot(LANDMARKS, now), abs=2e-4)
    assert positions.covariances == pytest.approx(positions_at(now).covariances, abs=1e-6)
    assert positions.lags == pytest.approx([late] * 3)
    assert positions.clearance is None  # what the lidar saw then is not what is free now

    # Each ray still starts where the camera was, and still passes through its landmark.
    ox, oy, turned = DRIVE.pose(np.array([now - late]))[0]
    lens = ox + 1j * oy + complex(*camera) * np.exp(1j * turned)
    then = DRIVE.to_robot(np.array([[lens.real, lens.imag]]), now)[0]
    assert bearings.origin == pytest.approx(then.tolist(), abs=2e-4)
    x, y = (DRIVE.to_robot(LANDMARKS, now) - bearings.origin).T
    ahead = np.exp(1j * (bearings.bearings - np.arctan2(y, x)))
    assert np.angle(ahead) == pytest.approx([0.0] * 3, abs=3e-4)
    # What was in the middle of the picture still is.
    middle = np.exp(1j * (bearings.view[0] + DRIVE.pose(np.array([now]))[0][2] - turned))
    assert np.angle(middle) == pytest.approx(0.0, abs=3e-4)
    assert bearings.lag == pytest.approx(late)
    assert bearings.identities is not None
    assert bearings.identities.tolist() == [0, 1, 2]


def test_a_late_reading_does_not_turn_the_filter_back() -> None:
    ours, notes = localizer()
    handle_all(ours, [*DRIVE.displacements(2.0), positions_at(1.9), positions_at(1.5)])
    handle_all(ours, [positions_at(1.95)])
    assert [m.time for m in notes.measured] == [1.9, 1.9, 1.95]
    assert [m.time for m in notes.motions] == [1.9, 1.95]


def test_what_comes_more_than_a_second_late_is_dropped_and_counted() -> None:
    ours, notes = localizer()
    handle_all(ours, [*standing(3.0), empty(3.0)])
    assert handle_all(ours, [empty(1.9), bearings_at(1.99), empty(2.1)]) == 1
    assert ours.dropped == 2
    assert len(notes.measured) == 2


def test_a_scan_becomes_positions_of_turrets() -> None:
    place = (1.2, -0.5)
    scan = take_turn(Scene([(*place, 0.0325)]), DRIVE, start=0.8)
    ours, notes = localizer()
    handle_all(ours, [*DRIVE.displacements(1.0), scan])
    (found,) = notes.measured
    assert isinstance(found, Positions)
    assert found.positions == pytest.approx(DRIVE.to_robot(np.array([place]), scan.time), abs=0.004)
    assert found.clearance is not None


def test_without_any_odometry_a_standing_robot_sees_its_teammates() -> None:
    places = np.array([[1.2, -0.5], [-0.8, 0.1]])
    scene = Scene([(x, y, 0.0325) for x, y in places])
    ours = Localizer(CONFIG, make("phd", CONFIG))
    estimates: list[Estimate] = []
    for k in range(30):
        seen = Bearings(k / 7.0 + 0.05, np.arctan2(places[:, 1], places[:, 0]), np.full(2, 0.008))
        estimates += handle_each(ours, [seen, take_turn(scene, start=k / 7.0)])
    estimates += ours.finish()
    times = [k / 7.0 + lag for k in range(30) for lag in (0.05, 0.1426)]
    assert [e.time for e in estimates] == pytest.approx(times)
    assert len(estimates[-1].positions) == 2
    for place in places:
        assert np.hypot(*(estimates[-1].positions - place).T).min() < 0.02


def test_odometry_alone_gives_no_estimate() -> None:
    ours, notes = localizer()
    assert handle_all(ours, standing(1.0)) == 0
    assert ours.finish() == []
    assert notes.motions == []


@pytest.fixture(scope="module")
def simulated() -> list[Message]:
    return list(Simulation(parse_scenario("arena4:seconds=20,seed=4"), CONFIG).messages())


def drives_or_measures(message: Message) -> TypeGuard[Measurement | Displacement]:
    return isinstance(message, Scan | Bearings | Positions | Displacement)


def test_the_filter_finds_the_teammates_of_a_simulated_world(simulated: list[Message]) -> None:
    """Every scan after 8 s: how far each teammate in reach is from its nearest estimate."""
    ours = Localizer(CONFIG, make("phd", CONFIG))
    estimates: list[Estimate] = []
    for message in simulated:
        if drives_or_measures(message):
            estimates += ours.handle(message)
    assert ours.dropped == 0
    truths = {round(m.time, 6): m for m in simulated if isinstance(m, Truth) and m.time > 8.0}
    at = np.array([e.time for e in estimates])
    errors: list[float] = []
    surplus: list[int] = []
    for time, truth in truths.items():
        # Truth and bearings come at the same 10 Hz, so some estimate is of the same moment.
        k = int(np.argmin(np.abs(at - time)))
        if abs(at[k] - time) > 0.02:
            continue
        places = estimates[k].positions
        reach = np.hypot(*truth.positions.T) < 2.3
        for teammate in truth.positions[reach]:
            errors.append(float(np.hypot(*(places - teammate).T).min(initial=9.0)))
        surplus.append(max(0, len(places) - len(truth.positions)))
    assert len(errors) > 80
    assert np.mean(np.array(errors) < 0.3) > 0.85
    assert np.median(errors) < 0.08
    assert np.mean(surplus) < 0.5


def values(estimates: list[Estimate]) -> list[bytes]:
    fields: list[Array] = []
    for e in estimates:
        fields += [np.array([e.time]), e.positions, e.covariances, e.weights, e.ages, e.labels]
    return [np.ascontiguousarray(f).tobytes() for f in fields]


@pytest.mark.parametrize("profile", ["phd", "perera2021"])
def test_the_same_messages_give_the_same_bits(simulated: list[Message], profile: str) -> None:
    messages = [m for m in simulated if drives_or_measures(m) and m.time < 3.5]
    first = Localizer(CONFIG, make(profile, CONFIG))
    alone = [e for m in messages for e in first.handle(m)] + first.finish()
    # Once more, with another robot's localizer at work in the same process.
    second, other = (Localizer(CONFIG, make(profile, CONFIG)) for _ in range(2))
    again: list[Estimate] = []
    for message in messages:
        again += second.handle(message)
        other.handle(dataclasses.replace(message, time=message.time + 0.05))
        if isinstance(message, Scan):
            other.handle(positions_at(message.time))
    again += second.finish()
    assert len(alone) > 40
    assert sum(len(e.positions) for e in alone) > 30
    assert values(alone) == values(again)


@pytest.mark.parametrize("profile", ["pmb", "phd", "perera2021"])
@given(data=st.data())
@settings(max_examples=15)
def test_malformed_messages_are_dropped_and_change_nothing(
    simulated: list[Message], profile: str, data: st.DataObject
) -> None:
    """Bit for bit: whatever is wrong with them, wherever they come."""
    messages = [m for m in simulated if drives_or_measures(m) and m.time < 1.5]
    undisturbed = Localizer(CONFIG, make(profile, CONFIG))
    expected = handle_each(undisturbed, messages) + undisturbed.finish()
    assert sum(len(e.positions) for e in expected) > 5
    bad = data.draw(st.lists(malformed(0.7), min_size=1, max_size=8))
    places = data.draw(st.lists(st.integers(0, len(messages)), min_size=8, max_size=8))
    disturbed = messages.copy()
    for message, place in zip(bad, places, strict=False):
        disturbed.insert(place, message)
    ours = Localizer(CONFIG, make(profile, CONFIG))
    found = handle_each(ours, disturbed) + ours.finish()
    assert values(found) == values(expected)
    assert (ours.malformed, ours.dropped) == (len(bad), 0)
    assert ours.fault is not None
    assert undisturbed.malformed == 0


def test_one_message_far_ahead_of_its_time_is_dropped_and_a_second_one_is_believed() -> None:
    ours, notes = localizer()
    handle_all(ours, [*standing(2.0), empty(2.0), empty(1e6)])
    assert handle_all(ours, [Displacement(2.1, 0.1, 0.0, 0.0, 0.0), empty(2.1)]) == 1
    assert ours.malformed == 1
    assert ours.fault == "Positions: its time is 999998.0 s ahead of all before it"
    later = [Displacement(t, 0.1, 0.0, 0.0, 0.0) for t in (500.0, 500.1, 500.2)]
    assert handle_all(ours, [*later, empty(500.2)]) > 0  # the computer slept, or devices were out
    assert notes.time == 500.2
    assert ours.malformed == 2


def test_what_a_scan_is_found_to_hold_is_checked_too(monkeypatch: pytest.MonkeyPatch) -> None:
    ours = Localizer(CONFIG, make("phd", CONFIG))
    spoilt = dataclasses.replace(positions_at(1.0), covariances=np.zeros((3, 2, 2)))
    monkeypatch.setattr("host.localizer.turrets.find", lambda *_: spoilt)
    handle_all(ours, standing(2.0))
    assert ours.handle(take_turn(Scene([]), start=0.8)) == []
    assert ours.malformed == 1


def test_a_filter_that_cannot_go_on_says_so() -> None:
    ours = Localizer(CONFIG, filter_entry("clairvoyant").make(CONFIG))
    handle_all(ours, standing(1.0))
    with pytest.raises(ValueError, match="identity"):
        ours.handle(positions_at(0.9))


@given(st.data())
@settings(max_examples=60)
def test_scans_of_any_content_leave_a_localizer_that_works(data: st.DataObject) -> None:
    n = data.draw(st.integers(0, 40))
    numbers = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    reach = data.draw(st.sampled_from([0.0, 0.01, 3.0, 1e4]))
    spread = data.draw(st.sampled_from([0.0, 0.14, 1e3, 1e9]))
    angles = numbers.choice([numbers.uniform(-10.0, 10.0, n), np.linspace(-3.0, 3.0, n)])
    ranges = reach * numbers.random(n) * (numbers.random(n) < data.draw(st.floats(0.0, 1.0)))
    scan = Scan(1.0, 1.0 - spread * numbers.random(n), angles, ranges)
    ours = Localizer(CONFIG, make("phd", CONFIG))
    handle_all(ours, [*standing(2.0), scan])
    assert len(handle_each(ours, [positions_at(1.5)])) == 1
    assert np.all(np.isfinite(ours.handle(positions_at(1.6))[0].positions))


def test_without_measurements_the_filter_goes_with_the_odometry_and_ages() -> None:
    """However long the lidar is away, no part of the robot's way is lost."""
    ours, notes = localizer()
    steps = standing(60.0)[:100]
    steps += [Displacement(2.0 + 0.02 * k, 0.02, 0.006, 0.0, 0.0) for k in range(1, 2901)]
    before = [message for step in steps[:99] for message in (step, empty(step.time))]
    assert handle_all(ours, before) == 99
    alone = handle_each(ours, steps[99:])
    apart = np.diff([1.98, *(estimate.time for estimate in alone), 60.0])
    assert np.all((apart > 0.98) & (apart < 2.1))
    assert len(handle_each(ours, [empty(60.0)])) == 1
    assert notes.time == 60.0
    assert sum(motion.dx for motion in notes.motions) == pytest.approx(0.006 * 2900)
    assert ours.dropped == 0


def test_what_comes_late_after_a_silence_is_used_in_order() -> None:
    ours, notes = localizer()
    handle_all(ours, [empty(0.1), *standing(20.0), empty(19.1), empty(19.9)])
    assert [m.time for m in notes.measured] == [0.1, 19.1, 19.9]
    assert [m.time for m in notes.motions] == sorted(m.time for m in notes.motions)
    assert ours.dropped == 0


def test_whenever_a_silence_ends_what_is_less_than_a_second_late_is_in_order() -> None:
    for end in np.arange(18.0, 20.5, 0.1):
        ours, notes = localizer()
        late = empty(float(end) - 0.9)
        handle_all(ours, [empty(0.1), *standing(float(end)), late])
        assert notes.measured[-1] is late, end  # at its own time: nothing had to be carried
        assert ours.dropped == 0


def test_what_was_old_when_it_came_keeps_its_age() -> None:
    """A picture that was carried once already, and the same with positions."""
    ours, notes = localizer()
    handle_all(ours, [*standing(1.0), empty(1.0)])
    old = dataclasses.replace(positions_at(0.9), lags=np.array([0.0, 0.2, 0.3]))
    handle_all(ours, [dataclasses.replace(bearings_at(0.9), lag=0.25), old])
    _, bearings, positions = notes.measured
    assert isinstance(bearings, Bearings)
    assert isinstance(positions, Positions)
    assert bearings.lag == pytest.approx(0.35)
    assert positions.lags == pytest.approx([0.1, 0.3, 0.4])


def test_a_look_ahead_is_what_the_filter_would_predict_and_changes_nothing() -> None:
    simulation = Simulation(parse_scenario("arena4:seconds=8,seed=5"), CONFIG)
    messages = [m for m in simulation.messages() if isinstance(m, Scan | Bearings | Displacement)]
    config = simulation.config
    looked, undisturbed = (Localizer(config, make("phd", config)) for _ in range(2))
    assert looked.ahead(1.0) is None
    for message in messages:
        made, expected = looked.handle(message), undisturbed.handle(message)
        assert [e.positions.tobytes() for e in made] == [e.positions.tobytes() for e in expected]
        looked.ahead(message.time + 0.3)
    now = looked.ahead(messages[-1].time)
    later = looked.ahead(messages[-1].time + 0.5)
    assert now is not None
    assert later is not None
    assert len(later.positions) <= len(now.positions) > 0
    by_label = dict(zip(now.labels.tolist(), now.ages.tolist(), strict=True))
    for label, age in zip(later.labels.tolist(), later.ages.tolist(), strict=True):
        assert age == pytest.approx(by_label[label] + 0.5)
    assert looked.measured <= messages[-1].time
