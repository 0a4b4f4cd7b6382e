"""All sensors' evidence → all unknowns at once, with the covariance of all of them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from host.calibration.joint.sensors import Evidence, Sensor
from host.calibration.robust.statistics import sandwich
from host.errors import UserError
from host.messages import BoolArray, FloatArray

_ROUNDS, _SETTLED = 12, 0.02  # at most; the largest step, in sigmas


@dataclass(frozen=True, slots=True)
class Prior:
    """What is known beforehand: mean (p,) and information (p, p). free (p,): what is fitted."""

    mean: FloatArray
    information: FloatArray
    free: BoolArray


@dataclass(frozen=True, slots=True)
class Solution:
    """Values (p,), their covariance (p, p), and the last step, in sigmas. evidence: at the values.

    What is not free has a covariance of 0.
    """

    values: FloatArray
    covariance: FloatArray
    last_step: float
    evidence: tuple[Evidence, ...]


def solve(sensors: Sequence[Sensor], prior: Prior, start: FloatArray) -> Solution:
    """Gauss-Newton from values (p,) near by; what a sensor trusts is decided again at each step.

    The covariance is a sandwich: sensors' errors are independent of each other's, and each
    sensor's scatter as its evidence says. Raises UserError where readings do not separate values.
    """
    values, last = start.copy(), np.inf
    for _ in range(_ROUNDS):
        evidence = tuple(sensor.evidence(values) for sensor in sensors)
        if last < _SETTLED:
            break
        inverse = inverse_of(evidence, prior)
        gradient = prior.information @ (values - prior.mean)
        step = inverse @ (gradient + sum(part.gradient for part in evidence))
        last = float(np.max(np.abs(step[prior.free]) / np.sqrt(np.diag(inverse)[prior.free])))
        values = values - step
    return Solution(values, covariance_of(evidence, prior), last, evidence)


def inverse_of(evidence: Sequence[Evidence], prior: Prior) -> FloatArray:
    """Inverse (p, p) of the information of sensors and prior; 0 for what is not free."""
    free = np.ix_(prior.free, prior.free)
    whole = (prior.information + sum(part.information for part in evidence))[free]
    # Pixels beside radians: to one scale first.
    size = np.sqrt(np.diag(whole))
    found = np.zeros_like(prior.information)
    try:
        found[free] = np.linalg.inv(whole / np.outer(size, size)) / np.outer(size, size)
    except np.linalg.LinAlgError as error:
        raise UserError(
            "the sensors cannot be fitted together",
            "in this drive, some of their values are the same thing",
            "drive curves both ways at changing speed, with teammates all around",
        ) from error
    return found


def covariance_of(evidence: Sequence[Evidence], prior: Prior) -> FloatArray:
    """Covariance (p, p) of the fitted values."""
    inverse = inverse_of(evidence, prior)
    scatter = prior.information + sum(part.scatter for part in evidence)
    covariance = sandwich(inverse, scatter)
    for part in evidence:
        moved = inverse @ part.common
        covariance += moved @ moved.T
    return np.asarray(covariance)
