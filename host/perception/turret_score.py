"""How much a segment speaks for a turret: log likelihood ratio against everything else indoors.

What furnished rooms show in a turret's size: chair and table legs, strips of wall between two
nearer things, walls at grazing incidence that fall to pieces. A logistic model of a few features
tells them apart; tools/fit_turret_score.py fits it to recorded rooms with turrets cut into them.
"""

import numpy as np

from host.messages import BoolArray, FloatArray, IntArray
from host.perception.turret_fit import X4_NOISE_M, Circles, members, noise_m
from host.perception.turret_segments import STEP, Returns, Segments

# Weights of the features, in the order of their columns, and the constant.
FEATURES = {
    "shape": 0.689,
    "shape a return": -1.326,
    "misfit": -2.478,
    "on a line": -2.158,
    "long nulls": 4.870,
    "nulls": -1.535,
    "adjoining": -2.983,
    "missing width": -6.471,
    "expected returns": 2.600,
    "hidden on both sides": -3.943,
}
CONSTANT = 1.026
# The least score of a candidate, by its number of returns: more of them show more of the shape.
# Between them most turrets are found; what lies below is more often furniture than half a turret.
HITS = np.array([2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0])
LEAST_SCORES = np.array([-2.51, -1.92, -0.44, -2.91, 1.05, 2.0, 2.0])

_WEIGHTS = np.array(list(FEATURES.values()))
_CLOSE = 3.0  # turret widths: what is so near beside a segment may go on in it
_LINE_M = 0.02  # a piece of wall lies this close to the line between its neighbours ...
_LINE_REACH_M = 0.6  # ... which are then this near
_NOWHERE_M = 10.0 * _LINE_REACH_M  # further than any neighbour that counts
_RUN = 6  # returns on one side that make a line


def scores(seen: Returns, segments: Segments, circles: Circles, diameter: float) -> FloatArray:
    """Log likelihood ratio (k,) of a turret against background for each segment."""
    table = features(seen, segments, circles, diameter)
    return np.asarray(table @ _WEIGHTS + CONSTANT, dtype=np.float64)


def convincing(score: FloatArray, hits: IntArray) -> BoolArray:
    """Which segments (k,) are candidates."""
    return np.asarray(score > np.interp(hits, HITS, LEAST_SCORES))


def features(seen: Returns, segments: Segments, circles: Circles, diameter: float) -> FloatArray:
    """What the score is made of: (k, 10), in the order of FEATURES."""
    sizes = segments.sizes
    better = line_misfits(seen, segments) - circles.misfits
    shape = np.sign(better) * np.log1p(np.abs(better))
    expected = segments.widths / seen.spacing
    nulls = segments.nulls
    return np.stack(
        (
            shape,
            shape / sizes,
            np.maximum(np.log(0.3 + circles.misfits / sizes), 0.0),
            _on_wall(seen, segments) * segments.distances,
            np.sum(nulls > 3, axis=0),
            np.sum(np.minimum(nulls, 4), axis=0),
            np.sum(_adjoining(seen, segments, diameter), axis=0),
            np.maximum(expected - sizes - 1.0, 0.0) / expected,
            np.log(expected),
            np.all(segments.hidden, axis=0),
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


def _adjoining(seen: Returns, segments: Segments, diameter: float) -> BoolArray:
    """Whether the surface may go on beside (2, k), as that of a sparsely hit wall does."""
    before, after = (_beside(seen, segments, k) for k in (-1, 1))
    gap = (
        np.hypot(*(before - seen.points[segments.first]).T),
        np.hypot(*(after - seen.points[segments.last]).T),
    )
    level = np.abs(segments.steps) <= 2.5 * STEP * diameter
    return np.asarray(level & (np.stack(gap) < _CLOSE * diameter))


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
