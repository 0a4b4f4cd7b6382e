"""How much a segment speaks for a turret: log likelihood ratio against everything else indoors.

What furnished rooms show in a turret's size: chair and table legs, strips of wall between two
nearer things, walls at grazing incidence that fall to pieces. A logistic model of a few features
tells them apart; tools/fit_turret_score.py fits it to recorded rooms with turrets cut into them and
to simulated ones, and reports its state in rooms that it was not fitted to.
"""

import numpy as np

from host.messages import BoolArray, FloatArray
from host.perception.turrets.fit import X4_NOISE_M, Circles, noise_m
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
_BESIDE = np.array([1, 3, 6])  # which of the returns on each side are looked at
# Three returns of the wall make a line: all on one side, or two on one and one on the other.
_LINES = np.array([[0, 3, 0, 3], [1, 4, 1, 4], [2, 5, 3, 0]])


def scores(seen: Returns, segments: Segments, circles: Circles, diameter: float) -> FloatArray:
    """Log likelihood ratio (k,) of a turret against background for each segment."""
    table = features(seen, segments, circles, diameter)
    return np.asarray(table @ _WEIGHTS + CONSTANT, dtype=np.float64)


def features(seen: Returns, segments: Segments, circles: Circles, diameter: float) -> FloatArray:
    """What the score is made of: (k, 10), in the order of FEATURES."""
    sizes, nulls = segments.sizes, segments.nulls
    around = _around(seen, segments)
    better = line_misfits(seen, segments) - circles.misfits
    expected = segments.widths / seen.spacing
    missing = np.maximum(expected - sizes - 1.0, 0.0) / expected
    return np.stack(
        (
            np.sign(better) * np.log1p(np.abs(better)),
            np.maximum(np.log(0.3 + circles.misfits / sizes), 0.0),
            _on_wall(around, segments) * segments.distances,
            np.sum(np.where(nulls <= _SHORT, nulls, 0), axis=0),
            np.sum(nulls > 0, axis=0),
            missing,
            missing * np.any(segments.hidden, axis=0),
            np.log(expected),
            np.all(segments.hidden, axis=0),
            np.log(np.minimum(_clear_space(seen, segments, around) / diameter, _CLEAR)),
        ),
        axis=1,
    )


def line_misfits(seen: Returns, segments: Segments) -> FloatArray:
    """Sum (k,) of (distance / noise)² of each segment's returns from their best line."""
    sizes, middle_x, middle_y = segments.sizes, segments.middles[:, 0], segments.middles[:, 1]
    x, y = np.ascontiguousarray(seen.points.take(segments.members, 0).T)
    x, y = x - segments.of_members(middle_x), y - segments.of_members(middle_y)
    x, y, xx, xy, yy = segments.sums(np.stack((x, y, x * x, x * y, y * y))) / sizes
    xx, xy, yy = xx - x * x, xy - x * y, yy - y * y
    # The smaller eigenvalue of the scatter.
    least = 0.5 * (xx + yy) - np.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
    noise = noise_m(segments.distances, X4_NOISE_M)
    return np.asarray(sizes * np.maximum(least, 0.0) / noise**2, dtype=np.float64)


def _around(seen: Returns, segments: Segments) -> FloatArray:
    """Returns (2, 6, k) beside each segment: of both sides, the places _BESIDE away from its ends.

    Where little else returned one comes around to the segment itself: then a point far away.
    """
    count, away = len(seen.points), _BESIDE[:, None]
    index = np.concatenate((segments.first - away, segments.last + away)) % count
    places = np.ascontiguousarray(seen.points.take(index, 0).transpose(2, 0, 1))
    itself = away + segments.sizes > count
    if itself.any():
        far = (segments.middles + _NOWHERE_M).T[:, None]
        places = np.where(np.concatenate((itself, itself)), far, places)
    return places


def _clear_space(seen: Returns, segments: Segments, around: FloatArray) -> FloatArray:
    """Distance (k,) m from the ends of each segment to the nearer of the returns beside it."""
    before = around[:, 0] - seen.points.take(segments.first, 0).T
    after = around[:, len(_BESIDE)] - seen.points.take(segments.last, 0).T
    gaps = np.minimum(np.hypot(before[0], before[1]), np.hypot(after[0], after[1]))
    return np.asarray(gaps)


def _on_wall(around: FloatArray, segments: Segments) -> BoolArray:
    """Whether segments (k,) lie on a line with what is around them: the wall goes on there."""
    a, b, c = (around.take(which, axis=1) for which in _LINES)
    straight = _off_line(b, a, c) < 0.5 * _LINE_M
    on_it = _off_line(segments.middles.T[:, None], a, c) < _LINE_M
    return np.asarray((straight & on_it).any(axis=0))


def _off_line(point: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Distance (...) m of points (2, ...) from the lines through a and b; inf if these are far."""
    along, offset = b - a, point - a
    length = np.maximum(np.hypot(along[0], along[1]), 1e-9)
    across = np.abs(along[0] * offset[1] - along[1] * offset[0]) / length
    far = (np.hypot(offset[0], offset[1]) > _LINE_REACH_M) | (length > 2.0 * _LINE_REACH_M)
    return np.where(far, np.inf, across)
