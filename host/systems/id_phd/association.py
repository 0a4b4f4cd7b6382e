"""Which robot was read: joint hypotheses, in place of weights of tags that know nothing of others.

A hypothesis has for every row, a false thing or an identity, the track where it is, or NOWHERE.
Of one frame a robot has one reading at most, and a reading is of one robot, so readings are
given out one after the other, and what cannot be is left out.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from host.messages import BoolArray, FloatArray, IntArray

NOWHERE = -1
_UNREAD = -1
_LEAST_LOG_WEIGHT = -12.0  # beside the best


@dataclass(frozen=True, slots=True)
class Hypotheses:
    """tracks (n, rows): of each row, or NOWHERE. log_weights (n,): they sum to 1."""

    tracks: IntArray
    log_weights: FloatArray

    def masses(self, count: int) -> FloatArray:
        """Probability of each of `count` tracks."""
        masses = np.zeros(count + 1)
        np.add.at(masses, self.tracks, np.exp(self.log_weights)[:, None])
        return masses[:count]


@dataclass(frozen=True, slots=True)
class Frame:
    """log likelihoods of m readings of one frame.

    missed (t,): that a track was not read. read (t, m): that it is the reading.
    first (rows, m): the reading is the first of its row, or -inf. restart: log of how likely a
    reading is of a robot that has a track elsewhere. nothing: that a reading is of nothing.
    unnamed: how many rows, the first ones, are false things.
    """

    missed: FloatArray
    read: FloatArray
    first: FloatArray
    restart: float
    nothing: float
    unnamed: int


@dataclass(frozen=True, slots=True)
class Given:
    """Readings given out: hypothesis (n,) it came from, log weight (n,), and for each row (n, rows)
    the reading it took or -1, and whether its track starts there."""

    origin: IntArray
    log_weights: FloatArray
    readings: IntArray
    starts: IntArray


def associate(hypotheses: Hypotheses, frame: Frame, most: int) -> Given:
    """The `most` best ways to give out the readings, over all hypotheses (eq. 11 for each)."""
    missed = np.append(frame.missed, 0.0)
    shape = hypotheses.tracks.shape
    given = Given(
        np.arange(shape[0]),
        hypotheses.log_weights + missed[hypotheses.tracks].sum(axis=1),
        np.full(shape, _UNREAD),
        np.zeros(shape, dtype=np.int64),
    )
    for reading in range(frame.first.shape[1]):
        given = _give(given, hypotheses.tracks, frame, missed, reading, most)
    best = _best(given.log_weights, most)
    weights = given.log_weights[best]
    return Given(
        given.origin[best], weights - logsumexp(weights), given.readings[best], given.starts[best]
    )


def _give(
    given: Given, tracks: IntArray, frame: Frame, missed: FloatArray, reading: int, most: int
) -> Given:
    """One reading to a row that goes on, to one that starts, or to nothing."""
    track = tracks[given.origin]
    gain = np.append(frame.read[:, reading], -np.inf) - missed
    taken = given.readings != _UNREAD
    goes_on = np.where(taken, -np.inf, gain[track])
    starts = frame.first[:, reading] + np.where(
        track == NOWHERE, 0.0, frame.restart - missed[track]
    )
    starts[taken] = -np.inf
    starts[:, : frame.unnamed][~_next_free(track, given, frame.unnamed)] = -np.inf
    nothing = np.full((len(track), 1), frame.nothing)
    weights = given.log_weights[:, None] + np.hstack((goes_on, starts, nothing))
    best = _best(weights, most)
    rows = tracks.shape[1]
    parents, choices = np.divmod(best, 2 * rows + 1)
    readings, begun = given.readings[parents], given.starts[parents]
    took = np.flatnonzero(choices < 2 * rows)
    readings[took, choices[took] % rows] = reading
    begun[took, choices[took] % rows] = choices[took] >= rows
    return Given(given.origin[parents], weights.ravel()[best], readings, begun)


def _next_free(track: IntArray, given: Given, unnamed: int) -> BoolArray:
    """Where (n, unnamed) a new false thing starts: in the first free row, as none has a name."""
    free = (track[:, :unnamed] == NOWHERE) & (given.readings[:, :unnamed] == _UNREAD)
    return np.asarray(free & (np.cumsum(free, axis=1) == 1))


def _best(log_weights: FloatArray, most: int) -> IntArray:
    flat = log_weights.ravel()
    order = np.argsort(-flat, kind="stable")[:most]
    return np.asarray(order[flat[order] > flat[order[0]] + _LEAST_LOG_WEIGHT])


def renamed(hypotheses: Hypotheses, names: IntArray) -> Hypotheses:
    """With names (t,) for tracks, or NOWHERE; hypotheses that then say the same become one."""
    tracks = np.append(names, NOWHERE)[hypotheses.tracks]
    tracks, inverse = np.unique(tracks, axis=0, return_inverse=True)
    weights = np.full(len(tracks), -np.inf)
    np.logaddexp.at(weights, inverse.ravel(), hypotheses.log_weights)
    return Hypotheses(tracks, weights)
