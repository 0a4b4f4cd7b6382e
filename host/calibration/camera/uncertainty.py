"""How well cameras are known by a fit, with what repeating the drive does not show."""

import math

import numpy as np

from host.calibration.camera.model import NAMES, Pairs, errors, rotated, row_of, slopes, upward
from host.calibration.camera.noise import Noise, Whitening
from host.calibration.camera.pairs import CAMERAS
from host.calibration.robust.evidence import Evidence, Prior, correlated
from host.calibration.robust.evidence import covariance_of as robust_covariance
from host.messages import BoolArray, FloatArray

# Std of what repeating does not show: by how much all strips are found too low or too high, and how
# far off their middles are taken to be (in rendered pictures less than 0.1 px and 0.2 mm); which
# instant of an exposure is the picture's.
_LOW_PX, _STRIP_M, _STAMP_S = 0.1, 2e-4, 1e-4
# Light from one side moves a strip's middle to that side. In rendered pictures the error depends on
# the direction of view as two waves around the room of 0.11 px amplitude each: of each one's sine
# and cosine, the std.
_LIGHT_PX, _LIGHT_WAVES = 0.08, (1.0, 2.0)
_BLOCK_S = 2.0  # errors nearer in time are not independent


def covariance_of(
    prior: FloatArray,
    values: FloatArray,
    pairs: Pairs,
    used: BoolArray,
    noise: Noise,
    free: BoolArray,
) -> FloatArray:
    """Covariance (23, 23) of the values (23,) that were fitted to the pairs `used` (n,).

    prior (23, 23): diagonal, what those that are not `free` (23,) keep. noise: of the pairs.
    """
    information = np.diag(np.where(free, 1.0 / np.maximum(np.diag(prior), 1e-300), 0.0))
    said = evidence_of(values, pairs, used, noise, slopes(values, pairs)[used] * free)
    found = robust_covariance([said], Prior(values, information, free))
    kept = prior * ~free
    return np.asarray(found + kept + unseen(values, free))


def evidence_of(
    values: FloatArray, pairs: Pairs, used: BoolArray, noise: Noise, rows: FloatArray
) -> Evidence:
    """What the pairs `used` (n,) say about unknowns; rows (k, 2, p): of these, derivatives by them.

    values (23,): of the cameras.
    """
    independent = Whitening(values, pairs, used, noise)
    rows, off = independent(rows), independent(errors(values, pairs)[used])
    # What is wrong alike in all pictures moves the fit as a whole.
    common = np.einsum("nij,nic->jc", rows, independent(common_errors(values, pairs)[used]))
    scores = np.einsum("nij,ni->nj", rows, off)
    return correlated(pairs.strips.times[used], scores, rows, _BLOCK_S, common)


def common_errors(values: FloatArray, pairs: Pairs) -> FloatArray:
    """What strips' errors (n, 2, 5) px may have in common all along a drive, one std of each.

    All too high; and aside by light, which depends on where in the room a camera looks.
    """
    around = pairs.headings + np.arctan2(pairs.points[:, 1], pairs.points[:, 0])
    waves = [wave(times * around) for times in _LIGHT_WAVES for wave in (np.cos, np.sin)]
    aside = rotated(values, pairs)
    aside /= np.maximum(np.hypot(*aside.T), 1e-12)[:, None]
    lit = _LIGHT_PX * aside[:, :, None] * np.stack(waves, axis=1)[:, None]
    return np.concatenate((_LOW_PX * upward(values, pairs)[:, :, None], lit), axis=2)


def unseen(values: FloatArray, free: BoolArray) -> FloatArray:
    """The part of the covariance (23, 23) from the strips' true middles and the time stamps.

    If it is higher, a camera is; if it is farther away, a camera is farther back.
    """
    moved = np.zeros((len(values), 2 * len(CAMERAS)))
    for number in range(len(CAMERAS)):
        heading = float(row_of(values, number)[NAMES.index("heading_rad")])
        at = len(NAMES) * number + np.array([NAMES.index(name) for name in ("x_m", "y_m", "z_m")])
        moved[at[:2], 2 * number] = math.cos(heading), math.sin(heading)
        moved[at[2], 2 * number + 1] = 1.0
    moved[~free] = 0.0
    found = _STRIP_M**2 * moved @ moved.T
    found[-1, -1] += _STAMP_S**2
    return np.asarray(found)
