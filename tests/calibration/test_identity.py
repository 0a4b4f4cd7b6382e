"""Another robot's body, dead and exchanged encoders, bodies that stand still or change places."""

import math

import numpy as np
import pytest
from scipy.signal import lfilter

from host.calibration.identity import check_identity
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
        (silent(TICKS, 0), "the left encoder counts nothing from 0.0 s"),
        (silent(TICKS, 1), "the right encoder counts nothing from 0.0 s"),
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


def changed(wheel, factor):
    steps = np.diff(TICKS, axis=0, prepend=TICKS[:1]).astype(float)
    steps[HALF:, wheel] *= factor
    return np.cumsum(steps, axis=0).astype(np.int64)


@pytest.mark.parametrize(
    ("wheel", "factor", "words"),
    [
        (0, 0.5, r"from (29|30|31) s on the left encoder counts 0\.[45]"),
        (1, 0.5, r"from (29|30|31) s on the right encoder counts 0\.[45]"),
        (0, -1.0, r"from (29|30|31) s on the left encoder counts -(1|0\.9)"),
    ],
)
def test_an_encoder_that_counts_otherwise_from_some_time_on_is_named(wheel, factor, words):
    with pytest.raises(UserError, match=words):
        check(changed(wheel, factor))


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
