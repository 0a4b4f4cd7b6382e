"""How much a segment speaks for a turret: log likelihood ratio against everything else indoors.

What furnished rooms show in a turret's size: chair and table legs, strips of wall between two
nearer things, walls at grazing incidence that fall to pieces. A logistic model of a few features
tells them apart; tools/fit_turret_score.py fits it to recorded rooms with turrets cut into them and
to simulated ones, and reports how it does in rooms that it was not fitted to.
"""

import numpy as np

from host.messages import BoolArray, FloatArray
from host.perception.turrets.fit import X4_NOISE_M, Circles, members, noise_m
from host.perception.turrets.segments import Returns, Segments

# Weights of the features, in the order of their columns, and the constant.
FEATURES = {
    "shape": 0.367,
    "misfit": -1.926,
    "on a line": -2.597,
    "short nulls": -0.686,
    "sides with nulls": -2.239,
    "missing width": -7.247,
    "missing width, partly hidden": 7.413,
    "expected returns": 3.073,
    "hidden on both sides": -4.868,
    "clear space": 1.502,
}
CONSTANT = -1.596
# The least score of a candidate: what lies below is more often furniture than half a turret.
LEAST_SCORE = -1.80

_WEIGHTS = np.array(list(FEATURES.values()))
_CLEAR = 20.0  # turret widths: further away it does not matter where the nearest return is
_SHORT = 3  # nulls in a row: furniture that gives no return here and there
_LINE_M = 0.02  # a piece of wall lies this close to the line between its neighbours ...
_LINE_REACH_M = 0.6  # ... which are then this near
_NOWHERE_M = 10.0 * _LINE_REACH_M  # further than any neighbour that counts
_RUN = 6  # returns on one side that make a line


def scores(seen: Returns, segments: Segments, circles: Circles, diameter: float) -> FloatArray:
    """Log likelihood ratio (k,) of a turret against background for each segment."""
    table = features(seen, segments, circles, diameter)
    return np.asarray(table @ _WEIGHTS + CONSTANT, dtype=np.float64)


def features(seen: Returns, segments: Segments, circles: Circles, diameter: float) -> FloatArray:
    """What the score is made of: (k, 10), in the order of FEATURES."""
    sizes, nulls = segments.sizes, segments.nulls
    better = line_misfits(seen, segments) - circles.misfits
    expected = segments.widths / seen.spacing
    missing = np.maximum(expected - sizes - 1.0, 0.0) / expected
    return np.stack(
        (
            np.sign(better) * np.log1p(np.abs(better)),
            np.maximum(np.log(0.3 + circles.misfits / sizes), 0.0),
            _on_wall(seen, segments) * segments.distances,
            np.sum(np.where(nulls <= _SHORT, nulls, 0), axis=0),
            np.sum(nulls > 0, axis=0),
            missing,
            missing * np.any(segments.hidden, axis=0),
            np.log(expected),
            np.all(segments.hidden, axis=0),
            np.log(np.minimum(_clear_space(seen, segments) / diameter, _CLEAR)),
        ),
        axis=1,
    )


def line_misfits(seen: Returns, segments: Segments) -> FloatArray:
    """Sum (k,) of (distance / noise)² of each segment's returns from their best line."""
    member, group = members(segments)
    sizes, count = segments.sizes, len(segments.first)
    x, y = (seen.points[member] - segments.middles[group]).T

    def mean(value: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(group, value, count) / sizes)

    xx, xy, yy = (mean(a * b) - mean(a) * mean(b) for a, b in ((x, x), (x, y), (y, y)))
    # The smaller eigenvalue of the scatter.
    least = 0.5 * (xx + yy) - np.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
    noise = noise_m(segments.distances, X4_NOISE_M)
    return np.asarray(sizes * np.maximum(least, 0.0) / noise**2, dtype=np.float64)


def _clear_space(seen: Returns, segments: Segments) -> FloatArray:
    """Distance (k,) m from the ends of each segment to the nearer of the returns beside it."""
    before, after = (_beside(seen, segments, k) for k in (-1, 1))
    gaps = np.minimum(
        np.hypot(*(before - seen.points[segments.first]).T),
        np.hypot(*(after - seen.points[segments.last]).T),
    )
    return np.asarray(gaps)


def _beside(seen: Returns, segments: Segments, away: int) -> FloatArray:
    """The return (k, 2) m `away` places after each segment, or before it where negative.

    Where little else returned one comes around to the segment itself: then a point far away.
    """
    count = len(seen.points)
    start = segments.last if away > 0 else segments.first
    index = (start + away) % count
    itself = abs(away) + segments.sizes > count
    return np.where(itself[:, None], segments.middles + _NOWHERE_M, seen.points[index])


def _on_wall(seen: Returns, segments: Segments) -> BoolArray:
    """Whether segments (k,) lie on a line with what is around them: the wall goes on there."""
    middle = segments.middles
    left = [_beside(seen, segments, -k) for k in (1, _RUN // 2, _RUN)]
    right = [_beside(seen, segments, k) for k in (1, _RUN // 2, _RUN)]
    found = np.zeros(len(middle), dtype=bool)
    # Three returns of the wall make a line: all on one side, or two on one and one on the other.
    for a, b, c in (left, right, (left[0], left[1], right[0]), (right[0], right[1], left[0])):
        straight = _off_line(b, a, c) < 0.5 * _LINE_M
        found |= straight & (_off_line(middle, a, c) < _LINE_M)
    return found


def _off_line(point: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Distance (k,) m of points (k, 2) from the lines through a and b; inf where these are far."""
    along, offset = b - a, point - a
    length = np.maximum(np.hypot(*along.T), 1e-9)
    across = np.abs(along[:, 0] * offset[:, 1] - along[:, 1] * offset[:, 0]) / length
    far = (np.hypot(*offset.T) > _LINE_REACH_M) | (length > 2.0 * _LINE_REACH_M)
    return np.where(far, np.inf, across)
