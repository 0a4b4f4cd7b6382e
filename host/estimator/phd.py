"""The Gaussian-mixture PHD filter over position, velocity, motion mode and class.

The recursion is that of Vo and Ma 2006 ("The Gaussian mixture probability hypothesis density
filter", IEEE Trans. Signal Processing 54(11), eq. 15, 16; propositions 1, 2), with modes of motion
as in Pasha, Vo, Tuan and Ma 2009 ("A Gaussian mixture PHD filter for jump Markov system models",
IEEE Trans. AES 45(3)). A component is the intensity of one thing under each of its modes. State,
models, births and reduction are those of `pmb`; what differs is what a weight is. There it is the
probability of a thing among others, here the expected number of things, each reading shared out by
itself. So one miss takes a weight to 1 - P_D, and what was reported has to be remembered.
"""

import numpy as np

from host.estimator.gaussians.gaussian_mixture import WEIGHT
from host.estimator.thing_filter import LONGEST_S, ThingFilter
from host.estimator.things.association import share_out
from host.estimator.things.things import LABEL
from host.messages import BoolArray, FloatArray


class PhdFilter(ThingFilter):
    """Multi-target filter for anonymous teammates (see `host.estimator.interface.Filter`)."""

    _associate = staticmethod(share_out)

    def _absent(self, there: FloatArray, missed: FloatArray) -> FloatArray:
        """An intensity knows no absence: a reading's weights are over clutter and births only."""
        return np.ones(len(there))

    def _total(self, there: FloatArray, after: FloatArray) -> FloatArray:
        """While the lidar scans, it shows how many there are, and pictures of which class."""
        if self._time - self._scanned <= LONGEST_S:
            # After a long gap nothing may be left of a thing: 0 of 0.
            return np.maximum(after, 1e-300) / np.maximum(there, 1e-300)
        return np.maximum(after, 1.0)

    def _reported(self, teammates: FloatArray) -> BoolArray:
        """Which components (n,) are reported, as in `pmb` by their weight (Vo & Ma, table III).

        One that was reported before is there until its weight falls below `forget_weight`.
        """
        there = self._things.whole[WEIGHT]
        known = (self._things.tracks[LABEL] > 0.0) & (there > self._settings.forget_weight)
        scale = np.where(known, np.maximum(there, 1e-300), 1.0)
        likely = teammates.copy()
        likely[WEIGHT] /= scale
        return super()._reported(likely)
