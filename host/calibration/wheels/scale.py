"""Whether the true path is drawn to scale, by the wheels' own lengths.

Against a true path whose distances are 5 % too large, both radii and the track come out 5 % larger
than they are. One length that is configured wrongly does not do that. So where all three are off by
one factor it is the truth's scale: of a ceiling camera the tags' size or a height, of a tracker the
wand that it was calibrated with. Or all three lengths are configured wrongly alike: a drive does
not show which.
"""

import math
from dataclasses import dataclass

import numpy as np

from host.calibration.result import Check, at_most
from host.calibration.wheels.model import GEOMETRY, values_of
from host.config import Mocap, Wheels
from host.messages import FloatArray

_MEASURED = np.array([0.015, 0.015, 0.02])  # std, relative, of radii and track measured by hand
_EFFECTIVE = np.array([2e-3, 2e-3, 4e-3])  # and of fitted ones, on another floor and path
_SIGMAS = 3.0
_UNLIKE = 9.0  # of chi² with two degrees of freedom


@dataclass(frozen=True, slots=True)
class Scale:
    """The truth's distances over those by the wheels as configured: factor and its std.

    unlike: chi² of three lengths that should be off by one factor.
    """

    factor: float
    sigma: float
    unlike: float

    @property
    def _alike(self) -> bool:
        return self.unlike < _UNLIKE

    def _words(self) -> str:
        off = 100.0 * (self.factor - 1.0)
        return (
            f"{abs(off):.1f} % {'larger' if off > 0.0 else 'smaller'} than the wheels' "
            f"(± {100.0 * self.sigma:.1f} %; both radii and the track alike, as far as they are "
            "known)"
        )

    def checks(self, mocap: Mocap) -> list[Check]:
        """That a ceiling camera's distances are those of the wheels: nothing else shows them."""
        if mocap.source != "ceiling" or not self._alike:
            return []
        bound = _SIGMAS * self.sigma
        off = abs(self.factor - 1.0)
        return [
            at_most("the ceiling camera's distances off the wheels'", off, bound, "%").otherwise(
                f"the ceiling camera's distances are {self._words()}: tag_m, tag_height_m or the "
                "camera's z_m in [mocap.ceiling] is wrong, or the radii and track_m in [wheels] "
                "are; measure the tag's black square and both heights, and the wheels, then fit "
                "lens and mounting again"
            )
        ]

    def warnings(self, mocap: Mocap) -> list[str]:
        """The same of a tracker, which has a scale of its own."""
        off = self._alike and abs(self.factor - 1.0) > _SIGMAS * self.sigma
        return [
            f"the true path's distances are {self._words()}: all three are configured wrongly, or "
            "the tracker's scale is, as by its calibration wand or the file's units"
        ] * (off and mocap.source != "ceiling")


def scale_of(
    values: FloatArray, covariance: FloatArray, wheels: Wheels, known: FloatArray | None = None
) -> Scale:
    """From what was fitted, values (v,) and covariance (v, v), and the wheels as configured.

    known (3, 3): covariance of the configured radii and track, if an earlier fit found them.
    """
    before = values_of(wheels, Mocap())[GEOMETRY]
    ratios = values[GEOMETRY] / before
    both = covariance[GEOMETRY, GEOMETRY] / np.outer(before, before)
    if known is not None and known.any():
        both = both + known / np.outer(before, before) + np.diag(_EFFECTIVE**2)
    else:
        both = both + np.diag(_MEASURED**2)
    weights = np.linalg.inv(both)
    total = float(weights.sum())
    factor = float(weights.sum(axis=0) @ ratios) / total
    off = ratios - factor
    return Scale(factor, math.sqrt(1.0 / total), float(off @ weights @ off))
