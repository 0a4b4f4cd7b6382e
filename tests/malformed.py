"""Messages that cannot be what they claim to be: each kind, and each way to spoil it."""

import dataclasses
import math
from typing import Any

import numpy as np
from hypothesis import strategies as st

from host.messages import Bearings, Displacement, Positions, Scan

_NUMBERS = (math.nan, math.inf, -math.inf, 1e300, None, "0.1", [0.1], np.zeros(2))


def sound(time: float) -> list[Any]:
    """A message of each kind with every field filled in, all at `time` (s)."""
    return [
        Scan(time, time - np.array([0.1, 0.05, 0.0]), np.array([-1.0, 0.0, 1.0]), np.ones(3)),
        Positions(
            time,
            np.array([[1.0, 0.4], [-0.7, 0.2]]),
            np.tile(np.diag([1e-4, 2e-4]), (2, 1, 1)),
            np.array([0.05, 0.1]),
            np.full(360, 3.0),
            np.array([3, -1]),
            np.array([2.0, 4.0]),
        ),
        Bearings(
            time,
            np.array([0.3, -2.0]),
            np.full(2, 0.0076),
            (0.05, 0.0),
            0.1,
            np.array([3, -1]),
            (0.0, 1.6),
            np.array([1.1, 0.8]),
            np.full(2, 0.01),
        ),
        Displacement(time, 0.02, 0.006, 0.0, 0.001, 1e-6, 1e-7, (3, 4)),
    ]


def _spoilt_arrays(name: str, values: np.ndarray) -> list[Any]:
    """Arrays in place of sound ones: a bad entry, another shape, no numbers."""
    entries = [math.nan, -math.inf, -1e300]
    if name != "clearance":  # inf: nothing came back
        entries += [math.inf, 1e300]
    if name in {"variances", "range_variances", "covariances"}:
        entries += [0.0, -1e-4]
    if name in {"lags", "clearance", "ranges"}:
        entries.append(-0.1)
    spoilt: list[Any] = []
    for entry in entries if values.dtype.kind == "f" else ():
        bad = values.copy()
        bad.flat[0] = entry
        spoilt.append(bad)
    spoilt += [values[:-1], values[None]]
    return [*spoilt, values[..., None], values.astype(complex), values.tolist(), "none"]


def _spoilt_covariances() -> list[Any]:
    """Neither symmetric nor positive definite, in the second of two."""
    sound_one = np.diag([1e-4, 2e-4])
    bad = [[[1e-4, 1e-5], [0.0, 2e-4]], [[1e-4, 2e-4], [2e-4, 1e-4]], [[1e-4, 1e-4], [1e-4, 1e-4]]]
    return [np.stack((sound_one, np.array(each))) for each in [*bad, np.zeros((2, 2))]]


def _spoilt_values(name: str, value: Any) -> list[Any]:
    if isinstance(value, np.ndarray):
        return _spoilt_arrays(name, value) + (
            _spoilt_covariances() if name == "covariances" else []
        )
    if name in {"origin", "view"}:
        spoilt: list[Any] = [(0.0,), (math.nan, 1.0), (0.0, math.inf), None, np.zeros(2)]
        return spoilt + ([(0.0, -1.0)] if name == "view" else [])
    if name in {"interval", "lag", "translation_variance", "heading_variance"}:
        return [*_NUMBERS, -1e-3]
    return list(_NUMBERS)


_LEFT_AS_THEY_ARE = {"ticks", "camera", "pixels"}  # no filter reads them


def all_malformed(time: float) -> list[Any]:
    """Every sound message at `time` (s) with each of its fields spoilt in each way."""
    return [
        dataclasses.replace(message, **{field.name: bad})
        for message in sound(time)
        for field in dataclasses.fields(message)
        if field.name not in _LEFT_AS_THEY_ARE
        for bad in _spoilt_values(field.name, getattr(message, field.name))
    ]


def malformed(time: float) -> st.SearchStrategy[Any]:
    """One of them."""
    return st.sampled_from(all_malformed(time))
