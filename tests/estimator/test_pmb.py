"""The Poisson multi-Bernoulli filter: one target against an IMM, and what holds for every scene."""

import copy
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.config import Cameras, FilterSettings, Lidar, PmbSettings
from host.estimator.gaussians.moving_gaussians import COVARIANCE, ENTRY
from host.estimator.motion_modes import MotionModes, MovingTeammates
from host.estimator.pmb import PmbFilter
from host.estimator.things import thing_modes
from host.estimator.things.thing_modes import PARKED
from host.geometry import to_frame, to_parent
from host.messages import Displacement, Positions
from tests.estimator.standing_robot import PLAIN_VIEW, heard, seen, standing
from tests.estimator.test_phd_scenes import as_bytes, by_place, drive, near_estimates, walkers

SEEDS = st.integers(0, 2**32 - 1)
RATE_HZ = 7.0
LAG_S = 0.05


class Run:
    """The filter on a robot that stands still, and its clock."""

    def __init__(self, pmb: PmbSettings | None = None, lidar: Lidar | None = None) -> None:
        self.filter = PmbFilter(FilterSettings(pmb=pmb or PmbSettings()), lidar)
        self.time = 0.0

    def scan(self, points, interval=1.0 / RATE_HZ, **how):
        self.time += interval
        self.filter.predict(standing(self.time, interval))
        self.filter.update(seen(self.time, points, **how))
        return self.filter.estimate()

    def image(self, bearings, interval=0.0, **how):
        self.time += interval
        self.filter.predict(standing(self.time, interval))
        self.filter.update(heard(self.time, bearings, **how))
        return self.filter.estimate()


class Swerving(MovingTeammates):
    """Standing, moving, cruising; what goes over from cruising to moving changes its velocity."""

    def _mix(self, switching):
        swerved = self._shares[:, 2] * switching[2, 1] / (self._shares @ switching)[:, 1]
        super()._mix(switching)
        renewed = self._modes.speed_mps**2 * np.eye(2)
        self._covariances[:, 1, 2:, 2:] += swerved[:, None, None] * renewed


def path(seed, scans=40):
    """Places of a robot that stands, drives at 0.3 m/s and turns."""
    random, place, heading = np.random.default_rng(seed), np.array([1.0, -0.5]), 2.0
    for k in range(scans):
        heading += random.normal(0.0, 0.1)
        speed = 0.3 if k > 10 else 0.0
        place = place + speed / RATE_HZ * np.array([math.cos(heading), math.sin(heading)])
        yield place


@given(SEEDS)
@settings(max_examples=10, deadline=None)
def test_one_target_is_followed_as_an_interacting_multiple_model_does(seed):
    """Always seen, alone and a teammate: then all that is left is the IMM over a teammate's modes.

    The oracle is another implementation, one matrix at a time. It has a Gaussian a mode; in the
    filter parked robots share that of standing ones, so there are none.
    """
    rates, shares = thing_modes._RATES.copy(), thing_modes._AT_BIRTH.copy()
    rates[:, PARKED] = rates[PARKED] = shares[0] = 0.0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(thing_modes, "_RATES", rates)
        patch.setattr(thing_modes, "_AT_BIRTH", shares / shares.sum())
        follow_as_an_imm(seed)


def follow_as_an_imm(seed):
    everything = Lidar(
        detection_probability=0.98,
        half_range_m=999.0,
        min_range_m=0.0,
        blind_sectors=(),
        clutter_per_m2=1e-9,
    )
    run = Run(PmbSettings(obstacle_share=0.0, appear_per_m2_s=1e-3), everything)
    random = np.random.default_rng(seed)
    rates = thing_modes._RATES[PARKED + 1 :, PARKED + 1 :]
    imm = Swerving(
        MotionModes(
            accelerations=thing_modes._NOISE,
            correlations_s=(0.0, *thing_modes._TIMES[1:]),
            rates=tuple(map(tuple, rates)),
            shares=tuple(thing_modes._AT_BIRTH[1:]),
            speed_mps=0.2,
            drift=0.0,
        )
    )
    noise = (0.01**2 + 0.001**2) * np.eye(2)  # with the floor that the filter adds
    for k, place in enumerate(path(seed)):
        reading = place + random.normal(0.0, 0.01, 2)
        run.scan(reading, lags=np.array([LAG_S]))
        imm.predict(standing(run.time, 1.0 / RATE_HZ))
        if k == 0:
            imm.begin(reading, noise, LAG_S)
            continue
        then, jacobian = imm.positions_before(0, LAG_S)
        imm.update(0, reading - then, jacobian, noise)
        positions, covariances = imm.moments()
        ours = run.filter.estimate()
        assert ours.positions[0] == pytest.approx(positions[0], abs=1e-4)
        assert ours.covariances[0] == pytest.approx(covariances[0], rel=0.02, abs=1e-6)


