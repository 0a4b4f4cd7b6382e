"""What every calibration gives: fitted numbers, what of them passes, and what to draw of them."""

import dataclasses
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

from host.messages import FloatArray

_APART_SIGMAS, _APART_LIMITS = 6.0, 2.0  # beyond both, the halves of the data disagree
_MUCH_LONGER = 20.0  # times
_MOST_POINTS = 2000  # of a series
_DRIVEN = "straight on, in wide and narrow curves both ways, at more than one speed"
_AROUND = "with teammates near and far, all around, while the robot rotates both ways"
_SURER = {  # how to record, for smaller sigmas of each kind of calibration
    "wheels": _DRIVEN,
    "lidar": f"{_AROUND}; begin with `swarmloc calibrate wheels`, whose sigmas the lidar's contain",
    "detection": _AROUND,
    "joint": f"{_DRIVEN}, {_AROUND}",
}
SCREEN_UNITS = {"deg": 180.0 / math.pi, "mm": 1e3, "cm": 1e2, "ms": 1e3, "%": 1e2}
"""How many of a unit of the screen make one SI unit; units that are not here are SI."""


def distinct(value: float, bound: float) -> str:
    """A value in four digits, or in as many more as show that it is not its bound."""
    shown = (f"{value:.{digits}g}" for digits in range(4, 18))
    return next((text for text in shown if text != f"{bound:.4g}"), f"{value}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Fitted:
    """One number of the robot as it was fitted: a row of the report. SI units.

    key: its name in robot.toml, as "lidar.heading_rad"; "" for what is shown but not written.
    sigma: standard deviation, nan where unknown. limit: the largest sigma that will do; None: any,
    and then `unbounded` says why. before: what was configured. halves: the same, fitted on each
    half of the data alone. unit: on the screen. Raises ValueError where neither limit nor why.
    """

    key: str
    name: str
    value: float
    sigma: float
    limit: float | None = None
    unbounded: str = ""
    before: float | None = None
    halves: tuple[float, float] | None = None
    unit: str = ""

    def __post_init__(self) -> None:
        if (self.limit is None) != bool(self.unbounded):
            raise ValueError(f"{self.name}: give a limit, or say why there is none")

    @property
    def scale(self) -> float:
        """What values are multiplied by on the screen."""
        return SCREEN_UNITS.get(self.unit, 1.0)

    @property
    def failure(self) -> str:
        """Why it does not pass, as text; "" where it does."""
        if self.limit is None:
            return ""
        if not math.isfinite(self.sigma):
            return f"{self.name} is not observable in this drive"
        if self.sigma > self.limit:
            known = distinct(self.sigma * self.scale, self.limit * self.scale)
            return (
                f"{self.name} is known to {f'{known} {self.unit}'.rstrip()} only, "
                f"not to {self.shown(self.limit)}"
            )
        if self.halves is not None:
            apart = abs(self.halves[0] - self.halves[1])
            if apart > max(_APART_SIGMAS * self.sigma, _APART_LIMITS * self.limit):
                return f"the two halves of the data differ by {self.shown(apart)} in {self.name}"
        return ""

    @property
    def next_step(self) -> str:
        """What to do where it does not pass: sigma falls with the root of the time recorded.

        Much longer is no advice: what shows the value is hardly in the drive.
        """
        longer = (self.sigma / self.limit) ** 2 if self.limit else math.nan
        if not longer < math.inf:
            return "record again"
        if longer > _MUCH_LONGER:
            return "this drive hardly shows it: record again"
        if longer <= 1.0:  # the halves disagree
            return "see that nothing is loose, slips or is pushed, and record again"
        return f"record about {max(longer, 1.1):.2g} times as long"

    def shown(self, value: float) -> str:
        """A value of this row (SI) as text, with its unit; rounding errors of zero are 0."""
        return f"{round(value * self.scale, 9):.4g} {self.unit}".rstrip()


class Quantity(NamedTuple):
    """What a row of the report is of: see `Fitted` for key, name and unit.

    limit: the largest sigma that will do, or why any will.
    """

    key: str
    name: str
    unit: str
    limit: float | str

    def row(
        self,
        value: float,
        sigma: float,
        before: float | None = None,
        halves: Sequence[float] = (),
    ) -> Fitted:
        """It as fitted; halves: two, or none (also where one of them is not a number)."""
        pair = (float(halves[0]), float(halves[1])) if len(halves) else (math.nan, math.nan)
        return Fitted(
            key=self.key,
            name=self.name,
            value=float(value),
            sigma=float(sigma),
            limit=None if isinstance(self.limit, str) else self.limit,
            unbounded=self.limit if isinstance(self.limit, str) else "",
            before=None if before is None else float(before),
            halves=pair if math.isfinite(sum(pair)) else None,
            unit=self.unit,
        )


@dataclass(frozen=True, slots=True)
class Condition:
    """A condition on the data or on the fit as a whole; made by `at_least` or `at_most`.

    value and threshold in `unit`, as the screen has them. side: of the threshold, on which the
    value must be. A value that is not a number fails.
    """

    name: str
    value: float
    side: Literal["at least", "at most"]
    threshold: float
    unit: str

    @property
    def passed(self) -> bool:
        """Whether the value keeps to its threshold."""
        if self.side == "at least":
            return self.value >= self.threshold
        return self.value <= self.threshold

    def otherwise(self, advice: str) -> "Check":
        """The check of this condition, with what to do where it fails."""
        return Check(**dataclasses.asdict(self), advice=advice)


@dataclass(frozen=True, slots=True)
class Check(Condition):
    """A condition, and the advice what to do where it fails."""

    advice: str


def _condition(
    side: Literal["at least", "at most"], name: str, value: float, bound: float, unit: str = ""
) -> Condition:
    """That a value, in SI, keeps to its bound; both are shown in `unit`."""
    scale = SCREEN_UNITS.get(unit.partition(" ")[0], 1.0)  # "mm rms" is in mm
    return Condition(name, float(value) * scale, side, float(bound) * scale, unit)


at_least = functools.partial(_condition, "at least")
at_most = functools.partial(_condition, "at most")

_OfReadings = Literal["", "measured", "refused", "front", "rear", "along", "across"]
Role = _OfReadings | Literal["reference", "before", "fitted"]
"""What a series shows: what was measured and used, what of it was refused, the truth, by the
configured and by the fitted values; one of the cameras; an error along or across the line of sight.
"""


@dataclass(frozen=True, slots=True)
class Series:
    """Points of a picture, x (n,) and y (n,); drawn one by one, joined, or as bars.

    role: what they are; it has one colour in every picture of every report.
    """

    x: FloatArray
    y: FloatArray
    label: str = ""
    role: Role = ""
    style: Literal["points", "line", "bars"] = "points"


def thinned(x: FloatArray, y: FloatArray, label: str = "", role: Role = "") -> Series:
    """Points (n,) of a picture, no more of them, and evenly, than one can see."""
    step = max(1, -(-len(x) // _MOST_POINTS))
    return Series(x[::step], y[::step], label, role)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportPicture:
    """A diagram of the report.

    axes: what x and y are, with units. caption: what one sees in it. equal: both to one scale.
    """

    title: str
    axes: tuple[str, str]
    series: tuple[Series, ...]
    caption: str = ""
    equal: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """A fit with its verdict.

    kind: "wheels", "lidar", ... settings: further values for robot.toml by key (lists of tables
    as lists of dicts), beside those of `fitted` that have a key. residuals: in words, as "rms
    2.1 mm over 812 pairs, 71 % of them used". warnings: what to beware of though it may pass.
    figures: more for --json. joint: keys
    (k,) of fitted rows with a key, and their covariance (k, k), for the fits that come after.
    """

    kind: str
    fitted: tuple[Fitted, ...]
    checks: tuple[Check, ...]
    residuals: str
    pictures: tuple[ReportPicture, ...] = ()
    warnings: tuple[str, ...] = ()
    settings: dict[str, Any] = field(default_factory=dict)
    figures: dict[str, Any] = field(default_factory=dict)
    joint: tuple[tuple[str, ...], FloatArray] | None = None

    @property
    def failures(self) -> list[str]:
        """Why the fit is not to be used, as text, with what to do; empty where it is."""
        failed = [f"{check.name}: {check.advice}" for check in self.checks if not check.passed]
        how = _SURER.get(self.kind, _SURER["joint"])
        return failed + [f"{r.failure}: {r.next_step}, {how}" for r in self.fitted if r.failure]

    def new_settings(self) -> dict[str, Any]:
        """Every value for robot.toml by its key."""
        rows = {row.key: row.value for row in self.fitted if row.key and math.isfinite(row.value)}
        return {**rows, **self.settings}


def joined(parts: Sequence[Calibration]) -> Calibration:
    """One calibration of several, at least one, of which the first has the kind."""

    def every(field_name: str) -> tuple[Any, ...]:
        return tuple(item for part in parts for item in getattr(part, field_name))

    return Calibration(
        kind=parts[0].kind,
        fitted=every("fitted"),
        checks=every("checks"),
        residuals="; ".join(part.residuals for part in parts),
        pictures=every("pictures"),
        warnings=every("warnings"),
        settings={key: value for part in parts for key, value in part.settings.items()},
        figures={key: value for part in parts for key, value in part.figures.items()},
    )
