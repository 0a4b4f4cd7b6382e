"""Clocks brought together by the wheels: made-up drives of known offset, and recorded ones."""

import math

import numpy as np
import pytest

from host.calibration.truth.alignment import align_clocks
from host.errors import UserError
from host.recording.elsewhere.named_columns import BodyPath

OFFSET_S, DRIFT, STEP_S = 31.7, 4e-4, 0.01


def path_of(speeds, rates):
    """Poses every 10 ms of a robot that drives so, summed up in small straight steps."""
    heading = np.cumsum(rates) * STEP_S
    x, y = (np.cumsum(speeds * side(heading)) * STEP_S for side in (np.cos, np.sin))
    return np.column_stack((x, y, heading))


def wandering(random, seconds=60.0):
    pieces = math.ceil(seconds / 2.0)
    speeds = np.repeat(random.uniform(0.0, 0.35, pieces), 200)
    rates = np.repeat(random.permutation(np.resize([0.0, 1.0, -1.0, 0.6, -1.4], pieces)), 200)
    smooth = np.ones(40) / 40.0
    return (np.convolve(each, smooth, "same") for each in (speeds, rates))


def both(random, poses, offset=OFFSET_S, drift=DRIFT):
    """The body's path by the tracker's clock and, with slip of 1 % that lasts, by the robot's."""
    times = np.arange(len(poses)) * STEP_S
    middle = times.mean()
    slip = 1.0 + 0.01 * np.repeat(random.standard_normal(len(poses) // 50 + 1), 50)[: len(poses)]
    steps = np.diff(poses, axis=0, prepend=poses[:1])
    way, turned = np.hypot(*steps[:, :2].T) * slip, steps[:, 2] * slip
    by_wheels = path_of(way / STEP_S / 1.03, turned / STEP_S / 0.97)
    body = poses[:, :2] + 0.05 * np.column_stack((np.cos(poses[:, 2]), np.sin(poses[:, 2])))
    seen = np.column_stack((body, poses[:, 2])) + random.normal(
        0.0, (3e-4, 3e-4, 2e-3), (len(poses), 3)
    )
    host = times + offset + drift * (times - middle)
    return BodyPath("r", times, seen), BodyPath("", host[::2], by_wheels[::2])


def test_the_offset_is_found_with_an_honest_sigma():
    wrong = []
    for seed in range(20):
        random = np.random.default_rng(seed)
        path, wheels = both(random, path_of(*wandering(random, 40.0)))
        found = align_clocks(path, wheels)
        (true,) = np.interp([found.middle], path.times[::2], wheels.times) - found.middle
        wrong.append((found.offset - true) / found.sigma)
        assert found.sigma < 0.006, seed
        assert found.drift == pytest.approx(DRIFT, abs=4e-4), seed
        assert found.factors[1] == pytest.approx(0.97, abs=0.01)
    assert 0.5 < np.mean(np.square(wrong)) < 1.6, wrong


def test_a_file_that_covers_a_part_is_found_in_the_whole():
    random = np.random.default_rng(1)
    path, wheels = both(random, path_of(*wandering(random)), drift=0.0)
    part = (path.times > 20.0) & (path.times < 45.0)
    found = align_clocks(BodyPath("r", path.times[part] - 15.0, path.poses[part]), wheels)
    assert found.offset == pytest.approx(OFFSET_S + 15.0, abs=4.0 * found.sigma)


def holed(path):
    kept = (path.times % 7.0) > 1.5
    return BodyPath("r", path.times[kept], path.poses[kept])


def test_holes_are_no_motion():
    random = np.random.default_rng(2)
    path, wheels = both(random, path_of(*wandering(random)), drift=0.0)
    found = align_clocks(holed(path), wheels)
    assert found.offset == pytest.approx(OFFSET_S, abs=4.0 * found.sigma)


ONES = np.ones(6000)
SQUARE = np.tile(np.repeat([0.0, math.pi / 4.0], 200), 15)


@pytest.mark.parametrize(
    ("name", "speeds", "rates", "words"),
    [
        ("a circle", 0.2 * ONES, 0.5 * ONES, "fit as well as the best"),
        ("straight on", 0.2 * ONES, 0.0 * ONES, "a straight path shows no headings"),
        ("squares without end", 0.2 * ONES, SQUARE, "fit as well as the best"),
        ("standing", 0.0 * ONES, 0.0 * ONES, "hardly moves"),
    ],
)
def test_a_path_that_cannot_tell_is_refused(name, speeds, rates, words):
    random = np.random.default_rng(3)
    path, wheels = both(random, path_of(speeds, rates))
    with pytest.raises(UserError, match=words):
        align_clocks(path, wheels)


def test_another_drive_is_refused():
    random = np.random.default_rng(4)
    path, _ = both(random, path_of(*wandering(random)))
    _, wheels = both(random, path_of(*wandering(random)))
    with pytest.raises(UserError, match="cannot be aligned"):
        align_clocks(path, wheels)


@pytest.mark.parametrize(
    ("scale", "words"),
    [
        ((1000.0, 1000.0, 1.0), "mm"),
        ((1.0, 1.0, 180.0 / math.pi), "degrees"),
        ((0.01, 0.01, 1.0), "m instead of cm"),
    ],
)
def test_units_that_are_not_those_said_are_named(scale, words):
    random = np.random.default_rng(5)
    path, wheels = both(random, path_of(*wandering(random)))
    with pytest.raises(UserError, match=words):
        align_clocks(BodyPath("r", path.times, path.poses * scale), wheels)


def slipped(change):
    random = np.random.default_rng(3)
    path, wheels = both(random, path_of(*wandering(random)), drift=0.0)
    poses = path.poses.copy()
    change(poses)
    return BodyPath("r", path.times, poses), wheels


def exchanged(poses):
    poses[:, [0, 1]] = poses[:, [1, 0]]


def of_a_compass(poses):
    poses[:, 2] = np.mod(math.pi / 2.0 - poses[:, 2], math.tau)


def in_degrees(poses):
    poses[:, 2] = np.degrees(np.mod(poses[:, 2] + math.pi, math.tau) - math.pi)


def left_handed(poses):
    poses[:, 1:] *= -1.0


def unchanged(poses):
    poses[:, 2] = 0.4


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (exchanged, "its places are mirrored"),
        (of_a_compass, "its headings count clockwise, as a compass does"),
        (in_degrees, "it looks like degrees"),
        (left_handed, "it rotates to the right where the wheels rotate the robot to the left"),
        (unchanged, "its heading stays the same while the wheels rotate"),
    ],
)
def test_other_axes_and_headings_are_named(change, words):
    with pytest.raises(UserError) as caught:
        align_clocks(*slipped(change))
    assert words in str(caught.value)


