"""The static world: obstacles that the filter is sure of, remembered while they are out of view.

Those for which no Bernoulli stands any more are the part of the unknown that is known best: in the
intensity of unknown things (Williams 2015, sec. II-D) each is a narrow peak of obstacles. So what
is seen where an obstacle was, is that obstacle again. They are kept in the robot's frame and
carried by the odometry, whose noise widens them.
"""

import math

import numpy as np

from host.estimator.gaussians.gaussian_mixture import (
    PXX,
    PXY,
    PYY,
    ROWS,
    WEIGHT,
    Y,
    gated_pairs,
    predict_mixture,
    update_by_positions,
)
from host.messages import BoolArray, Displacement, FloatArray, IntArray, Positions

# Mean times before an obstacle is no longer believed in: out of view, and where it should be seen.
# The latter is longer than a teammate's, for some are thin and seldom found.
_REMEMBERED_S, _DOUBTED_S = 300.0, 1.0
_LOST_M2 = 0.5**2  # variance per axis beyond which nothing can be found again
_IN_VIEW = 0.5  # from this P_D on a miss speaks against an obstacle; less is no plain view
_SETTLED_S = 1.0  # a thing that stood for less is not reported, and forgotten when it is gone
_SURE = 0.8  # from this probability on a thing is remembered as an obstacle
_BELIEVED = 0.5


class StaticWorld:
    """Remembered obstacles as Gaussians (6, k), rows as in `gaussian_mixture`.

    Their weight is the probability that the obstacle is still there. gate: squared Mahalanobis.
    """

    def __init__(self, gate: float) -> None:
        self._gate = gate
        self.rows = np.zeros((ROWS, 0))
        self._alone = np.zeros(0, dtype=bool)  # for which no Bernoulli stands
        self._doubts = np.zeros(0)  # probability of a teammate that stands instead
        self._seen_s = np.zeros(0)  # for how long it was seen, altogether

    def predict(self, motion: Displacement) -> None:
        """Carry all into the robot's new frame; what is known too badly there is forgotten."""
        if not self.rows.shape[1]:
            return
        predict_mixture(self.rows, motion, 0.0)
        self.rows[WEIGHT] *= math.exp(-motion.interval / _REMEMBERED_S)
        kept = self.rows[PXX] + self.rows[PYY] < 2.0 * _LOST_M2
        kept &= self.rows[WEIGHT] > 0.5 * _BELIEVED
        if not kept.all():
            self._keep(kept)

    def _keep(self, kept: BoolArray) -> None:
        self.rows, self._alone = self.rows[:, kept], self._alone[kept]
        self._doubts, self._seen_s = self._doubts[kept], self._seen_s[kept]

    def intensity(self, measured: Positions, noise: FloatArray, detected: FloatArray) -> FloatArray:
        """Expected readings (2, m) of what no Bernoulli stands for, 1/m², where they were made.

        First those of obstacles, then those of standing teammates taken for obstacles. noise
        (m, 2, 2) m²; detected (k,): P_D of each that is remembered.
        """
        alone = self._alone.nonzero()[0]
        if not len(alone):
            return np.zeros((2, len(measured.positions)))
        i, j = gated_pairs(self.rows.take(alone, 1), measured.positions, noise, self._gate)
        if not len(i):
            return np.zeros((2, len(measured.positions)))
        i = alone.take(i)
        entries = noise.reshape(-1, 4).T.take((0, 1, 3), axis=0)
        _, likelihood = update_by_positions(
            self.rows.take(i, axis=1), measured.positions.T.take(j, axis=1), entries.take(j, axis=1)
        )
        found = detected.take(i) * self.rows[WEIGHT].take(i) * likelihood
        doubts, m = self._doubts.take(i), len(measured.positions)
        of_obstacles = np.bincount(j, found * (1.0 - doubts), m)
        return np.stack((of_obstacles, np.bincount(j, found * doubts, m)))

    def learn(
        self, standing: FloatArray, obstacle: FloatArray, detected: FloatArray, elapsed: float
    ) -> None:
        """Go by what the filter knows now of things that stand still (6, n): each has a Bernoulli.

        obstacle (n,): the probability that it is one, if it is there at all. Those who surely are,
        are remembered.

        detected (k,): P_D of those remembered; elapsed: s since the scan before.
        """
        if not self.rows.shape[1] + standing.shape[1]:
            return
        again, now = self._seen_again(standing)
        seen_s = np.zeros(standing.shape[1])
        seen_s[now] = self._seen_s[again] + elapsed
        self.rows[WEIGHT] *= np.exp(-(elapsed / _DOUBTED_S) * (detected > _IN_VIEW))
        unseen = self._seen_s >= _SETTLED_S  # what was seen for a moment is not worth it
        unseen[again] = False
        self._keep(unseen)
        sure = (obstacle > _SURE).nonzero()[0]
        learnt = standing.take(sure, axis=1)
        learnt[WEIGHT] = 1.0
        self._alone = np.arange(self.rows.shape[1] + len(sure)) < self.rows.shape[1]
        self.rows = np.concatenate((self.rows, learnt), axis=1)
        self._doubts = np.append(self._doubts, 1.0 - obstacle.take(sure))
        self._seen_s = np.append(self._seen_s, seen_s.take(sure))

    def _seen_again(self, standing: FloatArray) -> tuple[IntArray, IntArray]:
        """Pairs (p,), (p,) of what is remembered and things (6, n), each other's nearest."""
        i, j = gated_pairs(self.rows, *_places(standing), self._gate)
        apart = np.hypot(*(self.rows[: Y + 1, i] - standing[: Y + 1, j]))
        order = np.argsort(apart, kind="stable")
        i, j = i[order], j[order]
        nearest_of_i = np.zeros(len(i), dtype=bool)
        nearest_of_i[np.unique(i, return_index=True)[1]] = True
        nearest_of_j = np.zeros(len(j), dtype=bool)
        nearest_of_j[np.unique(j, return_index=True)[1]] = True
        mutual = nearest_of_i & nearest_of_j
        return i[mutual], j[mutual]

    def believed(self) -> tuple[FloatArray, FloatArray]:
        """Those that are probably still there: positions (n, 2) m, covariances (n, 2, 2) m²."""
        known = (self.rows[WEIGHT] > _BELIEVED) & (self._seen_s >= _SETTLED_S)
        return _places(self.rows.take(known.nonzero()[0], axis=1))


def _places(rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Positions (n, 2) and covariances (n, 2, 2) of Gaussians (6, n)."""
    return rows[: Y + 1].T, rows.take((PXX, PXY, PXY, PYY), axis=0).T.reshape(-1, 2, 2)
