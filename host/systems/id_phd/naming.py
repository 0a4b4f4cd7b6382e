"""Names for what the anonymous filter has found, live: by the odometry that comes over the link."""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from host.geometry import Path, wrap
from host.messages import (
    Displacement,
    Estimate,
    FloatArray,
    Message,
    Named,
    Names,
    Positions,
    TeammateOdometry,
)
from host.systems.id_phd.id_phd import Belief, IdPhd
from host.systems.id_phd.settings import IdPhdSettings

# Estimates of successive moments share nearly all of their readings.
SETTINGS = IdPhdSettings(
    detection=0.8,
    reach_m=2.5,
    clutter=0.05,
    restart=2e-3,
    exchange=0.01,
    alike=5.0,
    gain_sigmas=(0.03, 0.05, 0.03),
    hypotheses=150,
)
_EVERY_S = 0.2
_WAIT_S = 0.3  # for odometry that is on its way
_SEEN_S = 0.5  # an estimate without a reading for so long says nothing of where its robot is
_LEAST_VARIANCE = 1e-4  # m²: a teammate's turret is not exactly above its wheels
_OWN_M = 0.15  # a belief nearer than this to an estimate is of it
_LEAST_PROBABILITY = 0.5


@dataclass(frozen=True, slots=True)
class _Believed:
    """The identity belief of an estimate at `time`. heading (rad): at that time."""

    belief: Belief
    time: float


class Naming:
    """Goes by the messages alone, so that a replay finds the same names. For one thread."""

    def __init__(self, settings: IdPhdSettings = SETTINGS) -> None:
        self._filter = IdPhd(settings)
        self._waiting: deque[Estimate] = deque()
        self._next = -math.inf
        self._believed: dict[int, _Believed] = {}  # by label
        self._own = Path()
        self._paths: dict[int, Path] = {}

    def take(self, message: Message) -> Names | None:
        """Take the next message of a run, or estimate; return names where there are new ones."""
        if isinstance(message, Displacement):
            self._own.append(message)
            self._filter.drive(message)
        elif isinstance(message, TeammateOdometry):
            self._hear(message)
        elif isinstance(message, Estimate) and self._paths:
            return self._take_estimate(message)
        return None

    def at(self, time: float) -> dict[int, Named]:
        """By label, who the recognized teammates are, their headings carried to `time` (s)."""
        return {label: self._named(each, time) for label, each in self._believed.items()}

    def _hear(self, heard: TeammateOdometry) -> None:
        if heard.restarted:
            self._filter.forget(heard.identity)
            self._paths.pop(heard.identity, None)
        self._paths.setdefault(heard.identity, Path()).append(heard.step)
        self._filter.hear(heard.identity, heard.step)

    def _take_estimate(self, estimate: Estimate) -> Names | None:
        """Use it once the odometry of its time is there; return the names in an earlier one."""
        if estimate.time >= self._next:
            self._next = estimate.time + _EVERY_S
            self._waiting.append(estimate)
        if not self._waiting or self._waiting[0].time > estimate.time - _WAIT_S:
            return None
        used = self._waiting.popleft()
        self._use(used)
        named = self.at(used.time)
        return Names(
            used.time,
            np.array(list(named), np.int64),
            np.array([each.identity for each in named.values()], np.int64),
            np.array([each.probability for each in named.values()], np.float64),
            np.array([each.heading for each in named.values()], np.float64),
        )

    def _use(self, estimate: Estimate) -> None:
        seen = np.flatnonzero(estimate.ages < _SEEN_S)
        positions = estimate.positions[seen]
        covariances = estimate.covariances[seen] + _LEAST_VARIANCE * np.eye(2)
        self._filter.update(Positions(estimate.time, positions, covariances))
        self._believed = {}
        for belief in self._filter.beliefs():
            if belief.probability > _LEAST_PROBABILITY and len(seen):
                off = positions - belief.pose[:2]
                distances: FloatArray = np.hypot(off[:, 0], off[:, 1])
                nearest = int(np.argmin(distances))
                if distances[nearest] < _OWN_M:
                    label = int(estimate.labels[seen[nearest]])
                    self._believed[label] = _Believed(belief, estimate.time)

    def _named(self, believed: _Believed, time: float) -> Named:
        """The heading carried to `time`: both robots have turned since."""
        belief = believed.belief
        path = self._paths.get(belief.identity, Path())
        turned = path.between(believed.time, time).dpsi
        turned -= self._own.between(believed.time, time).dpsi
        heading = float(wrap(belief.pose[2] + turned))
        return Named(belief.identity, belief.probability, heading)
