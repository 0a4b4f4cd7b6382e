"""The ID-PHD of Stegagno et al. 2013, repaired: identities of anonymous positions by odometry.

Each robot sends what its odometry reports. A position that moves as robot i says is robot i.
What differs from the paper, and why:

- A tag (eq. 13) is for ever there, and the first step decides. Here it belongs to a joint
  hypothesis, which dies when another fits better: for every identity one track, or nowhere yet.
  Two identities never have one robot. A tag may start again at any reading.
- Eq. 14-15 write the total displacement q: here increments.
- False things (id -2) stand, and are rows of a hypothesis like robots, without names.
- lambda c(z) of eq. 11 is not 0. Birth, survival, pruning, which are not given, are settings.
- Robots that send nothing for long leave N^{1:t}.
"""

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp, ndtr

from host.geometry import Path
from host.messages import Displacement, FloatArray, IntArray, Positions
from host.systems.id_phd.association import (
    NOWHERE,
    Frame,
    Given,
    Hypotheses,
    associate,
    renamed,
)
from host.systems.id_phd.poses import Poses, born, log_likelihoods, moved, seen_after
from host.systems.id_phd.settings import IdPhdSettings
from host.systems.id_phd.tracks import (
    after_frame,
    merged,
    no_tracks,
    pruned,
    same_track,
    side_by_side,
    started,
)

_NEAR_M = 0.3  # tracks of one identity that differ by less are one place
_EXCHANGE_S = 1.0
_EDGE_M, _EDGE_RAD = 0.1, 0.03  # how sharp the view ends
_OWN = None  # the observer's own path


@dataclass(frozen=True, slots=True)
class Belief:
    """identity is at pose (3,), x, y (m), heading (rad), covariance (3, 3), with `probability`."""

    identity: int
    probability: float
    pose: FloatArray
    covariance: FloatArray


