"""Statistics that more than one fit needs: robust spreads, errors that are correlated in time.

Errors near in time are alike. Where a formula takes them for independent, the sums of whole blocks
of time take the place of single errors: Liang and Zeger, Longitudinal data analysis using
generalized linear models, Biometrika 73 (1986), eq. 4 and the estimate below it.
"""

import math

import numpy as np

from host.messages import FloatArray, IntArray

_NORMAL_MEDIAN = 0.6745  # of |x| of a standard normal x: sqrt(2) erfinv(1/2)
_RAYLEIGH_MEDIAN = 1.1774  # of the length of a plane vector of two of these: sqrt(2 ln 2)


def check_rows(
    name: str, rows: FloatArray, shape: tuple[int, ...], least: float = -math.inf
) -> None:
    """Raise ValueError, as text, for rows of another shape, not finite, or less than `least`."""
    if np.shape(rows) != shape:
        raise ValueError(f"{name} are an array {shape}, not {np.shape(rows)}")
    wrong = ~(np.isfinite(rows) & (np.asarray(rows) >= least))
    if wrong.any():
        row = int(np.argwhere(wrong)[0, 0])
        bound = f", {least:g} or more," if least > -math.inf else ""
        raise ValueError(f"{name} are finite{bound} but row {row} is {rows[row]}")


def normal_sigma(errors: FloatArray) -> float:
    """Standard deviation of normal errors (n,), some of them outliers, by their median."""
    return float(np.median(np.abs(errors))) / _NORMAL_MEDIAN


def plane_sigma(lengths: FloatArray) -> float:
    """Standard deviation per axis of normal errors in the plane, by their lengths (n,)."""
    return float(np.median(lengths)) / _RAYLEIGH_MEDIAN


def blocks_of(times: FloatArray, seconds: float, group: IntArray | None = None) -> IntArray:
    """The block of time that each of `times` (n,) s is in, numbered from 0 without gaps.

    group (n,): of different groups, times are never in one block.
    """
    rows = np.zeros(len(times)) if group is None else group
    pairs = np.stack((rows, np.floor(times / seconds)))
    return np.unique(pairs, axis=1, return_inverse=True)[1].reshape(-1)


def block_sums(values: FloatArray, blocks: IntArray) -> FloatArray:
    """Sums (b, ...) of the values (n, ...) in each block."""
    sums = np.zeros((int(blocks.max(initial=-1)) + 1, *values.shape[1:]))
    np.add.at(sums, blocks, values)
    return sums


def bent_factor(count: float, fitted: float) -> float:
    """By how much the squares of `count` independent errors grow without the fit of `fitted`."""
    return count / max(count - fitted, 1.0)


def correlation_factor(
    times: FloatArray, scores: FloatArray, rows: FloatArray, inverse: FloatArray, seconds: float
) -> float:
    """By how much, 1 or more, sums over blocks of `seconds` scatter more than independent scores.

    scores (n, p), rows (n, a, p): of readings at `times` (n,) s; inverse (p, p): of their
    information. One number for all p values: a drive has too few blocks for a number of each. A
    fit follows the errors of what it rests on most, which takes from the scatter of each block and
    reading; that is made up for.
    """
    blocks = blocks_of(times - times[0], seconds)
    sums = block_sums(scores, blocks)
    shares = block_sums(np.einsum("nai,naj->nij", rows, rows), blocks) @ inverse
    each = rows @ inverse @ rows.swapaxes(1, 2)  # of a reading, in the plane of its errors
    together, alone = (
        np.einsum("bi,ij,bj->", parts, inverse, parts) / _left_by_fit(matrices)
        for parts, matrices in ((sums, shares), (scores, each))
    )
    return max(1.0, float(together) / max(float(alone), 1e-12))


def _left_by_fit(shares: FloatArray) -> float:
    """How much of the squared scores of parts a fit leaves; shares (b, k, k): of the information.

    With independent errors a part's scores have the covariance I_b - I_b I^-1 I_b.
    """
    whole, taken = np.einsum("bii->", shares), np.einsum("bij,bji->", shares, shares)
    return max(float(whole - taken), 1e-3)


def sandwich(bread: FloatArray, middle: FloatArray) -> FloatArray:
    """Covariance (p, p) of a fit whose scores scatter otherwise than its model says.

    White, Econometrica 48 (1980), eq. 5: bread is the inverse information (p, p), middle the sum
    of the scores' squares (p, p).
    """
    return np.asarray(bread @ middle @ bread)


def ratio_variance(counts: FloatArray, sizes: FloatArray, ratio: float, blocks: IntArray) -> float:
    """Variance of the estimate `ratio` = sum of counts (n,) / sum of sizes (n,).

    Cochran, Sampling Techniques (1977), eq. 2.39, with blocks for units.
    """
    left = block_sums(counts - ratio * sizes, blocks)
    return float(np.sum(left**2)) / float(sizes.sum()) ** 2


def pieces_of(times: FloatArray, count: int) -> IntArray:
    """Which of `count` pieces of equal size, in order of time, each of `times` (n,) is in."""
    order = np.argsort(np.argsort(times, kind="stable"), kind="stable")
    return np.asarray(order * count // max(len(times), 1))


def jackknife_sigma(estimates: FloatArray) -> FloatArray:
    """Standard deviations (...) by estimates (k, ...), each without another one of k pieces.

    Efron and Stein, The jackknife estimate of variance, Annals of Statistics 9 (1981), eq. 1.2.
    """
    return np.asarray(math.sqrt(len(estimates) - 1.0) * np.std(estimates, axis=0))


def smoothed(rows: FloatArray, kernel: FloatArray, drives: IntArray) -> FloatArray:
    """Sums (n, ...) over the rows (n, ...) around each, one k rows apart times kernel[k].

    drives (n,): rows of different ones are not summed.
    """
    total = kernel[0] * rows
    for lag in range(1, min(len(kernel), len(rows))):
        same = kernel[lag] * (drives[lag:] == drives[:-lag])
        same = same.reshape(-1, *[1] * (rows.ndim - 1))
        total[lag:] += same * rows[:-lag]
        total[:-lag] += same * rows[lag:]
    return np.asarray(total)


def bartlett(reach: int) -> FloatArray:
    """Bartlett's weights (reach,) of rows 0, 1, ... apart: they fall to 0 at `reach`."""
    return 1.0 - np.arange(reach) / reach
