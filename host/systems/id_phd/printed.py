"""The ID-PHD filter as Stegagno et al. 2013 print it, to hold the repaired one against.

Kept as printed: a tag is for ever (eq. 13, 15), no false alarms (lambda = 0 in eq. 12), weights
of tags that know nothing of each other. Eq. 14-15's total displacement is an increment here, or
nothing would work. Birth and pruning, which are not given, are those of Vo and Ma 2006.
"""

import math
from collections.abc import Sequence

import numpy as np

from host.geometry import Path
from host.messages import Displacement, FloatArray, IntArray, Positions
from host.systems.id_phd.id_phd import Belief
from host.systems.id_phd.poses import (
    Poses,
    alike,
    born,
    joined,
    log_likelihoods,
    moved,
    no_poses,
    seen_after,
    summed,
    updated,
)
from host.systems.id_phd.settings import IdPhdSettings

_UNTAGGED, _FALSE_THING = -1, -2  # tags from 0 on are rows of identities
_BIRTH = 0.02  # expected new robots at a reading
_SURVIVAL = 0.99
_LEAST_WEIGHT, _MOST, _ONE = 1e-4, 150, 1.0


class PrintedIdPhd:
    """One observer's filter; `drive`, `hear`, `update` and `beliefs` are those of `IdPhd`."""

    def __init__(self, settings: IdPhdSettings) -> None:
        self.time = -math.inf
        self.identities: list[int] = []
        self._settings = settings
        self._own = Path()
        self._paths: dict[int, Path] = {}
        self._tags: IntArray = np.zeros(0, dtype=np.int64)
        self._weights: FloatArray = np.zeros(0)
        self._poses = no_poses()

    def drive(self, step: Displacement) -> None:
        """The observer itself has moved."""
        self._own.append(step)

    def hear(self, identity: int, step: Displacement) -> None:
        """Robot `identity` has sent how it moved."""
        if identity not in self._paths:
            self.identities.append(identity)
        self._paths.setdefault(identity, Path()).append(step)

    def update(self, readings: Positions) -> None:
        """Take in a frame of anonymous positions."""
        covariances = self._settings.alike * readings.covariances
        start, self.time = self.time, readings.time
        if len(self._tags) and start < readings.time:
            self._split()
            self._predict(start, readings.time)
        self._correct(readings.positions, covariances)
        self._reduce()
        self._give_birth(readings.positions, covariances)

    def beliefs(self) -> list[Belief]:
        """Of each identity the component with the highest weight."""
        found = []
        for row, identity in enumerate(self.identities):
            own = np.flatnonzero(self._tags == row)
            if len(own):
                best = own[np.argmax(self._weights[own])]
                pose, covariance = self._poses.means[best], self._poses.covariances[best]
                weight = min(1.0, float(self._weights[best]))
                found.append(Belief(identity, weight, pose[:3], covariance[:3, :3]))
        return found

    def _split(self) -> None:
        """Eq. 15: what has no tag becomes one of each, and of false things (-2)."""
        new, old = np.flatnonzero(self._tags == _UNTAGGED), np.flatnonzero(self._tags != _UNTAGGED)
        rows = np.concatenate((old, np.repeat(new, len(self.identities) + 1)))
        tags = np.tile([*range(len(self.identities)), _FALSE_THING], len(new))
        shares = np.where(self._tags == _UNTAGGED, 1.0 / (len(self.identities) + 1), 1.0)
        self._weights = (self._weights * shares)[rows]
        self._tags = np.concatenate((self._tags[old], tags))
        self._poses = self._poses.take(rows)

    def _predict(self, start: float, end: float) -> None:
        """Eq. 10 with p_S, 18 and 19."""
        steps = np.zeros((len(self._tags), 5))
        for row, identity in enumerate(self.identities):
            step = self._paths[identity].between(start, end)
            variances = step.translation_variance, step.heading_variance
            steps[self._tags == row] = (step.dx, step.dy, step.dpsi, *variances)
        self._poses = seen_after(moved(self._poses, steps), self._own.between(start, end))
        self._weights = _SURVIVAL * self._weights

    def _correct(self, positions: FloatArray, covariances: FloatArray) -> None:
        """Eq. 12: each component missed, and with each reading (eq. 20, 21)."""
        x, y = self._poses.means[:, :2].T
        seen = (np.hypot(x, y) < self._settings.reach_m) & (
            np.abs(np.arctan2(y, x)) < self._settings.half_view_rad
        )
        detection = self._settings.detection * seen
        likelihoods = np.exp(log_likelihoods(self._poses, positions, covariances))
        shares = (detection * self._weights)[:, None] * likelihoods
        shares /= np.maximum(shares.sum(axis=0), 1e-300)
        parts, weights = [self._poses], [(1.0 - detection) * self._weights]
        for reading, (position, covariance) in enumerate(zip(positions, covariances, strict=True)):
            count = len(self._poses)
            here = np.broadcast_to(position, (count, 2))
            parts.append(updated(self._poses, here, np.broadcast_to(covariance, (count, 2, 2))))
            weights.append(shares[:, reading])
        self._tags = np.tile(self._tags, len(parts))
        self._poses, self._weights = joined(parts), np.concatenate(weights)

    def _reduce(self) -> None:
        """Prune, and merge what says the same, never across tags."""
        order = np.argsort(-self._weights, kind="stable")[: 3 * _MOST]
        order = order[self._weights[order] > _LEAST_WEIGHT]
        poses, weights, tags = self._poses.take(order), self._weights[order], self._tags[order]
        if len(tags):
            leaders = np.argmax(alike(poses, tags, _ONE), axis=1)  # the heaviest of the same
            first, groups = np.unique(leaders[leaders], return_inverse=True)
            poses, logs = summed(poses, np.log(weights), groups.ravel(), first)
            weights, tags = np.exp(logs), tags[first]
        best = np.sort(np.argsort(-weights, kind="stable")[:_MOST])
        self._poses, self._weights, self._tags = poses.take(best), weights[best], tags[best]

    def _give_birth(self, positions: FloatArray, covariances: FloatArray) -> None:
        """b of eq. 14: at the readings, for the next step, in all directions, without a tag."""
        banks: Sequence[Poses] = [
            born(position, covariance, self._settings.headings, np.zeros(3))
            for position, covariance in zip(positions, covariances, strict=True)
        ]
        if not banks or not self.identities:
            return
        size = sum(map(len, banks))
        self._poses = joined([self._poses, *banks])
        self._weights = np.append(self._weights, np.full(size, _BIRTH / self._settings.headings))
        self._tags = np.append(self._tags, np.full(size, _UNTAGGED))
