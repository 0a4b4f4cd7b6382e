"""One body as a tracker saw it in space, whichever tracker it was."""

from dataclasses import dataclass

import numpy as np

from host.messages import FloatArray

_NORM_TOLERANCE = 0.1  # of a quaternion


@dataclass(frozen=True, slots=True)
class PosedBody:
    """times (n,) s by the tracker's clock, ascending; positions (n, 3) m and quaternions (n, 4)
    x, y, z, w, finite, in the tracker's frame."""

    name: str
    times: FloatArray
    positions: FloatArray
    quaternions: FloatArray


def posed_body(
    name: str, times: FloatArray, positions: FloatArray, quaternions: FloatArray
) -> PosedBody:
    """Rows that are no pose, as where the body was lost, are left out, and the rest is sorted."""
    table = np.column_stack((times, positions, quaternions))
    norms = np.linalg.norm(table[:, 4:], axis=1)
    table = table[np.isfinite(table).all(axis=1) & (np.abs(norms - 1.0) < _NORM_TOLERANCE)]
    times, first = np.unique(table[:, 0], return_index=True)
    return PosedBody(name, times, table[first, 1:4], table[first, 4:])
