"""The Poisson multi-Bernoulli filter over position, velocity, motion mode and class.

The recursion is TOMB/P of Williams 2015 ("Marginal multi-Bernoulli filters: RFS derivation of MHT,
JIPDA and association-based MeMBer", IEEE Trans. Aerospace and Electronic Systems 51(3)), with the
association's marginals by loopy belief propagation (`association`): to predict is its theorem 1, to
update its theorem 2. Each Bernoulli is one thing that may be there, its weight the probability that
it is.
"""

import numpy as np

from host.estimator.thing_filter import ThingFilter
from host.estimator.things.association import associate
from host.messages import FloatArray


class PmbFilter(ThingFilter):
    """Multi-target filter for anonymous teammates (see `host.estimator.interface.Filter`)."""

    _associate = staticmethod(associate)

    def _absent(self, there: FloatArray, missed: FloatArray) -> FloatArray:
        """Probability (n,) that a thing gives no reading: it is missed, or not there at all."""
        return np.asarray(1.0 - there + missed)

    def _total(self, there: FloatArray, after: FloatArray) -> FloatArray:
        """As before, it is there or not."""
        return self._absent(there, after)
