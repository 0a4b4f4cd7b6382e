"""Is the tracked body this robot, and do its wheels count as they are thought to?

Over windows of two seconds, the rotation that the wheels should give is compared with that of every
body seen: as the wheels count, with one reversed, both exchanged, or one that loses counts. What
holds from when to when is found in `spells`; encoders that count nothing, or always the same, are
found in `stuck`, those without a direction in `one_way`.
"""

import itertools
import math
from collections.abc import Sequence

import numpy as np

from host.calibration.identity.one_way import check_one_way
from host.calibration.identity.spells import (
    FAILS,
    LEAST_WINDOWS,
    Explanation,
    Spell,
    Story,
    best_story,
    parts_of,
)
from host.calibration.identity.stuck import check_repeated, check_silent
from host.calibration.identity.windows import (
    STRIDE_S,
    WINDOW_S,
    Bodies,
    Moved,
    longest,
    moved_in_windows,
    spans,
)
from host.config import Mocap, Wheels
from host.errors import UserError
from host.geometry import wrap
from host.messages import BoolArray, FloatArray, IntArray

_STILL_M, _STILL_RAD = 0.01, 0.03  # in a window
_DRIVEN_M = 1.0  # by the wheels, before a body that stands still is noticed
_MOST_COUNTED = 0.88  # of what a wheel counts in the rest of the drive: less is a fault
_WHOLE = 0.9  # of the drive
_SETTINGS = "left_encoder_reversed, right_encoder_reversed in [motors] of robot.toml"
_EXCHANGED = "left and right wheel are exchanged"
_BOTH = "both encoders count the wrong way round"
_LOSES = ("the left encoder", "the right encoder")
# The true ways of the left and the right wheel, by those that are counted.
_WIRINGS = {
    "the left encoder counts the wrong way round": ((-1.0, 0.0), (0.0, 1.0)),
    "the right encoder counts the wrong way round": ((1.0, 0.0), (0.0, -1.0)),
    _EXCHANGED: ((0.0, 1.0), (1.0, 0.0)),
}
# Of another body: cheaper than that the wheels count otherwise, which may rotate likewise; but it
# moves as the wheels do, with the same gains, and two robots may drive alike for some seconds.
_PRICE, _BODY_FITS, _BODY_WINDOWS = 40.0, 1.2, 10
_LEAST_UNSEEN = 20  # windows of a body that is taken for one that was lost
_SHARES = (0.5, 0.75, 0.9)  # of the counts: the nearest is refined


def check_identity(
    times: FloatArray, ticks: IntArray, bodies: Bodies, wheels: Wheels, mocap: Mocap
) -> None:
    """Raise UserError where the body in `mocap` does not move as the wheels do, and say why.

    times (n,) s; ticks (n, 2): left, right, counted from the start. What cannot be judged passes:
    a drive too short, without rotation, or with a body that is not seen. Times in errors are those
    after the first tick.
    """
    moved = moved_in_windows(times, ticks, bodies, wheels)
    own = moved.bodies.get(mocap.body)
    if own is None or np.count_nonzero(np.isfinite(own[:, 2])) < LEAST_WINDOWS:
        return
    story = best_story(moved, _explanations(moved, mocap.body), wheels.track_m)
    spells = story.spells()
    elsewhere = [s for s in spells if s.explanation.body != mocap.body]
    here = [s for s in spells if s.explanation.body == mocap.body]
    _check_still(moved, own, mocap.body, ~_inside(moved, elsewhere))
    _check_bodies(moved, elsewhere, mocap.body)
    wrong = story.costs[:, 0] > FAILS
    check_repeated(times, ticks, moved.starts, wrong, moved.length_s)
    alone = {mocap.body: bodies[mocap.body]}
    check_silent(times, ticks, alone, wheels)
    check_one_way(times, ticks, alone, wheels, parts_of(here, moved)[0])
    if here:
        words = max(here, key=lambda s: s.end - s.begin).explanation.words
        alike = [s for s in here if s.explanation.words == words]
        if words in _LOSES:
            _check_counting(moved, alike)
        else:
            raise _wrong_wiring(moved, story, alike, own, mocap)


def _explanations(moved: Moved, body: int) -> list[Explanation]:
    others = [
        Explanation(number, np.eye(2), price=_PRICE, fits=_BODY_FITS, windows=_BODY_WINDOWS)
        for number, rows in moved.bodies.items()
        if number != body and np.count_nonzero(np.isfinite(rows[:, 2])) >= LEAST_WINDOWS
    ]
    wirings = [Explanation(body, np.array(ways), words) for words, ways in _WIRINGS.items()]
    losses = [
        Explanation(body, np.diag(ways), words, wheel)
        for share in _SHARES
        for wheel, (words, ways) in enumerate(
            zip(_LOSES, ((1.0 / share, 1.0), (1.0, 1.0 / share)), strict=True)
        )
    ]
    return [Explanation(body, np.eye(2)), *others, *wirings, *losses]