def test_a_body_that_is_turned_on_the_robot_or_driven_backwards_is_no_slip():
    def turned(poses):
        poses[:, 2] += 2.5

    align_clocks(*slipped(turned))
    random = np.random.default_rng(5)
    speeds, rates = wandering(random)
    path, wheels = both(random, path_of(-speeds, rates), drift=0.0)
    align_clocks(path, wheels)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: 1e3 * t, "seen every 10 s"),
        (lambda t: 1e9 * t, "seen every 1e\\+07 s"),
        (lambda t: 1e-3 * t, "seen every 1e-05 s"),
        (lambda t: np.concatenate(([-1.7e9], t[1:])), "seen from -1700000000 s to"),
    ],
)
def test_times_in_other_units_are_said(change, words):
    path, wheels = both(np.random.default_rng(1), path_of(*wandering(np.random.default_rng(1))))
    with pytest.raises(UserError, match=words):
        align_clocks(BodyPath("r", change(path.times), path.poses), wheels)


def test_lengths_in_a_unit_that_nobody_knows_are_said_but_for_small_factors():
    path, wheels = both(np.random.default_rng(2), path_of(*wandering(np.random.default_rng(2))))
    for factor in (39.4, 12.0):
        poses = path.poses * (factor, factor, 1.0)
        with pytest.raises(UserError, match="times that of the wheels"):
            align_clocks(BodyPath("r", path.times, poses), wheels)
    feet = align_clocks(BodyPath("r", path.times, path.poses * (3.28, 3.28, 1.0)), wheels)
    assert "times as fast as they say" in feet.words()


def test_headings_that_jump_are_not_taken_for_exchanged_wheels():
    path, wheels = both(np.random.default_rng(3), path_of(*wandering(np.random.default_rng(3))))
    flipped = np.arange(len(path.times)) % 200 < 6
    poses = path.poses + np.outer(flipped, (0.0, 0.0, math.pi))
    with pytest.raises(UserError, match="of its rotations") as caught:
        align_clocks(BodyPath("r", path.times, poses), wheels)
    assert "exchange" not in str(caught.value)


@pytest.mark.parametrize(
    ("leap_s", "words"),
    [
        (3600.0, r"leap by 3600\.0 s after 2[45]"),
        (1.0, r"its offset to the wheels changes by \d{2,3} ms"),
        (0.1, r"its offset to the wheels changes by \d{2,3} ms"),
        (-1.0, r"its offset to the wheels changes by \d{2,3} ms"),
    ],
)
def test_a_clock_that_leaps_is_named(leap_s, words):
    random = np.random.default_rng(2)
    path, wheels = both(random, path_of(*wandering(random, 50.0)))
    times = path.times + np.where(path.times > 25.0, leap_s, 0.0)
    order = np.argsort(times, kind="stable")
    with pytest.raises(UserError, match=words):
        align_clocks(BodyPath("r", times[order], path.poses[order]), wheels)


def test_a_body_without_a_single_pose_is_named():
    random = np.random.default_rng(6)
    path, wheels = both(random, path_of(*wandering(random, 15.0)))
    with pytest.raises(UserError, match="body r has no pose at all"):
        align_clocks(BodyPath("r", path.times[:0], path.poses[:0]), wheels)
