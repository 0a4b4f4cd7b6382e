"""`pmb` with one of its models left out at a time: a filter by name for each.

A plugin: `swarmloc --plugin tools/ablation.py evaluate arena4 --filters pmb,pmb_no_velocity`. The
table in docs/filters.md is made of them (tools/figure_tables.py). What is left out is left out by
putting something simpler in its place; the filter itself has no switches for it.
"""

from collections.abc import Callable
from dataclasses import replace
from unittest.mock import patch

import numpy as np

from host.config import RobotConfig
from host.estimator import thing_filter
from host.estimator.gaussians.moving_gaussians import VX
from host.estimator.learnt_lidar import LearntLidar
from host.estimator.pmb import PmbFilter
from host.estimator.profiles import FilterEntry
from host.estimator.things.association import share_out
from host.estimator.things.static_world import StaticWorld
from host.estimator.things.thing_modes import MOVING, TEAMMATE, ThingModes
from host.estimator.things.things import Things
from host.messages import Bearings, FloatArray, Positions
from host.registry import FILTERS

_WALK_M2_PER_S = 0.09**2  # of teammates without a velocity, per axis


class _WalkingModes(ThingModes):
    """What moves is on a random walk: of its velocity only the usual size is known, not more."""

    def _steps(self, dt: float) -> tuple[FloatArray, FloatArray]:
        transitions, noise = super()._steps(dt)
        transitions[:, :, VX:] = 0.0
        noise[:, 1:] = 0.0
        noise[[0, 2], 1:] = _WALK_M2_PER_S * dt
        noise[[7, 9], 1:] = self._speed_variance  # what a reading's lag makes uncertain
        return transitions, noise


class _OneMode(ThingModes):
    """Teammates always move, in one way; obstacles never do."""

    def __init__(self, robot: RobotConfig) -> None:
        super().__init__(robot.filter.pmb)
        self._eigenvalues = np.zeros_like(self._eigenvalues)  # no mode changes into another

    def born(
        self,
        positions: FloatArray,
        covariances: FloatArray,
        lags: FloatArray | float,
        teammate: FloatArray,
        obstacle: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        rows, weights = super().born(positions, covariances, lags, teammate, obstacle)
        weights[TEAMMATE] = 0.0
        weights[MOVING] = teammate
        return rows, weights


class _NoMemory(StaticWorld):
    def learn(self, *known: object) -> None:
        """Nothing is remembered."""


class _AsConfigured(LearntLidar):
    def learn(self, *scan: object) -> None:
        """The detection probability stays as configured."""

    def learn_clutter(self, *scan: object) -> None:
        """And so does the clutter."""


class _Doubles(Things):
    def merge_duplicates(self) -> None:
        """Two hypotheses of one thing stay two."""


class _EvidenceByMessage(PmbFilter):
    """Each scan and picture counts as if the one before had not been."""

    def update(self, measurement: Positions | Bearings) -> None:
        with patch.object(thing_filter, "new_share", lambda elapsed, _: np.ones_like(elapsed)):
            super().update(measurement)


class _SharedReadings(PmbFilter):
    """Readings are shared out one by one, without belief propagation."""

    _associate = staticmethod(share_out)


class _ReadingsWithout(PmbFilter):
    """Positions without some of what is measured beside them."""

    left_out: tuple[str, ...] = ()

    def update(self, measurement: Positions | Bearings) -> None:
        if isinstance(measurement, Positions):
            measurement = replace(measurement, **dict.fromkeys(self.left_out))
        super().update(measurement)


class _NoLags(_ReadingsWithout):
    left_out = ("lags",)


class _NoScores(_ReadingsWithout):
    left_out = ("scores",)


class _NoClearance(_ReadingsWithout):
    left_out = ("clearance",)


def _made(kind: type[PmbFilter], robot: RobotConfig) -> PmbFilter:
    return kind(robot.filter, robot.lidar, robot.camera)


def _of(kind: type[PmbFilter]) -> Callable[[RobotConfig], PmbFilter]:
    return lambda robot: _made(kind, robot)


def _with(
    part: str, substitute: Callable[[RobotConfig], object]
) -> Callable[[RobotConfig], PmbFilter]:
    """`pmb` with another object in place of one of its parts."""

    def make(robot: RobotConfig) -> PmbFilter:
        made = _made(PmbFilter, robot)
        if not hasattr(made, part):
            raise AttributeError(f"the filter has no part {part}")
        setattr(made, part, substitute(robot))
        return made

    return make


def _no_class(robot: RobotConfig) -> PmbFilter:
    only_teammates = robot.filter.pmb.model_copy(update={"obstacle_share": 0.0})
    settings = robot.filter.model_copy(update={"pmb": only_teammates})
    return PmbFilter(settings, robot.lidar, robot.camera)


def _no_sizes(robot: RobotConfig) -> PmbFilter:
    camera = robot.camera.model_copy(update={"use_ranges": False})
    return PmbFilter(robot.filter, robot.lidar, camera)


# What is left out, as text, and the filter without it.
WITHOUT: dict[str, tuple[str, Callable[[RobotConfig], PmbFilter]]] = {
    "velocity": ("pmb_no_velocity", _with("_modes", lambda r: _WalkingModes(r.filter.pmb))),
    "modes of motion (one for all teammates)": ("pmb_one_mode", _with("_modes", _OneMode)),
    "obstacles as a class": ("pmb_no_class", _no_class),
    "static world": ("pmb_no_static_world", _with("_world", lambda r: _NoMemory(r.filter.gate))),
    "learnt detection and clutter": (
        "pmb_not_learnt",
        _with("_lidar", lambda r: _AsConfigured(r.lidar)),
    ),
    "duplicates merged": ("pmb_duplicates", _with("_things", lambda _: _Doubles())),
    "belief propagation (readings shared out)": ("pmb_shared", _of(_SharedReadings)),
    "evidence by time": ("pmb_by_message", _of(_EvidenceByMessage)),
    "lags of a scan's readings": ("pmb_no_lags", _of(_NoLags)),
    "scores of turrets": ("pmb_no_scores", _of(_NoScores)),
    "occlusion as the scan shows it": ("pmb_no_clearance", _of(_NoClearance)),
    "sizes of strips": ("pmb_no_sizes", _no_sizes),
}

for _name, _make in WITHOUT.values():
    FILTERS.register(_name, FilterEntry(_make))
