"""The settings of the filters in robot.toml."""

from typing import Annotated

from pydantic import AfterValidator, Field

from host.config.section import Section, registered
from host.registry import FILTERS


class PmbSettings(Section):
    """What `pmb` and `phd` take teammates and the things around them for (docs/filters.md)."""

    speed_mps: float = Field(0.2, gt=0.0, le=5.0)  # of teammates that move, std per axis
    appear_per_m2_s: float = Field(0.01, gt=0.0, lt=100.0)  # things that appear
    obstacle_share: float = Field(0.9, ge=0.0, lt=1.0)  # of the things that appear
    report_error_m: float = Field(0.5, gt=0.0, lt=100.0)  # an error as bad as no report


class FilterSettings(Section):
    """Which filter runs, and its settings (chosen in docs/filters.md)."""

    profile: Annotated[str, AfterValidator(registered(FILTERS))] = "pmb"
    survival_range_m: float = Field(2.5, gt=0.1, le=50.0)  # beyond, teammates fade in about 1 s
    survival_s: float = Field(30.0, gt=0.1, le=1e6)  # mean time before an unseen teammate fades
    forget_weight: float = Field(0.15, gt=0.0, lt=1.0)  # of `phd`: kept in the report until then
    gate: float = Field(25.0, gt=1.0, le=100.0)  # squared Mahalanobis
    pmb: PmbSettings = PmbSettings()
