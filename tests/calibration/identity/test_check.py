"""Another robot's body, dead and exchanged encoders, bodies that stand still or change places."""

import contextlib
import math

import numpy as np
import pytest
from scipy.signal import lfilter

from host.calibration.identity.check import check_identity
from host.calibration.identity.one_way import check_one_way
from host.config import Mocap, Wheels
from host.errors import UserError

STEP_S = 0.02
WHEELS = Wheels(left_radius_m=0.034, right_radius_m=0.033, track_m=0.13)  # as built
CONFIGURED = Wheels()


def drive(seed, seconds=60.0):
    """Speeds and turn rates (n,), new ones every 3 s."""
    random = np.random.default_rng(seed)
    pieces = math.ceil(seconds / 3.0)
    wanted = random.uniform(0.1, 0.35, pieces), random.uniform(-1.4, 1.4, pieces)
    return [lfilter([0.05], [1.0, -0.95], np.repeat(w, 150)) for w in wanted]


def path(speeds, rates, heading=0.3):
    psi = np.cumsum(rates) * STEP_S
    x, y = (np.cumsum(speeds * side(psi)) * STEP_S for side in (np.cos, np.sin))
    return np.column_stack((x, y, psi + heading))


def ticks_of(speeds, rates):
    ways = np.stack([speeds + s * rates * WHEELS.track_m / 2.0 for s in (-1.0, 1.0)], axis=1)
    radii = np.array([WHEELS.left_radius_m, WHEELS.right_radius_m])
    turns = np.cumsum(ways, axis=0) * STEP_S / (math.tau * radii)
    return np.floor(turns * WHEELS.counts_per_turn).astype(np.int64)


OWN, OTHER = drive(1), drive(2)
TIMES = np.arange(len(OWN[0])) * STEP_S
PATHS = {1: path(*OWN), 2: path(*OTHER), 3: path(*drive(3))}
STILL = np.zeros((len(TIMES), 3))
TICKS = ticks_of(*OWN)
HALF = len(TIMES) // 2


def check(ticks=TICKS, body=1, heading=0.3, **changed):
    paths = PATHS | {int(name[1:]): rows for name, rows in changed.items()}
    noise = np.random.default_rng(0).normal(0.0, (3e-4, 3e-4, 2e-3), (len(TIMES), 3))
    seen = {number: (TIMES - 0.05, rows + noise) for number, rows in paths.items()}
    check_identity(TIMES, ticks, seen, CONFIGURED, Mocap(body=body, heading_rad=-heading))


def silent(ticks, wheel, begin=0):
    dead = ticks.copy()
    dead[begin:, wheel] = dead[begin, wheel]
    return dead


def spliced(first, second):
    return np.concatenate((first[:HALF], second[HALF:]))