def test_what_was_seen_once_and_never_again_fades():
    run = Run()
    for _ in range(8):
        run.scan([[1.0, 0.3]], clearance=PLAIN_VIEW)
    for _ in range(30):
        run.scan(np.zeros((0, 2)), clearance=PLAIN_VIEW)
    assert run.filter._things.weights.shape[1] == 0


def test_what_drove_and_stands_stays_a_teammate_and_a_post_becomes_none():
    run = Run()
    for k in range(20):
        run.scan([[1.0 - 0.03 * k, 0.3], [0.5, -1.0]])
    for _ in range(400):  # nearly a minute
        estimate = run.scan([[0.43, 0.3], [0.5, -1.0]])
    assert estimate.positions == pytest.approx(np.array([[0.43, 0.3]]), abs=0.01)
    assert estimate.weights[0] > 0.9


@pytest.mark.parametrize("cameras", [True, False], ids=["LC", "LO"])
def test_walking_teammates_are_followed_by_lasting_labels(cameras):
    run, known, wrong, count, labels = Run(), 0, 0, 0, set()
    for _, truth, readings, bearings in walkers(5):
        estimate = run.scan(readings)
        if cameras:
            estimate = run.image(bearings)
        if run.time > 2.0:
            count += len(truth)
            known += np.count_nonzero(near_estimates(truth, estimate) < 0.1)
            wrong += max(0, len(estimate.positions) - len(truth))
            labels |= set(estimate.labels.tolist())
    assert known / count > 0.95
    assert wrong / count < 0.05
    assert len(labels) <= 4


def test_a_strip_makes_a_standing_thing_a_teammate_and_its_absence_an_obstacle():
    run = Run()
    for _ in range(40):
        run.scan([[1.0, 0.3], [0.5, -1.0]])
        estimate = run.image([math.atan2(0.3, 1.0)])
    assert estimate.positions == pytest.approx(np.array([[1.0, 0.3]]), abs=0.01)


@pytest.mark.parametrize("repeated", ["at once", "in a row"])
def test_the_same_picture_again_says_nothing_new(repeated):
    """Six times each picture, of one instant or within the time to the next one."""
    shares = []
    for times in (1, 6):
        run = Run()
        for _ in range(20):
            run.scan([[1.0, 0.3], [0.5, -1.0]], interval=0.04)
            for again in range(times):
                at_once = 0.1 if again == 0 else 0.0
                wait = 0.1 / times if repeated == "in a row" else at_once
                run.image([math.atan2(0.3, 1.0)], interval=wait)
        weights = run.filter._things.weights
        weights = weights[:, weights.sum(axis=0) > 0.5]
        shares.append(weights[thing_modes.OBSTACLE] / weights.sum(axis=0))
    odds = np.log(np.array(shares) / (1.0 - np.array(shares)))
    assert odds[0] == pytest.approx(odds[1], abs=1.5 if repeated == "in a row" else 0.4)


