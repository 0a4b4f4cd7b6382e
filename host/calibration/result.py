"""What every calibration gives: fitted numbers, what of them passes, and what to draw of them."""

import math
from dataclasses import dataclass, field
from typing import Any, Literal

from host.messages import FloatArray

_APART_SIGMAS, _APART_LIMITS = 6.0, 2.0  # beyond both, the halves of the data tell two stories


@dataclass(frozen=True, slots=True, kw_only=True)
class Fitted:
    """One number of the robot as it was fitted: a row of the report. SI units.

    key: its name in robot.toml, as "lidar.heading_rad"; "" for what is told but not written.
    sigma: standard deviation, nan where unknown. limit: the largest sigma that will do, None: any.
    before: what was configured. halves: the same, fitted on each half of the data alone.
    On the screen it is value * scale in `unit`.
    """

    key: str
    name: str
    value: float
    sigma: float
    limit: float | None = None
    before: float | None = None
    halves: tuple[float, float] | None = None
    unit: str = ""
    scale: float = 1.0

    @property
    def failure(self) -> str:
        """Why it does not pass, in words; "" where it does."""
        if self.limit is None:
            return ""
        if not math.isfinite(self.sigma):
            return f"{self.name} cannot be told from this drive"
        if self.sigma > self.limit:
            return (
                f"{self.name} is known to {self.shown(self.sigma)} only, "
                f"not to {self.shown(self.limit)}"
            )
        if self.halves is not None:
            apart = abs(self.halves[0] - self.halves[1])
            if apart > max(_APART_SIGMAS * self.sigma, _APART_LIMITS * self.limit):
                return f"the two halves of the data differ by {self.shown(apart)} in {self.name}"
        return ""

    def shown(self, value: float) -> str:
        """A value of this row (SI) as the screen has it."""
        return f"{value * self.scale:.4g} {self.unit}".rstrip()


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """A condition on the data or on the fit as a whole.

    value and threshold in `unit`, as the screen has them. advice: what to do where it fails.
    """

    name: str
    value: float
    threshold: float
    unit: str
    passed: bool
    advice: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Series:
    """Points of a picture, x (n,) and y (n,); drawn one by one, joined, or as bars."""

    x: FloatArray
    y: FloatArray
    label: str = ""
    style: Literal["points", "line", "bars"] = "points"


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportPicture:
    """A diagram of the report. caption: what one sees in it. equal: both axes to one scale."""

    title: str
    x_label: str
    y_label: str
    series: tuple[Series, ...]
    caption: str = ""
    equal: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """A fit with its verdict.

    kind: "wheels", "lidar", ... settings: further values for robot.toml by key (lists of tables
    as lists of dicts), beside those of `fitted` that have a key. residuals: in words, as "rms
    2.1 mm over 812 pairs, 71 % of them used". warnings: what to beware of though it may pass.
    figures: more for --json.
    """

    kind: str
    fitted: tuple[Fitted, ...]
    checks: tuple[Check, ...]
    residuals: str
    pictures: tuple[ReportPicture, ...] = ()
    warnings: tuple[str, ...] = ()
    settings: dict[str, Any] = field(default_factory=dict)
    figures: dict[str, Any] = field(default_factory=dict)

    @property
    def failures(self) -> list[str]:
        """Why the fit is not to be used, in words, with what to do; empty where it is."""
        failed = [f"{check.name}: {check.advice}" for check in self.checks if not check.passed]
        return failed + [row.failure for row in self.fitted if row.failure]

    def new_settings(self) -> dict[str, Any]:
        """Every value for robot.toml by its key."""
        rows = {row.key: row.value for row in self.fitted if row.key and math.isfinite(row.value)}
        return {**rows, **self.settings}
