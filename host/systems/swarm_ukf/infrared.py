"""Range from the strength of an infra-red return (Miller 2019, section II-A, eq. 1).

Strength falls with a power of the distance that is fitted, near the inverse square. Near by the
receiver saturates: such a return says that a robot is nearer than `nearest_m`, and no more.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import curve_fit

from host.errors import UserError
from host.messages import FloatArray

_LINEAR_SHARE = 0.8  # of the strongest return; above it the receiver begins to saturate
_LEAST_ROWS = 5
_TYPICAL = (0.3, -0.5)  # m at strength 1, exponent


@dataclass(frozen=True, slots=True)
class InfraredRange:
    """range = scale_m * strength ** exponent up to the strength `saturation`; rms_m: of the fit."""

    scale_m: float
    exponent: float
    saturation: float
    rms_m: float

    @property
    def nearest_m(self) -> float:
        """What can be measured at least, m."""
        return float(self.scale_m * self.saturation**self.exponent)

    def ranges(self, strengths: FloatArray) -> FloatArray:
        """(n,) m of strengths (n,); NaN where the receiver saturates or nothing came back."""
        known = (strengths > 0.0) & (strengths <= self.saturation)
        safe = np.where(known, strengths, 1.0)
        return np.where(known, self.scale_m * safe**self.exponent, np.nan)


def fit_infrared(distances: FloatArray, strengths: FloatArray) -> InfraredRange:
    """Fit returns (n,) measured at distances (n,) m. Raises UserError for too few usable ones."""
    saturation = _LINEAR_SHARE * float(np.max(strengths, initial=0.0))
    used = (strengths > 0.0) & (strengths <= saturation) & (distances > 0.0)
    if used.sum() < _LEAST_ROWS:
        raise UserError(
            f"{int(used.sum())} returns are too few for the range model",
            f"it takes {_LEAST_ROWS} below {_LINEAR_SHARE:.0%} of the strongest, where the "
            "receiver does not saturate",
            "measure at more distances, 30 cm to 1 m apart",
        )

    def law(strength: FloatArray, scale: float, exponent: float) -> FloatArray:
        return np.asarray(scale * strength**exponent)

    (scale, exponent), _ = curve_fit(law, strengths[used], distances[used], p0=_TYPICAL)
    left = law(strengths[used], scale, exponent) - distances[used]
    rms = float(np.sqrt(np.mean(left**2)))
    return InfraredRange(float(scale), float(exponent), saturation, rms)


def read_infrared(path: Path) -> tuple[FloatArray, FloatArray]:
    """Distances (n,) m and strengths (n,) of a table "distance in cm, strength" with one header.

    Rows without numbers are left out. Raises UserError where the file cannot be read.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()[1:]
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"cannot read {path}", str(error), "give a table of text") from error
    rows = [[cell.strip() for cell in line.split(",")] for line in lines]
    numbers = np.array(
        [[float(cell) for cell in row[:2]] for row in rows if len(row) > 1 and all(row[:2])]
    ).reshape(-1, 2)
    return numbers[:, 0] / 100.0, numbers[:, 1]
