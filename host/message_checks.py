"""Whether a message can be what it claims to be: numbers, shapes and bounds.

Every filter and the localizer ask here. What comes out of our own devices passes; the check is for
what programs, plugins and damaged recordings bring.
"""

import math
from collections.abc import Callable
from functools import singledispatch

import numpy as np

from host.geometry import SECTORS
from host.messages import (
    Bearings,
    Displacement,
    FloatArray,
    Positions,
    Scan,
    TeammateOdometry,
)

_FARTHEST_M = 1e3  # beyond this no sensor of a robot sees, and no robot drives in one interval
_LARGEST_RAD = 1e3  # angles need not be wrapped
_LONGEST_S = 1e9  # interval
_OLDEST_S = 100.0  # lag: of an older reading nobody knows what moved since
_LATEST_S = 1e11
_LEAST_VARIANCE, _MOST_VARIANCE = 1e-10, 1e4  # m² or rad²: of 10 µm to 100 m
_LARGEST_SCORE = 500.0  # a log likelihood ratio; its exponential must be a number
_MOST_HEADING_VARIANCE = 100.0  # rad²: more than not to know it at all
_LEAST_SHAPE = 1e-9  # of det P / (tr P)²: a thinner ellipse is numerically a line
_SYMMETRIC = 1e-6  # relative
_NUMBERS = (int, float, np.integer, np.floating)


def check(message: object) -> None:
    """Raise ValueError if a message is malformed, with what is wrong as text."""
    wrong = fault(message)
    if wrong is not None:
        raise ValueError(wrong)


def fault(message: object) -> str | None:
    """The fault of a malformed message, as text; None if it is sound.

    Looked at are Scan, Positions, Bearings, Displacement and TeammateOdometry; of other things
    nothing is asked.
    """
    try:
        _inspect(message)
    except _FaultError as wrong:
        return f"{type(message).__name__}: {wrong}"
    return None


class _FaultError(Exception):
    pass


@singledispatch
def _inspect(message: object) -> None:
    """Raise _FaultError where something is wrong."""


@_inspect.register
def _(scan: Scan) -> None:
    _number("time", scan.time, -_LATEST_S, _LATEST_S)
    count = _length("ranges", scan.ranges)
    _array("times", scan.times, (count,), -_LATEST_S, _LATEST_S)
    _array("angles", scan.angles, (count,), -_LARGEST_RAD, _LARGEST_RAD)
    _array("ranges", scan.ranges, (count,), 0.0, _FARTHEST_M)


@_inspect.register
def _(measured: Positions) -> None:
    _number("time", measured.time, -_LATEST_S, _LATEST_S)
    count = _length("positions", measured.positions)
    _array("positions", measured.positions, (count, 2), -_FARTHEST_M, _FARTHEST_M)
    _covariances(measured.covariances, count)
    if measured.lags is not None:
        _array("lags", measured.lags, (count,), 0.0, _OLDEST_S)
    if measured.clearance is not None:
        _array("clearance", measured.clearance, (SECTORS,), 0.0, math.inf)
    if measured.scores is not None:
        _array("scores", measured.scores, (count,), -_LARGEST_SCORE, _LARGEST_SCORE)
    _identities(measured.identities, count)


@_inspect.register
def _(measured: Bearings) -> None:
    _number("time", measured.time, -_LATEST_S, _LATEST_S)
    count = _length("bearings", measured.bearings)
    _array("bearings", measured.bearings, (count,), -_LARGEST_RAD, _LARGEST_RAD)
    _array("variances", measured.variances, (count,), _LEAST_VARIANCE, _MOST_VARIANCE)
    _pair("origin", measured.origin, _FARTHEST_M)
    _pair("view", measured.view, _LARGEST_RAD)
    _number("half width of the view", measured.view[1], 0.0, _LARGEST_RAD)
    _number("lag", measured.lag, 0.0, _OLDEST_S)
    if (measured.ranges is None) != (measured.range_variances is None):
        raise _FaultError("of ranges and range_variances there is only one")
    if measured.ranges is not None and measured.range_variances is not None:
        _array("ranges", measured.ranges, (count,), 0.0, _FARTHEST_M)
        variances = measured.range_variances
        _array("range_variances", variances, (count,), _LEAST_VARIANCE, _MOST_VARIANCE)
    _identities(measured.identities, count)


