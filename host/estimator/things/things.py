"""Things that may be there, with what is kept of each: Bernoullis in `pmb`, components in `phd`.

n things are their Gaussians, rows (ROWS, MOTIONS, n), and the weights (MODES, n) of their modes:
that the thing is there and in that mode, as a probability or an expected number. Beside them
`tracks` (4, n): when the lidar last placed it (s) and with which variance (m²), when a picture last
had it in view (s), and its label (0 until it is reported).
"""

import math

import numpy as np

from host.estimator.gaussians.duplicates import duplicates
from host.estimator.gaussians.gaussian_mixture import WEIGHT
from host.estimator.gaussians.moving_gaussians import PLACE, ROWS, Y
from host.estimator.things.thing_modes import (
    MODES,
    MOTIONS,
    STILL,
    by_motion,
    mixtures,
    moments,
)
from host.messages import FloatArray, IntArray

SEEN, VARIANCE, PICTURED, LABEL = range(4)
_LEAST_EXISTENCE = 3e-3  # below this a thing is dropped
LIKELY = 0.05  # what is less surely there duplicates nothing yet ...
_AGAIN_S = 0.4  # ... and is dropped if it was never reported and not seen for so long


class Things:
    """All of them. Whoever changes rows or weights calls `changed`."""

    def __init__(self) -> None:
        self.rows, self.weights = np.zeros((ROWS, MOTIONS, 0)), np.zeros((MODES, 0))
        self.tracks = np.zeros((4, 0))
        self.changed()

    def __len__(self) -> int:
        return self.weights.shape[1]

    def changed(self) -> None:
        """Work out again what depends on rows and weights."""
        self._motions: FloatArray = by_motion(self.weights)
        self._mixtures: FloatArray = mixtures(moments(self.rows), self._motions)

    @property
    def motions(self) -> FloatArray:
        """The weights (MOTIONS, n) of the Gaussians, whatever each thing is."""
        return self._motions[0, :]

    @property
    def teammate_motions(self) -> FloatArray:
        """As `motions`, of each thing as a teammate."""
        return self._motions[1, :]

    @property
    def whole(self) -> FloatArray:
        """Each thing as one Gaussian (6, n), whatever it is."""
        return self._mixtures[:, 0]

    @property
    def teammates(self) -> FloatArray:
        """Each thing as a teammate, as one Gaussian (6, n)."""
        return self._mixtures[:, 1]

    def scale(self, factors: FloatArray) -> None:
        """Multiply the probability that each thing is there by factors (n,)."""
        self.weights *= factors
        self._motions *= factors
        self._mixtures[WEIGHT] *= factors

    def standing(self, least: float) -> tuple[IntArray, FloatArray]:
        """Indices (k,) of those that stand still with at least this probability, where: (6, k)."""
        still = self.motions[STILL]
        there = (still > least).nonzero()[0]
        places = self.rows[PLACE, STILL].take(there, axis=1)
        return there, np.concatenate((places, still.take(there)[None]))

    def placed(self, things: IntArray, time: float, variances: FloatArray) -> None:
        """The lidar placed things (p,) at `time` s, with variances (p,) m² per axis."""
        self.tracks[SEEN, things], self.tracks[VARIANCE, things] = time, variances

    def bear(
        self,
        rows: FloatArray,
        weights: FloatArray,
        seen: float,
        variances: FloatArray,
        pictured: float = -math.inf,
    ) -> None:
        """Add those newborn (m,) that are not hardly there; drop the others that are.

        seen s, variances (m,) m²: of the readings they are born of; pictured s: of the picture.
        """
        tracks = np.zeros((4, len(variances)))
        tracks[SEEN], tracks[PICTURED], tracks[VARIANCE] = seen, pictured, variances
        self.rows = np.concatenate((self.rows, rows), axis=2)
        self.weights = np.concatenate((self.weights, weights), axis=1)
        self.tracks = np.concatenate((self.tracks, tracks), axis=1)
        fading = (self.tracks[SEEN] < seen - _AGAIN_S) & (self.tracks[LABEL] == 0.0)
        least = np.where(fading, LIKELY, _LEAST_EXISTENCE)
        self._keep((self.weights.sum(axis=0) > least).nonzero()[0])
        self.changed()

    def merge_duplicates(self) -> None:
        """Of two hypotheses of one thing the newer stays, with both weights and the older's label.

        They are exclusive: a reading belongs to one of them.
        """
        tracks, there = self.tracks, self.whole[WEIGHT]
        likely = (there > LIKELY).nonzero()[0]
        gone, kept = duplicates(
            self.whole[: Y + 1].take(likely, axis=1),
            tracks[VARIANCE].take(likely),
            tracks[SEEN].take(likely),
            there.take(likely),
        )
        if not len(gone):
            return
        gone, kept = likely.take(gone), likely.take(kept)
        both = np.minimum(there + np.bincount(kept, there.take(gone), len(there)), 1.0)
        self.scale(both / np.maximum(there, 1e-300))
        labels = np.where(tracks[LABEL] > 0.0, tracks[LABEL], math.inf)
        np.minimum.at(labels, kept, labels.take(gone))
        tracks[LABEL] = np.where(labels < math.inf, labels, 0.0)
        stays = np.ones(len(there), dtype=bool)
        stays[gone] = False
        stay = stays.nonzero()[0]
        self._keep(stay)
        self._motions, self._mixtures = self._motions.take(stay, 2), self._mixtures.take(stay, 2)

    def _keep(self, kept: IntArray) -> None:
        self.rows, self.weights = self.rows.take(kept, axis=2), self.weights.take(kept, axis=1)
        self.tracks = self.tracks.take(kept, axis=1)