def _check_bodies(moved: Moved, spells: Sequence[Spell], body: int) -> None:
    """Raise where the wheels move another body than `body` for a part of the drive, or for all."""
    own = np.isfinite(moved.bodies[body][:, 2])
    spells = [
        s for s in spells if own[s.begin : s.end].mean() > 0.5 or s.end - s.begin >= _LEAST_UNSEEN
    ]
    if not spells:
        return
    numbers = list(dict.fromkeys(s.explanation.body for s in spells))
    other = numbers[0]
    if len(numbers) == 1 and _inside(moved, spells).mean() > _WHOLE:
        raise UserError(
            f"body {other} moves as these wheels do; robot.toml says {body}",
            f"body {body} rotates otherwise",
            f"set body = {other} in [mocap] of robot.toml",
        )
    parts, whole = parts_of(spells, moved)
    of = [(s.explanation.body, part) for s, part in zip(spells, parts, strict=True)]
    moves = [
        f"body {number} moves as these wheels do {spans([p for n, p in of if n == number], whole)}"
        for number in numbers
    ]
    if not any(own[s.begin : s.end].mean() > 0.5 for s in spells):
        raise UserError(
            f"body {body} is lost, and {_listed(moves)}",
            "motion capture lost the robot, and gave it another number when it was seen again",
            "give the robot markers that are seen from all sides, and record again; or use what is "
            "before and after as two recordings",
        )
    changes = dict.fromkeys(
        f"{at:.1f}" for at in sorted(itertools.chain(*parts)) if 1.0 < at < whole - 1.0
    )
    raise UserError(
        f"bodies {_listed([body, *numbers])} change places at about {_listed([*changes])} s",
        f"{_listed(moves)}; body {body} then moves otherwise",
        "give the bodies marker patterns that differ, and record again; or use what is "
        "before and after as two recordings",
    )


def _listed(things: Sequence[object]) -> str:
    *first, last = map(str, things)
    return f"{', '.join(first)} and {last}" if first else last


def _check_still(moved: Moved, own: FloatArray, body: int, chosen: BoolArray) -> None:
    """Raise where the body stands still in windows chosen (w,) in which the wheels drive."""
    driven = np.abs(moved.ways).mean(axis=1)
    still = (np.hypot(own[:, 0], own[:, 1]) < _STILL_M) & (np.abs(own[:, 2]) < _STILL_RAD)
    begin, end = longest(chosen & still & (driven > _STILL_M))
    way = float(driven[begin:end].sum()) * STRIDE_S / WINDOW_S
    if way >= _DRIVEN_M:
        raise UserError(
            f"body {body} stands still while the wheels drive {way:.1f} m, from "
            f"{moved.starts[begin]:.1f} s on",
            "motion capture takes something else for this robot or repeats its last pose, or the "
            "wheels run in the air",
            "set body in [mocap] of robot.toml to the number of the body on this robot",
        )


def _check_counting(moved: Moved, spells: Sequence[Spell]) -> None:
    """Raise where a wheel counts less for the same way than in the rest of the drive."""
    share = 1.0 / float(np.max(spells[0].explanation.true_ways))
    if share > _MOST_COUNTED or _inside(moved, spells).mean() > _WHOLE:
        return  # a wheel that counts so all along looks like a larger one
    words = spells[0].explanation.words
    raise UserError(
        f"{words} counts {share:.2g} times as much for the same way "
        f"{spans(*parts_of(spells, moved))} as in the rest of the drive",
        "it loses counts, as by a loose plug or electrical noise, or the wheel slips",
        f"check {words}'s plug, supply and channels with tools/try_wheels.py",
    )


def _wrong_wiring(
    moved: Moved, story: Story, spells: Sequence[Spell], own: FloatArray, mocap: Mocap
) -> UserError:
    words = spells[0].explanation.words
    inside = _inside(moved, spells)
    ahead = _forward(moved, own, inside)
    cure = f"set {_SETTINGS}"
    if inside.mean() > _WHOLE:
        if words == _EXCHANGED:
            # Both reversed rotate likewise, but drive backwards, by how the body is said to lie.
            if abs(float(wrap(ahead + mocap.heading_rad))) > math.pi / 2.0:
                words = _BOTH
            words += " (if the tracked body's x-axis points as heading_rad in [mocap] says)"
            cure = f"exchange the plugs of the encoders or motors, or set {_SETTINGS}"
        return UserError("the wheels' encoders do not fit the true path", words, cure)
    other_way = abs(float(wrap(ahead - _forward(moved, own, story.chosen == 0)))) > math.pi / 2.0
    if words == _EXCHANGED and other_way:
        words = _BOTH
    return UserError(
        f"{words} {spans(*parts_of(spells, moved))}",
        "in the rest of the drive they count as the true path says",
        "check that nothing was plugged in another way meanwhile, and that the recording was not "
        "put together of several; see the channels with tools/try_wheels.py",
    )


def _inside(moved: Moved, spells: Sequence[Spell]) -> BoolArray:
    """Which windows (w,) are in one of the spells."""
    inside = np.zeros(len(moved.starts), dtype=bool)
    for spell in spells:
        inside[spell.begin : spell.end] = True
    return inside


def _forward(moved: Moved, own: FloatArray, chosen: BoolArray) -> float:
    """Direction (rad) in the body's own frame in which it goes where the wheels count forward."""
    forward = moved.ways.mean(axis=1)
    known = chosen & (np.abs(own[:, 2]) < 0.5)
    return math.atan2(forward[known] @ own[known, 1], forward[known] @ own[known, 0])
