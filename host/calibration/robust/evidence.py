"""What readings say about unknowns, as normal equations, and how well these are then known.

A sensor fitted by itself and sensors fitted together are weighed alike.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from host.calibration.robust.statistics import bent_factor, correlation_factor, sandwich
from host.errors import UserError
from host.messages import BoolArray, FloatArray

_SINGULAR, _RANK = 1e-10, 1e-9


@dataclass(frozen=True, slots=True)
class Evidence:
    """Of one sensor, near some values of all unknowns: what normal equations are made of.

    information (p, p), and gradient (p,) of half the sum of squares. scatter (p, p): covariance of
    that gradient, for errors that are correlated in time. common (p, c): what one standard
    deviation of each error that all readings have in common changes in the gradient.
    """

    information: FloatArray
    gradient: FloatArray
    scatter: FloatArray
    common: FloatArray


@dataclass(frozen=True, slots=True)
class Prior:
    """What is known beforehand: mean (p,) and information (p, p). free (p,): what is fitted."""

    mean: FloatArray
    information: FloatArray
    free: BoolArray


def correlated(
    times: FloatArray,
    scores: FloatArray,
    rows: FloatArray,
    seconds: float,
    common: FloatArray | None = None,
    bends: FloatArray | float = 0.0,
) -> Evidence:
    """Evidence of readings at `times` (n,) s, worth less by what their errors are correlated.

    scores (n, p) and rows (n, 2, p): weighted, of their errors. Those in one block of `seconds` are
    not independent. bends (p, p): what the information has besides, as weights change with the
    errors.
    """
    plain = np.einsum("nai,naj->ij", rows, rows)
    # Pixels beside radians: to one scale. The body's pose and a sensor's own are one, seen so.
    size = np.where(np.diag(plain) > 0.0, np.sqrt(np.diag(plain)), 1.0)
    scaled = plain / np.outer(size, size)
    inverse = np.linalg.pinv(scaled, _SINGULAR, hermitian=True)
    factor = correlation_factor(times, scores / size, rows / size, inverse, seconds)
    fitted = float(np.linalg.matrix_rank(scaled, _RANK, hermitian=True))
    scatter = bent_factor(2.0 * len(scores), fitted) * scores.T @ scores
    alike = np.zeros((len(plain), 0)) if common is None else common
    # Far from the least squares, what trust is lost by moving can outweigh what is gained.
    information = plain + bends if _is_convex(plain + bends) else plain
    return Evidence(
        information / factor, scores.sum(axis=0) / factor, scatter / factor, alike / factor
    )


def _is_convex(information: FloatArray) -> bool:
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    return bool(np.linalg.eigvalsh(information / np.outer(size, size))[0] > -_SINGULAR)


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
