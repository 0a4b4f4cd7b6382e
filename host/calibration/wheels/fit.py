"""Wheel ticks and a true path → radii, track, lag, and how the tracked body sits on the robot.

Odometry drifts, so it is compared over windows of two seconds: how the tracked body moved from the
start of a window to its end, by the wheels and in truth. Longer windows mostly hold what slip has
added up, shorter ones the timing of single readings. With the drift of the clocks fitted too,
windows of 2 to 8 s gave the same geometry on recorded runs of a real robot; without it short ones
took lateness for a wider track.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.optimize import least_squares, nnls

from host.calibration.robust.statistics import (
    bartlett,
    bent_factor,
    normal_sigma,
    sandwich,
    smoothed,
)
from host.calibration.wheels.model import (
    BODY,
    GEOMETRY,
    Drive,
    Windows,
    at_ends,
    misses,
    path,
    relative,
    windows_of,
)
from host.messages import BoolArray, FloatArray

WINDOW_S, STRIDE_S = 2.0, 0.25
_REACH_S = 8.0  # errors this far apart are uncorrelated
OWN = STRIDE_S / WINDOW_S  # the share of a window that it has not from its neighbours

_STEPS = np.array([1e-3, 1e-3, 5e-3, 0.01, 0.01, 0.02])  # changes that count; the first three ...
# How far values may be from what is configured: a prior for what is not observable.
_PRIOR = np.array([0.1, 0.1, 0.2, 0.3, 0.3, 3.0])  # ... are relative, here too
_LAG_STEP_S, _LAG_PRIOR_S = 0.02, 0.2
_ROUGH = np.array([0.02, 0.02, 0.03])  # noise of a window before it is known: m, m, rad
NOISE_FLOOR = np.array([5e-4, 5e-4, 1e-3])  # of a window: that of motion capture alone
_SOFT, OUTLIER = 2.0, 5.0  # sigmas: trusted less from here on, left out from here on

_Loss = Literal["linear", "soft_l1"]


@dataclass(frozen=True, slots=True)
class Fit:
    """Values (v,) as in `model.values_of`, their covariance (v, v), and the rest.

    counts: ticks per revolution of a wheel. residuals (w, 3) of `windows` as in `misses`, and
    their standard deviations, sigmas (w, 3). used (w,): the windows that the fit rests upon.
    """

    counts: int
    values: FloatArray
    covariance: FloatArray
    windows: Windows
    residuals: FloatArray
    sigmas: FloatArray
    used: BoolArray


def rough_start(drives: Sequence[Drive], counts: int, configured: FloatArray) -> FloatArray | None:
    """Values in closed form, whatever the body's mounting; None where hardly anything moved.

    The rotation of the body is linear in the ways of both wheels; with the path that follows,
    the body's way is linear in its mounting, rotated and scaled. What is not observable is as
    `configured`. The radius of a wheel that counts backwards comes out negative.
    """
    windows = windows_of(drives, WINDOW_S, STRIDE_S)
    windows = windows.where(windows.moving)
    if len(windows) < 4:
        return None
    x, y, rotation = windows.moved.T
    no_lags = np.zeros((len(drives), 2))
    metres = 2.0 * math.pi / counts * configured[:2] * (-1.0, 1.0)
    first, last = at_ends(drives, [drive.ticks * metres for drive in drives], windows, no_lags)
    ways = last - first
    usual = np.full(2, 1.0 / configured[2])
    per_way = usual + _solve(ways, rotation - ways @ usual, 0.05 / usual[0])
    per_way = np.where(np.abs(per_way) < 1e-3 * usual, usual, per_way)
    # Radii and track are known up to one common factor now.
    shape = configured.copy()
    shape[:2] *= per_way * configured[2]
    c, s = 1.0 - np.cos(rotation), np.sin(rotation)
    along = np.stack((x, -y, c, s), axis=1), np.stack((y, x, -s, c), axis=1)
    paths = [path(drive, counts, shape) for drive in drives]
    by_wheels = relative(*at_ends(drives, paths, windows, no_lags))
    a, b, px, py = _solve(np.concatenate(along), by_wheels[:, :2].T.ravel(), 0.05)
    scale = 1.0 / math.hypot(a, b)
    shape[GEOMETRY] *= scale
    shape[BODY] = scale * px, scale * py, math.atan2(b, a)
    return shape


def _solve(design: FloatArray, target: FloatArray, hold: float) -> FloatArray:
    """Least squares (k,), held to zero a little, without the fifth that fits worst; thrice."""
    chosen = np.full(len(target), True)
    for _ in range(3):
        rows = np.concatenate((design[chosen], hold * np.eye(design.shape[1])))
        values = np.concatenate((target[chosen], np.zeros(design.shape[1])))
        found = np.linalg.lstsq(rows, values, rcond=None)[0]
        error = np.abs(design @ found - target)
        chosen = error <= np.quantile(error, 0.8)
    return np.asarray(found)


def fit(
    drives: Sequence[Drive], counts: int, start: FloatArray, configured: FloatArray
) -> Fit | None:
    """Fit from values (v,) near by. None where hardly any window holds motion.

    First all windows, trusting far ones less; then without those that miss by more than 5
    standard deviations (slip, a push, a body taken for another) least squares.
    """
    windows = windows_of(drives, WINDOW_S, STRIDE_S)
    used = windows.moving
    if np.count_nonzero(used) < 2:
        return None
    problem = WheelProblem(drives, counts, windows, configured)
    x, y, rotation = windows.moved.T
    exposure = np.stack((np.ones(len(windows)), np.hypot(x, y), np.abs(rotation)), axis=1)
    values, sigmas = start, np.tile(_ROUGH, (len(windows), 1))
    for _ in range(2):
        values = problem.solve(values, sigmas, used, "soft_l1")
        wrong = misses(drives, counts, values, windows)
        sigmas = _spread(wrong, exposure, used)
    used = used & (np.abs(wrong) <= OUTLIER * sigmas).all(axis=1)
    values = problem.solve(values, sigmas, used, "linear")
    wrong = misses(drives, counts, values, windows)
    covariance = problem.covariance(values, wrong, sigmas, used)
    return Fit(counts, values, covariance, windows, wrong, sigmas, used)


def _spread(wrong: FloatArray, exposure: FloatArray, used: BoolArray) -> FloatArray:
    """Standard deviation (w, 3) of what windows miss: its square grows with way and rotation.

    exposure (w, 3): one, way, rotation. Robust: squares count up to 9 times what is expected.
    """
    sigmas = np.zeros_like(wrong)
    for k, least in enumerate(NOISE_FLOOR):
        squares = wrong[:, k] ** 2
        variance = np.full(len(wrong), max(normal_sigma(wrong[used, k]) ** 2, least**2))
        for _ in range(3):
            expected = variance[used]
            target = np.minimum(squares[used], 9.0 * expected) / expected
            growth, _ = nnls(exposure[used] / expected[:, None], target)
            variance = np.maximum(exposure @ growth, least**2)
        sigmas[:, k] = np.sqrt(variance)
    return sigmas


class WheelProblem:
    """Least squares over windows, with a weak hold on what is configured.

    held (v,): the information of that hold.
    """

    def __init__(
        self, drives: Sequence[Drive], counts: int, windows: Windows, configured: FloatArray
    ) -> None:
        self._drives, self._counts, self._windows = drives, counts, windows
        self._configured = configured
        unit = np.concatenate((configured[GEOMETRY], np.ones(3)))
        lags = np.ones(2 * len(drives))
        self._steps = np.concatenate((_STEPS * unit, _LAG_STEP_S * lags))
        self._prior = np.concatenate((_PRIOR * unit, _LAG_PRIOR_S * lags))
        self.held = self._prior**-2.0

    def solve(
        self, start: FloatArray, sigmas: FloatArray, used: BoolArray, loss: _Loss
    ) -> FloatArray:
        """The best values (v,). sigmas (w, 3): of windows' residuals. used (w,)."""
        share = math.sqrt(OWN)
        chosen = self._windows.where(used)

        def weighted(steps: FloatArray) -> FloatArray:
            values = start + steps * self._steps
            wrong = misses(self._drives, self._counts, values, chosen)
            held = (values - self._configured) / self._prior
            return np.concatenate(((share * wrong / sigmas[used]).ravel(), held))

        found = least_squares(
            weighted,
            np.zeros(len(start)),
            loss=loss,
            f_scale=_SOFT * share,
            diff_step=np.full(len(start), 1e-4),
            ftol=1e-6,
            xtol=1e-4,
            max_nfev=20,
        )
        return np.asarray(start + found.x * self._steps)

    def covariance(
        self, values: FloatArray, wrong: FloatArray, sigmas: FloatArray, used: BoolArray
    ) -> FloatArray:
        """Covariance (v, v) where the errors of neighbouring windows are correlated."""
        slopes = self.slopes(values, sigmas, used)
        middle = self.scatter(slopes, wrong / sigmas)
        held = np.diag(self.held)
        bread = np.linalg.inv(OWN * np.einsum("wij,wik->jk", slopes, slopes) + held)
        return sandwich(bread, OWN**2 * middle + held)

    def slopes(self, values: FloatArray, sigmas: FloatArray, used: BoolArray) -> FloatArray:
        """Derivatives (w, 3, v) of the windows' misses over their sigmas; 0 of unused ones."""
        slopes = np.zeros((len(used), 3, len(values)))
        for k in range(len(values)):
            step = np.zeros(len(values))
            step[k] = 1e-2 * self._steps[k]
            above = misses(self._drives, self._counts, values + step, self._windows)
            below = misses(self._drives, self._counts, values - step, self._windows)
            slopes[:, :, k] = (above - below) / (2.0 * step[k])
        slopes /= sigmas[:, :, None]
        slopes[~used] = 0.0
        return slopes

    def scatter(self, slopes: FloatArray, wrong: FloatArray) -> FloatArray:
        """How sums of the scores of all windows scatter, (v, v). wrong (w, 3): over sigmas.

        Newey and West, Econometrica 55 (1987), eq. 5, with Bartlett's weights; what these and the
        fit take away of the scatter of windows that merely overlap is made up for. A drive has few
        independent errors, 1.5 a reach (Priestley, Spectral Analysis (1981), table 6.2): what is
        estimated with their scatter is as wide as Student's t.
        """
        scores = np.einsum("wij,wi->wj", slopes, wrong)
        reach = round(_REACH_S / STRIDE_S)
        middle = scores.T @ smoothed(scores, bartlett(reach), self._windows.drives)
        independent = 1.5 * np.count_nonzero(scores.any(axis=1)) / reach
        student = bent_factor(independent, 2.0)
        return np.asarray(middle * student / self._kept(slopes, bartlett(reach)))

    def _kept(self, slopes: FloatArray, kernel: FloatArray) -> float:
        """The share of their scatter that is found of windows which merely overlap.

        Of residuals r = (1 - P) e, P = U B U' with slopes U and inverse information B, where the
        errors e are alike as their windows overlap: E[r r'] in place of r r'.
        """
        drives = self._windows.drives
        overlap = bartlett(round(WINDOW_S / STRIDE_S))
        overlap = np.pad(overlap, (0, len(kernel) - len(overlap)))
        spread = smoothed(slopes, overlap, drives)
        both = smoothed(slopes, overlap * kernel, drives)
        squares = np.einsum("wij,wik->wjk", slopes, slopes)
        crosses = np.einsum("wij,wik->wjk", slopes, spread)
        inverse = np.linalg.inv(OWN * squares.sum(axis=0) + np.diag(self.held))
        share, true = OWN * inverse, crosses.sum(axis=0)
        lost = np.einsum("wij,jk,wlk->il", squares, share, smoothed(crosses, kernel, drives))
        twice = share @ true @ share
        found = np.einsum("wij,wik->jk", slopes, both) - lost - lost.T
        found += np.einsum("wij,jk,wkl->il", squares, twice, smoothed(squares, kernel, drives))
        return float(np.trace(inverse @ found) / np.trace(inverse @ true))


def lags_of(drive: Drive, counts: int, values: FloatArray) -> FloatArray:
    """By how much (2,) s the stamps of a drive's ticks are late at its ends, by given geometry.

    From the headings alone: on the straight, ticks that come ever later look like a smaller wheel.
    """
    windows = windows_of([drive], WINDOW_S, STRIDE_S)
    windows = windows.where(windows.moving)
    if len(windows) < 4:
        return np.zeros(2)

    def weighted(lags: FloatArray) -> FloatArray:
        wrong = misses([drive], counts, np.concatenate((values[:6], lags)), windows)[:, 2]
        return np.concatenate((math.sqrt(OWN) * wrong / _ROUGH[2], lags / _LAG_PRIOR_S))

    found = least_squares(weighted, np.zeros(2), loss="soft_l1", diff_step=np.full(2, 1e-3))
    return np.asarray(found.x)
