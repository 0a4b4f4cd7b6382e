"""The static world: obstacles that the filter is sure of, remembered while they are out of view.

They are the part of the unknown that is known best: in the intensity of things which no Bernoulli
stands for (Williams 2015, sec. II-D), each is a narrow peak of obstacles. So what is seen where an
obstacle was, is that obstacle again. They are kept in the robot's frame and carried by the
odometry, whose noise widens them; one that is not where it must be seen is forgotten.
"""

import math

import numpy as np

from host.estimator.gaussian_mixture import (
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
from host.messages import Displacement, FloatArray, IntArray, Positions

_REMEMBERED_S = 300.0  # mean time before one that is out of view is no longer believed in
_LOST_M2 = 0.5**2  # variance per axis beyond which nothing can be found again
_IN_VIEW = 0.5  # from this P_D on a miss speaks against an obstacle; less is no plain view
_BELIEVED = 0.5


class StaticWorld:
    """Remembered obstacles as Gaussians (6, k), rows as in `gaussian_mixture`.

    Their weight is the probability that the obstacle is still there. gate: squared Mahalanobis.
    """

    def __init__(self, gate: float) -> None:
        self._gate = gate
        self.rows = np.zeros((ROWS, 0))

    def predict(self, motion: Displacement) -> None:
        """Carry all into the robot's new frame; what is known too badly there is forgotten."""
        if not self.rows.shape[1]:
            return
        predict_mixture(self.rows, motion, 0.0)
        self.rows[WEIGHT] *= math.exp(-motion.interval / _REMEMBERED_S)
        known = self.rows[PXX] + self.rows[PYY] < 2.0 * _LOST_M2
        self.rows = self.rows[:, known & (self.rows[WEIGHT] > 0.5 * _BELIEVED)]

    def intensity(self, measured: Positions, noise: FloatArray, detected: FloatArray) -> FloatArray:
        """Expected readings (m,) of remembered obstacles, 1/m², at the places that were read.

        noise (m, 2, 2) m²; detected (k,): P_D of each obstacle.
        """
        i, j = gated_pairs(self.rows, measured.positions, noise, self._gate)
        if not len(i):
            return np.zeros(len(measured.positions))
        entries = noise.reshape(-1, 4).T.take((0, 1, 3), axis=0)
        _, likelihood = update_by_positions(
            self.rows.take(i, axis=1), measured.positions.T.take(j, axis=1), entries.take(j, axis=1)
        )
        found = detected.take(i) * self.rows[WEIGHT].take(i) * likelihood
        return np.asarray(np.bincount(j, found, len(measured.positions)))

    def learn(self, obstacles: FloatArray, detected: FloatArray, share: float) -> None:
        """Remember the obstacles (6, n) of which the filter is sure now, each where it is now.

        detected (k,): P_D of those remembered; share: of independent evidence in a miss.
        """
        if not self.rows.shape[1] + obstacles.shape[1]:
            return
        again = self._seen_again(obstacles)
        missed = np.where(detected > _IN_VIEW, (1.0 - detected) ** share, 1.0)
        self.rows[WEIGHT] *= missed
        unseen = np.delete(self.rows, again, axis=1)
        learnt = obstacles.copy()
        learnt[WEIGHT] = 1.0
        self.rows = np.concatenate((unseen, learnt), axis=1)

    def _seen_again(self, obstacles: FloatArray) -> IntArray:
        """Which of those remembered are among the obstacles: both are each other's nearest."""
        i, j = gated_pairs(self.rows, *_places(obstacles), self._gate)
        apart = np.hypot(*(self.rows[: Y + 1, i] - obstacles[: Y + 1, j]))
        order = np.argsort(apart, kind="stable")
        i, j = i[order], j[order]
        nearest_of_i = np.zeros(len(i), dtype=bool)
        nearest_of_i[np.unique(i, return_index=True)[1]] = True
        nearest_of_j = np.zeros(len(j), dtype=bool)
        nearest_of_j[np.unique(j, return_index=True)[1]] = True
        return np.asarray(i[nearest_of_i & nearest_of_j])

    def believed(self) -> tuple[FloatArray, FloatArray]:
        """Those that are probably still there: positions (n, 2) m, covariances (n, 2, 2) m²."""
        return _places(self.rows[:, self.rows[WEIGHT] > _BELIEVED])


def _places(rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Positions (n, 2) and covariances (n, 2, 2) of Gaussians (6, n)."""
    return rows[: Y + 1].T, rows[[PXX, PXY, PXY, PYY]].T.reshape(-1, 2, 2)
