"""What a replay calls different."""

import numpy as np

from host.messages import Displacement, Estimate
from host.sessions.recordings.replaying import Comparison


def an_estimate(time):
    none = np.zeros(0)
    return Estimate(
        time, np.zeros((0, 2)), np.zeros((0, 2, 2)), none, none, np.zeros(0, dtype=np.int64)
    )


def test_estimates_too_many_or_too_few_are_different():
    step = Displacement(1.0, 0.1, 0.0, 0.0, 0.0)
    a, b = an_estimate(1.0), an_estimate(2.0)
    for fed, equal, different in (
        ([(step, [a]), (a, []), (step, [b]), (b, []), (None, [])], 2, 0),
        ([(step, [a]), (step, [b]), (b, []), (None, [])], 1, 1),  # one was not recorded
        ([(step, []), (a, []), (step, [b]), (b, []), (None, [])], 1, 1),  # one is not made
        ([(step, [a]), (b, []), (None, [])], 0, 1),
        ([(step, [a, b]), (a, []), (None, [])], 1, 0),  # the run was killed
        ([(step, []), (a, []), (None, [a])], 1, 0),  # made at the end
        ([(step, []), (a, []), (None, [])], 0, 1),
    ):
        comparison = Comparison()
        for message, made in fed:
            comparison.take(message, made)
        assert (comparison.equal, comparison.different) == (equal, different)