class IdPhd:
    """One observer's filter. time: of the last frame, s; identities: who has sent odometry."""

    def __init__(self, settings: IdPhdSettings) -> None:
        self.time = -math.inf
        self.identities: list[int] = []
        self._settings = settings
        self._paths: dict[int | None, Path] = {_OWN: Path()}
        self._next_exchange = -math.inf
        self._reached: dict[int | None, float] = {}
        self._tracks = no_tracks()
        self._hypotheses = Hypotheses(np.full((1, settings.false_things), NOWHERE), np.zeros(1))

    def drive(self, step: Displacement) -> None:
        """The observer itself has moved."""
        self._paths[_OWN].append(step)

    def hear(self, identity: int, step: Displacement) -> None:
        """Robot `identity` has sent how it moved."""
        if identity not in self._paths:
            self._paths[identity] = Path()
            self.identities.append(identity)
            nowhere = np.full((len(self._hypotheses.tracks), 1), NOWHERE)
            tracks = np.hstack((self._hypotheses.tracks, nowhere))
            self._hypotheses = Hypotheses(tracks, self._hypotheses.log_weights)
        self._paths[identity].append(step)

    def forget(self, identity: int) -> None:
        """Robot `identity` has left, or its odometry restarts."""
        if identity not in self.identities:
            return
        row = self._settings.false_things + self.identities.index(identity)
        self.identities.remove(identity)
        del self._paths[identity]
        self._reached.pop(identity, None)
        tracks = np.delete(self._hypotheses.tracks, row, axis=1)
        self._hypotheses = Hypotheses(tracks, self._hypotheses.log_weights)
        self._tracks = replace(self._tracks, tags=self._tracks.tags - (self._tracks.tags > row))
        self._join(np.arange(len(self._tracks)))

    def update(self, readings: Positions) -> None:
        """Take in a frame of anonymous positions; one without any says who is not there."""
        self._leave_silent(readings.time)
        self._predict(readings.time)
        covariances = self._settings.alike * readings.covariances
        weights = self._component_weights(readings.positions, covariances)
        frame = self._frame(weights, readings)
        given = associate(self._hypotheses, frame, self._settings.hypotheses)
        self._go_on(given, weights, readings.positions, covariances)
        self._exchange_tags()
        self._forget_lost()
        self._join(same_track(self._tracks, self._hypotheses.masses(len(self._tracks))))

    def beliefs(self) -> list[Belief]:
        """Where each identity most likely is; those that are nowhere left out."""
        masses, means = self._hypotheses.masses(len(self._tracks)), self._tracks.means()
        found = []
        for row, identity in enumerate(self.identities, self._settings.false_things):
            own = np.flatnonzero(self._tracks.tags == row)
            if not len(own):
                continue
            best = own[np.argmax(masses[own])]
            off = means.means[own, :2] - means.means[best, :2]
            probability = float(masses[own[np.hypot(off[:, 0], off[:, 1]) < _NEAR_M]].sum())
            pose, covariance = means.means[best, :3], means.covariances[best, :3, :3]
            found.append(Belief(identity, probability, pose, covariance))
        return found

    # --- Time update

    def _predict(self, time: float) -> None:
        """Eq. 15 by tag, 18, 19: each track moves as the odometry of its identity says."""
        self.time = time
        steps = [(0.0, 0.0, 0.0, 0.0, 0.0)] * self._settings.false_things  # they stand
        for identity in self.identities:
            step = self._new_motion(identity, time)
            variances = step.translation_variance, step.heading_variance
            steps.append((step.dx, step.dy, step.dpsi, *variances))
        tracks, own = self._tracks, self._new_motion(_OWN, time)
        by_component = np.array(steps).reshape(-1, 5)[tracks.tags[tracks.of]]
        poses = seen_after(moved(tracks.poses, by_component), own)
        self._tracks = replace(tracks, poses=poses)

    def _new_motion(self, robot: int | None, time: float) -> Displacement:
        """What is new of a robot's motion up to `time`; what is late counts once it is there."""
        path = self._paths[robot]
        step = path.between(self._reached.get(robot, time), time)
        self._reached[robot] = min(time, path.end)
        return step

    # --- Measurement update

    def _component_weights(self, positions: FloatArray, covariances: FloatArray) -> FloatArray:
        """(k, 1 + m): log of 1 - p_D, and of p_D g(z | x) for each reading (eq. 12)."""
        poses = self._tracks.poses
        read = log_likelihoods(poses, positions, covariances) + math.log(self._settings.detection)
        missed = np.log1p(-self._settings.detection * self._in_view())
        return np.asarray(self._tracks.log_weights[:, None] + np.column_stack((missed, read)))

    def _in_view(self) -> FloatArray:
        """Share of each component (k,) that lies in view."""
        x, y = self._tracks.poses.means[:, :2].T
        spread = self._tracks.poses.covariances
        distance = np.hypot(x, y)
        sigma = np.sqrt((spread[:, 0, 0] + spread[:, 1, 1]) / 2.0)
        inside = ndtr((self._settings.reach_m - distance) / (sigma + _EDGE_M))
        if self._settings.half_view_rad < math.pi:
            off = self._settings.half_view_rad - np.abs(np.arctan2(y, x))
            inside = inside * ndtr(off / (sigma / np.maximum(distance, 0.1) + _EDGE_RAD))
        return np.asarray(inside)

    def _frame(self, weights: FloatArray, readings: Positions) -> Frame:
        """The weights by track, and what else a reading may be."""
        settings, count = self._settings, len(readings.positions)
        unnamed = settings.false_things
        by_track = self._tracks.total(weights)
        density = math.log(settings.detection / settings.area_m2)
        first = np.full((unnamed + len(self.identities), count), density)
        first[:unnamed] += math.log(settings.false_birth)
        read = by_track[:, 1:]
        if settings.known and readings.identities is not None:
            names = np.array([*[-1] * unnamed, *self.identities])
            first[names[:, None] != readings.identities] = -np.inf
            read = np.where(names[self._tracks.tags, None] == readings.identities, read, -np.inf)
        return Frame(
            missed=by_track[:, 0],
            read=read,
            first=first,
            restart=math.log(settings.restart),
            nothing=math.log(settings.clutter / settings.area_m2),
            unnamed=unnamed,
        )

    def _go_on(
        self, given: Given, weights: FloatArray, positions: FloatArray, covariances: FloatArray
    ) -> None:
        """The tracks that the hypotheses have after the frame, each made once."""
        old, rows = self._tracks, given.readings.shape[1]
        # One number for each way to go on: of an old track or a new one of a row, by reading.
        source = np.where(
            given.starts > 0, len(old) + np.arange(rows), self._hypotheses.tracks[given.origin]
        )
        ways = np.where(
            source == NOWHERE, NOWHERE, source * (len(positions) + 1) + given.readings + 1
        )
        made = np.unique(ways)
        made = made[made != NOWHERE]
        which, read = np.divmod(made, len(positions) + 1)
        go_on = which < len(old)
        chosen = np.column_stack((which, read - 1))[go_on]
        after = after_frame(old, chosen, weights, positions, covariances)
        new = started(
            [
                (row, self._bank(row, positions[reading - 1], covariances[reading - 1]))
                for row, reading in zip(
                    (which[~go_on] - len(old)).tolist(), read[~go_on].tolist(), strict=True
                )
            ]
        )
        self._tracks = merged(pruned(side_by_side(after, new)))
        tracks = np.where(ways == NOWHERE, NOWHERE, np.searchsorted(made, ways))
        self._hypotheses = Hypotheses(tracks, given.log_weights)

    def _bank(self, row: int, position: FloatArray, covariance: FloatArray) -> Poses:
        headings = 1 if row < self._settings.false_things else self._settings.headings
        return born(position, covariance, headings, np.array(self._settings.gain_sigmas))

    # --- Healing

    def _exchange_tags(self) -> None:
        """Once per second, the likeliest hypothesis with two tags exchanged, headings unknown.

        So that what was pruned early, for lack of room, may come back.
        """
        if self._settings.exchange == 0.0 or self.time < self._next_exchange:
            return
        self._next_exchange = self.time + _EXCHANGE_S
        best = int(np.argmax(self._hypotheses.log_weights))
        tracks, means = self._hypotheses.tracks[best], self._tracks.means()
        banks: list[tuple[int, Poses]] = []
        added = []
        for first, second in itertools.combinations(range(len(tracks)), 2):
            one, other = tracks[first], tracks[second]
            if NOWHERE in (one, other) or second < self._settings.false_things:
                continue
            changed = tracks.copy()
            for row, place in ((first, other), (second, one)):
                changed[row] = len(self._tracks) + len(banks)
                position, spread = means.means[place, :2], means.covariances[place, :2, :2]
                banks.append((row, self._bank(row, position, spread)))
            added.append(changed)
        if added:
            weight = self._hypotheses.log_weights[best] + math.log(self._settings.exchange)
            weights = np.append(self._hypotheses.log_weights, np.full(len(added), weight))
            everything = np.vstack((self._hypotheses.tracks, *added))
            self._hypotheses = Hypotheses(everything, weights - logsumexp(weights))
            self._tracks = pruned(side_by_side(self._tracks, started(banks)))

    # --- Survival

    def _forget_lost(self) -> None:
        """A track so wide that it says nothing is nowhere; so is a false thing out of reach."""
        means = self._tracks.means()
        variances = np.diagonal(means.covariances, axis1=1, axis2=2)
        width = np.sqrt((variances[:, 0] + variances[:, 1]) / 2.0)
        beyond = np.hypot(means.means[:, 0], means.means[:, 1]) > self._settings.reach_m + width
        unnamed = self._tracks.tags < self._settings.false_things
        lost = (width > self._settings.lost_m) | (beyond & unnamed)
        self._join(np.where(lost, NOWHERE, np.arange(len(lost))))

    def _leave_silent(self, time: float) -> None:
        """Robots that have sent no odometry for long have left."""
        for identity in list(self.identities):
            if self._paths[identity].end <= time - self._settings.silent_s:
                self.forget(identity)

    def _join(self, names: IntArray) -> None:
        """Name tracks again; hypotheses that then say the same become one, unused tracks go."""
        self._hypotheses = renamed(self._hypotheses, names)
        used = np.unique(self._hypotheses.tracks)
        used = used[used != NOWHERE]
        numbers = np.full(len(self._tracks) + 1, NOWHERE)
        numbers[used] = np.arange(len(used))
        self._hypotheses = replace(self._hypotheses, tracks=numbers[self._hypotheses.tracks])
        self._tracks = self._tracks.only(used)