@pytest.mark.parametrize("ticks", [TICKS, 2 * TICKS, TICKS // 4])
def test_a_sound_drive_passes(ticks):
    check(ticks)


@pytest.mark.parametrize("body", [2, 3])
def test_the_body_that_fits_is_named(body):
    with pytest.raises(UserError, match=f"body 1 moves as these wheels do; robot.toml says {body}"):
        check(body=body)
    with pytest.raises(UserError, match=r"body 1 moves as .*; robot\.toml says 4"):
        check(body=4, b4=STILL)


@pytest.mark.parametrize(
    ("ticks", "words"),
    [
        (silent(TICKS, 0), "the left encoder counts nothing in the whole drive"),
        (silent(TICKS, 1), "the right encoder counts nothing in the whole drive"),
        (silent(TICKS, 1, HALF), r"the right encoder counts nothing from (29|30)"),
        (0 * TICKS, "neither wheel counts"),
        (TICKS * (-1, 1), "the left encoder counts the wrong way"),
        (TICKS * (1, -1), "the right encoder counts the wrong way"),
        (TICKS[:, ::-1], "left and right wheel are exchanged"),
        (-TICKS, "both encoders count the wrong way"),
    ],
)
def test_each_fault_of_the_encoders_has_its_own_name(ticks, words):
    with pytest.raises(UserError, match=words):
        check(ticks)


def test_a_body_that_stands_still_is_named():
    with pytest.raises(UserError, match="body 1 stands still while the wheels drive 1"):
        check(b1=STILL)


def test_bodies_that_change_places_are_named_with_when():
    mine, theirs = PATHS[1], PATHS[2]
    with pytest.raises(UserError, match=r"bodies 1 and 2 change places at about (27|28|29|30|31)"):
        check(b1=spliced(mine, theirs), b2=spliced(theirs, mine))
    with pytest.raises(UserError, match="bodies 2 and 1 change places"):
        check(body=2, b1=spliced(mine, theirs), b2=spliced(theirs, mine))


def changed(*parts):
    """Ticks whose steps are multiplied by a matrix from when to when, in shares of the drive."""
    steps = np.diff(TICKS, axis=0, prepend=TICKS[:1]).astype(float)
    for begin, end, matrix in parts:
        rows = slice(round(begin * len(TIMES)), round(end * len(TIMES)))
        steps[rows] = steps[rows] @ np.array(matrix, dtype=float)
    return np.rint(np.cumsum(steps, axis=0)).astype(np.int64)


NO_LEFT, EXCHANGED = ((0, 0), (0, 1)), ((0, 1), (1, 0))


@pytest.mark.parametrize(
    ("ticks", "words"),
    [
        (
            changed((0.5, 1.0, ((0.5, 0), (0, 1)))),
            r"left encoder counts 0\.5.* from (28|29|30|31)\.. s on",
        ),
        (
            changed((0.3, 0.6, ((1, 0), (0, 0.7)))),
            r"right .* 0\.7.* from 1[789]\.. to 3[567]\.. s as",
        ),
        (
            changed((0.5, 1.0, ((-1, 0), (0, 1)))),
            r"left .* wrong way round from (28|29|30|31)\.. s on",
        ),
        (changed((0.5, 1.0, EXCHANGED)), r"left and right wheel .* from (28|29|30|31)\.. s on"),
        (changed((0.5, 1.0, ((-1, 0), (0, -1)))), r"both encoders .* from (28|29|30|31)\.. s on"),
        (changed((0.3, 0.34, NO_LEFT)), r"left encoder counts nothing from 1[78].* a loose plug"),
        (
            changed(*((at, at + 0.04, NO_LEFT) for at in (0.1, 0.3, 0.5, 0.7, 0.9))),
            r"left encoder counts nothing from 6\.. to 8\.. s, .* and 2 times more",
        ),
    ],
)
def test_what_is_wrong_for_a_part_of_the_drive_is_named_with_when(ticks, words):
    with pytest.raises(UserError, match=words.replace(".*", "(.|\n)*")):
        check(ticks)


def test_bodies_that_change_places_thrice_are_named_with_each_time():
    mine, theirs = PATHS[1].copy(), PATHS[2].copy()
    for begin, end in ((0.25, 0.5), (0.75, 1.0)):
        rows = slice(round(begin * len(TIMES)), round(end * len(TIMES)))
        mine[rows], theirs[rows] = PATHS[2][rows], PATHS[1][rows]
    with pytest.raises(UserError, match=r"at about 1[456]\.., (28|29|30|31)\.. and 4[3456]\.. s"):
        check(b1=mine, b2=theirs)


def test_a_robot_that_comes_back_with_another_number_is_named():
    moved = {1: (TIMES[:HALF], PATHS[1][:HALF]), 7: (TIMES[HALF:], PATHS[1][HALF:])}
    others = {number: (TIMES, PATHS[number]) for number in (2, 3)}
    with pytest.raises(UserError, match=r"body 1 is lost, and body 7 .* from (28|29|30)\.. s on"):
        check_identity(TIMES, TICKS, moved | others, CONFIGURED, Mocap())
    lost = {1: moved[1]}
    moment = (TIMES > 25.0) & (TIMES < 34.0)  # too short to be taken for the robot
    gone = {1: (TIMES[~moment], PATHS[1][~moment]), 7: (TIMES[moment], PATHS[1][moment])}
    check_identity(TIMES, TICKS, gone, CONFIGURED, Mocap())
    check_identity(TIMES, TICKS, lost | others | {4: (TIMES, STILL)}, CONFIGURED, Mocap())


def test_a_count_that_is_repeated_row_after_row_is_named():
    steps = np.diff(TICKS, axis=0, prepend=TICKS[:1])
    steps[HALF:, 1] = steps[HALF, 1]
    with pytest.raises(UserError, match=r"right encoder repeats the count .* from (29|30)\.. s on"):
        check(np.cumsum(steps, axis=0))


@pytest.mark.parametrize("wheel", [0, 1])
def test_a_wheel_that_stands_while_the_robot_rotates_about_it_is_no_dead_encoder(wheel):
    """Pivots of 4 s about one wheel, and drives straight on, in turns."""
    count = len(TIMES)
    pivots = (np.arange(count) // 200) % 2 == 1
    ways = np.full((count, 2), 0.2)
    ways[pivots, wheel] = 0.0
    speeds, rates = ways.mean(axis=1), (ways[:, 1] - ways[:, 0]) / WHEELS.track_m
    check(ticks_of(speeds, rates), b1=path(speeds, rates))
    check(4 * ticks_of(speeds, rates), b1=path(speeds, rates))


def test_a_body_that_freezes_is_not_one_that_changes_places():
    frozen = spliced(PATHS[1], PATHS[1][[HALF] * len(TIMES)])
    with pytest.raises(UserError, match=r"body 1 stands still .* m, from (29|30)\.\d s on"):
        check(b1=frozen)
    mine, theirs = spliced(STILL, PATHS[1]), spliced(PATHS[1], STILL)
    with pytest.raises(UserError, match="bodies 1 and 4 change places"):
        check(b1=mine, b4=theirs)


def test_what_cannot_be_judged_passes():
    check_identity(TIMES[:0], TICKS[:0], {1: (TIMES, PATHS[1])}, CONFIGURED, Mocap())
    check_identity(TIMES, TICKS, {2: (TIMES, PATHS[2])}, CONFIGURED, Mocap())
    straight = ticks_of(np.full(len(TIMES), 0.2), np.zeros(len(TIMES)))
    check(straight, b1=path(np.full(len(TIMES), 0.2), np.zeros(len(TIMES))))


@pytest.mark.parametrize(
    ("one_way", "words"),
    [
        ((), ""),
        ((0,), "left encoder counts forward while its wheel goes"),
        ((1,), "right encoder counts forward while its wheel goes"),
        ((0, 1), "both encoders count forward while their wheels go"),
    ],
)
def test_encoders_that_count_without_a_direction_are_named_where_the_robot_backs_up(one_way, words):
    speeds, rates = drive(1)
    for begin, end in ((10.0, 12.0), (30.0, 36.0)):
        speeds[round(begin / STEP_S) : round(end / STEP_S)] *= -1.0
    steps = np.diff(ticks_of(speeds, rates), axis=0, prepend=0)
    steps[:, list(one_way)] = np.abs(steps[:, list(one_way)])
    ticks, moved = np.cumsum(steps, axis=0), path(speeds, rates)
    when = rf"{words} backward from (10|9)\.. to 1[12].* and from (29|30)"
    with pytest.raises(UserError, match=when) if words else contextlib.nullcontext():
        check(ticks, b1=moved)


@pytest.mark.parametrize("seed", range(2, 10))
def test_the_wheels_of_another_robot_are_not_called_without_a_direction(seed):
    own = {1: (TIMES, path(*drive(seed)))}
    check_one_way(TIMES, TICKS, own, CONFIGURED, [])
