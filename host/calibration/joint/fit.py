"""All sensors' evidence → all unknowns at once, with the covariance of all of them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from host.calibration.joint.sensors import Sensor
from host.calibration.robust.evidence import Evidence, Prior, covariance_of, inverse_of
from host.messages import FloatArray

_ROUNDS, _SETTLED = 12, 0.02  # at most; the largest step, in sigmas


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