@_inspect.register
def _(motion: Displacement) -> None:
    _number("time", motion.time, -_LATEST_S, _LATEST_S)
    _number("interval", motion.interval, 0.0, _LONGEST_S)
    _number("dx", motion.dx, -_FARTHEST_M, _FARTHEST_M)
    _number("dy", motion.dy, -_FARTHEST_M, _FARTHEST_M)
    _number("dpsi", motion.dpsi, -_LARGEST_RAD, _LARGEST_RAD)
    _number("translation_variance", motion.translation_variance, 0.0, _MOST_VARIANCE)
    _number("heading_variance", motion.heading_variance, 0.0, _MOST_HEADING_VARIANCE)


@_inspect.register
def _(heard: TeammateOdometry) -> None:
    _inspect(heard.step)


def _number(name: str, value: object, least: float, most: float) -> None:
    if isinstance(value, bool) or not isinstance(value, _NUMBERS):
        raise _FaultError(f"{name} is no number but {type(value).__name__}")
    if not least <= value <= most:  # so that nan is refused, too
        raise _FaultError(f"{name} is {value}, not within {least:g} to {most:g}")


def _pair(name: str, value: object, most: float) -> None:
    if not isinstance(value, tuple) or len(value) != 2:
        raise _FaultError(f"{name} is not a tuple of two numbers")
    for each in value:
        _number(name, each, -most, most)


def _length(name: str, values: object) -> int:
    if not isinstance(values, np.ndarray) or not values.ndim:
        raise _FaultError(f"{name} is not an array with one row a reading")
    return len(values)


def _array(
    name: str, values: object, shape: tuple[int, ...], least: float, most: float
) -> FloatArray:
    """The values as floats, once their shape and bounds are right."""
    if not isinstance(values, np.ndarray) or values.dtype.kind not in "fiu":
        raise _FaultError(f"{name} is not an array of numbers")
    if values.shape != shape:
        raise _FaultError(f"{name} has the shape {values.shape}, not {shape}")
    # Written so that nan, which compares false with everything, is refused, too.
    if values.size and not (values.min() >= least and values.max() <= most):
        outside = _first(values, lambda value: not least <= value <= most)
        raise _FaultError(f"{name} holds {outside}, not within {least:g} to {most:g}")
    return values


def _first(values: FloatArray, bad: Callable[[float], bool]) -> float:
    return next(float(value) for value in values.ravel() if bad(value))


def _covariances(values: object, count: int) -> None:
    matrices = _array("covariances", values, (count, 2, 2), -_MOST_VARIANCE, _MOST_VARIANCE)
    xx, xy, yx, yy = matrices.reshape(-1, 4).T
    trace = xx + yy
    small = np.minimum(xx, yy) < _LEAST_VARIANCE
    oblique = np.abs(xy - yx) > _SYMMETRIC * trace
    thin = xx * yy - xy * yx < _LEAST_SHAPE * trace * trace
    if not (small | oblique | thin).any():
        return
    if small.any():
        which = int(np.argmin(np.minimum(xx, yy)))
        raise _FaultError(
            f"the variances of reading {which} are not all at least {_LEAST_VARIANCE:g} m²"
        )
    if oblique.any():
        which = int(np.argmax(np.abs(xy - yx) / trace))
        raise _FaultError(f"the covariance of reading {which} is not symmetric")
    which = int(np.argmin((xx * yy - xy * yx) / trace**2))
    raise _FaultError(f"the covariance of reading {which} is not positive definite")


def _identities(values: object, count: int) -> None:
    if values is None:
        return
    if not isinstance(values, np.ndarray) or values.dtype.kind not in "iu":
        raise _FaultError("identities is not an array of whole numbers")
    if values.shape != (count,):
        raise _FaultError(f"identities has the shape {values.shape}, not {(count,)}")