def test_labels_are_unique_in_a_run_and_count_up():
    run, given_out = Run(), []
    for k in range(200):
        centre = np.array([1.0, 0.0]) if (k // 40) % 2 == 0 else np.array([-1.0, 0.5])
        angle = 0.1 * k
        estimate = run.scan(centre + 0.3 * np.array([math.cos(angle), math.sin(angle)]))
        given_out += [label for label in estimate.labels.tolist() if label not in given_out]
    assert given_out == sorted(given_out)
    assert min(given_out) == 1


def test_nothing_is_born_of_nothing():
    run = Run()
    assert len(run.scan(np.zeros((0, 2))).positions) == 0
    assert len(run.image(np.zeros(0)).positions) == 0
    assert len(run.image([0.5]).positions) == 0


@given(SEEDS, st.integers(-180, 180), st.booleans())
@settings(max_examples=10, deadline=None)
def test_a_scene_that_is_rotated_or_mirrored_gives_the_estimates_rotated_or_mirrored(
    seed, degrees, mirrored
):
    events = list(walkers(seed, seconds=3.0))
    plain, _ = drive(PmbFilter(lidar=Lidar(blind_sectors=())), events)
    rotated, axes = drive(
        PmbFilter(lidar=Lidar(blind_sectors=())), events, math.radians(degrees), mirrored
    )
    expected = plain.positions @ axes.T
    one, two = by_place(expected), by_place(rotated.positions)
    assert rotated.positions[two] == pytest.approx(expected[one], abs=1e-6)
    assert rotated.covariances[two] == pytest.approx(
        (axes @ plain.covariances @ axes.T)[one], abs=1e-8
    )
    assert rotated.weights[two] == pytest.approx(plain.weights[one], abs=1e-6)


@given(SEEDS)
@settings(max_examples=10, deadline=None)
def test_the_order_of_the_readings_in_a_message_does_not_matter(seed):
    events = list(walkers(seed, seconds=3.0))
    plain, _ = drive(PmbFilter(), events)
    shuffled, _ = drive(PmbFilter(), events, shuffle=np.random.default_rng(seed))
    one, two = by_place(plain.positions), by_place(shuffled.positions)
    assert shuffled.positions[two] == pytest.approx(plain.positions[one], abs=1e-7)
    assert shuffled.weights[two] == pytest.approx(plain.weights[one], abs=1e-7)


def test_the_same_scene_gives_the_same_bits_and_a_copy_goes_its_own_way():
    events = list(walkers(4))
    original = PmbFilter()
    drive(original, events[:40])
    before = original.estimate()
    bits = as_bytes(before)
    duplicate = copy.deepcopy(original)
    one, _ = drive(duplicate, events[40:])
    assert as_bytes(original.estimate()) == bits
    two, _ = drive(original, events[40:])
    assert as_bytes(one) == as_bytes(two)
    assert as_bytes(before) == bits


@given(SEEDS, st.booleans())
@settings(max_examples=15, deadline=None)
def test_whatever_comes_probabilities_and_covariances_are_sound(seed, ranges):
    random = np.random.default_rng(seed)
    filter_, time = PmbFilter(camera=Cameras(use_ranges=ranges)), 0.0
    for _ in range(60):
        interval = random.choice([0.0, 0.01, 0.1, 2.0])
        time += interval
        filter_.predict(Displacement(time, interval, *random.normal(0.0, 0.1, 3), 1e-4, 1e-3))
        if random.random() < 0.5:
            points = random.uniform(-2, 2, (random.integers(0, 6), 2)).repeat(2, axis=0)
            clearance = random.choice([0.0, 0.5, 1.0, math.inf], 360)
            noise = np.tile(random.choice([1e-4, 0.01, 0.5]) ** 2 * np.eye(2), (len(points), 1, 1))
            known, scored = random.random(2) < 0.5
            filter_.update(
                Positions(
                    time,
                    points,
                    noise,
                    lags=random.uniform(0.0, 0.3, len(points)),
                    clearance=clearance if known else None,
                    scores=random.normal(0.0, 4.0, len(points)) if scored else None,
                )
            )
        else:
            bearings = random.uniform(-math.pi, math.pi, random.integers(0, 5))
            filter_.update(heard(time, bearings, lag=random.uniform(0.0, 0.3)))
        weights = filter_._things.weights
        assert np.all((weights >= 0.0) & (weights.sum(axis=0) <= 1.0 + 1e-9))
        matrices = np.moveaxis(filter_._things.rows[COVARIANCE][ENTRY], (0, 1), (-2, -1))
        assert np.all(np.isfinite(filter_._things.rows))
        assert np.linalg.eigvalsh(matrices).min(initial=0.0) > -1e-9
        estimate = filter_.estimate()
        assert estimate.time == time
        assert np.all(np.linalg.eigvalsh(estimate.covariances) > 0.0)
        assert np.all((estimate.weights > 0.5) & (estimate.weights <= 1.0 + 1e-9))
        assert np.all(estimate.ages >= 0.0)
        assert len(set(estimate.labels.tolist())) == len(estimate.labels)
        assert np.all(estimate.labels > 0)


def test_an_obstacle_is_reported_as_such_and_known_again_after_a_tour():
    """A post that is out of the lidar's reach for most of a drive along a circle."""
    run = Run(lidar=Lidar(blind_sectors=()))
    post, pose = np.array([[0.6, 0.8]]), np.zeros(3)
    for _ in range(30):
        estimate = run.scan(post)
        run.image([])
    assert len(estimate.positions) == 0
    assert estimate.obstacles == pytest.approx(post, abs=0.01)
    for _ in range(200):
        turn = math.tau / 200
        step = Displacement(run.time, 1 / RATE_HZ, 3.0 * turn, 0.0, turn, 1e-6, 1e-6)
        pose[:2] = to_parent(np.array([[step.dx, step.dy]]), pose)[0]
        pose[2] += step.dpsi
        run.filter.predict(step)
        run.time += step.interval
        there = to_frame(post, pose)
        near = np.linalg.norm(there) < 2.4  # before its reach ends
        estimate = run.scan(there if near else np.zeros((0, 2)), interval=0.0)
        assert len(estimate.positions) == 0
        errors = np.linalg.norm(estimate.obstacles - there, axis=1)
        assert len(errors) == 1
        assert errors[0] < 0.2
        # Nothing is there twice, neither while it is seen nor when it is found again.
        assert run.filter._things.weights.sum() < 1.1
    assert estimate.obstacle_covariances[0].trace() < 0.01
