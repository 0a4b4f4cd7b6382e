"""Tracks: what one identity's pose may be if it was read where a hypothesis has it.

A track is a mixture of Gaussians with one tag (eq. 13): several headings fit until its robot has
driven. Many hypotheses share a track, so it is predicted and updated once.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from host.messages import BoolArray, FloatArray, IntArray
from host.systems.id_phd.poses import Poses, alike, joined, no_poses, summed, updated

_LEAST_LOG_WEIGHT = math.log(1e-3)  # of a component in its track
_ONE_COMPONENT, _ONE_TRACK = 1.0, 0.3  # squared distances below which two say the same


@dataclass(frozen=True, slots=True)
class Tracks:
    """tags (t,): whose track it is, as a row of the hypotheses. of (k,): each component's track,
    never falling. poses: k components. log_weights (k,): of each in its track, where they sum to 1.
    """

    tags: IntArray
    of: IntArray
    poses: Poses
    log_weights: FloatArray

    def __len__(self) -> int:
        return len(self.tags)

    def total(self, log_values: FloatArray) -> FloatArray:
        """log of the sum of exp(log_values) (k, ...) over each track's components, (t, ...)."""
        if not len(self):
            return np.zeros((0, *log_values.shape[1:]))
        starts = np.searchsorted(self.of, np.arange(len(self)))
        return np.asarray(np.logaddexp.reduceat(log_values, starts, axis=0))

    def means(self) -> Poses:
        """Each track as one Gaussian."""
        heaviest = np.lexsort((-self.log_weights, self.of))
        leaders = heaviest[np.searchsorted(self.of, np.arange(len(self)))]
        return summed(self.poses, self.log_weights, self.of, leaders)[0]

    def only(self, used: IntArray) -> "Tracks":
        """Those of `used`, rising; renumbered."""
        rows = np.flatnonzero(np.isin(self.of, used))
        of = np.searchsorted(used, self.of[rows])
        return Tracks(self.tags[used], of, self.poses.take(rows), self.log_weights[rows])


def no_tracks() -> Tracks:
    """None at all."""
    empty = np.zeros(0, dtype=np.int64)
    return Tracks(empty, empty, no_poses(), np.zeros(0))


def after_frame(
    tracks: Tracks,
    chosen: IntArray,
    log_weights: FloatArray,
    positions: FloatArray,
    covariances: FloatArray,
) -> Tracks:
    """Tracks that went on. chosen (n, 2): track, and reading that it took or -1; in any order.

    log_weights (k, 1 + m): of each component if it took no reading, and each of the m readings.
    """
    bounds = np.searchsorted(tracks.of, np.arange(len(tracks) + 1))
    sizes = np.diff(bounds)[chosen[:, 0]]
    of = np.repeat(np.arange(len(chosen)), sizes)
    within = np.arange(len(of)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    rows = bounds[chosen[of, 0]] + within
    read = chosen[of, 1]
    poses, took = tracks.poses.take(rows), np.flatnonzero(read >= 0)
    after = updated(poses.take(took), positions[read[took]], covariances[read[took]])
    poses.means[took], poses.covariances[took] = after.means, after.covariances
    return Tracks(tracks.tags[chosen[:, 0]], of, poses, log_weights[rows, read + 1])


def started(banks: list[tuple[int, Poses]]) -> Tracks:
    """New tracks of (tag, components), which weigh the same."""
    if not banks:
        return no_tracks()
    sizes = np.array([len(poses) for _, poses in banks])
    of = np.repeat(np.arange(len(banks)), sizes)
    tags = np.array([tag for tag, _ in banks])
    return Tracks(tags, of, joined([poses for _, poses in banks]), np.zeros(len(of)))


def side_by_side(first: Tracks, second: Tracks) -> Tracks:
    """Both, those of `second` numbered after those of `first`."""
    return Tracks(
        np.concatenate((first.tags, second.tags)),
        np.concatenate((first.of, second.of + len(first))),
        joined([first.poses, second.poses]),
        np.concatenate((first.log_weights, second.log_weights)),
    )


def pruned(tracks: Tracks) -> Tracks:
    """Weights scaled to 1 a track; components that hardly count left out."""
    scaled = _scaled(tracks)
    rows = np.flatnonzero(scaled.log_weights > _LEAST_LOG_WEIGHT)
    kept = Tracks(tracks.tags, tracks.of[rows], tracks.poses.take(rows), scaled.log_weights[rows])
    return _scaled(kept)


def _scaled(tracks: Tracks) -> Tracks:
    total = tracks.total(tracks.log_weights)[tracks.of]
    return replace(tracks, log_weights=tracks.log_weights - total)


def merged(tracks: Tracks) -> Tracks:
    """Components of one track that say the same become one, with their mean and covariance."""
    if len(tracks.of) == len(tracks):
        return tracks
    leader = _led(alike(tracks.poses, tracks.of, _ONE_COMPONENT), tracks.log_weights)
    # By track, then by component: `of` never falls, and no group spans two tracks.
    leaders, groups = np.unique(leader, return_inverse=True)
    order = np.argsort(tracks.of[leaders], kind="stable")
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    poses, weights = summed(tracks.poses, tracks.log_weights, place[groups.ravel()], leaders[order])
    return Tracks(tracks.tags, tracks.of[leaders[order]], poses, weights)


def same_track(tracks: Tracks, masses: FloatArray) -> IntArray:
    """For each track the one that stands for it: of one tag, never of two, and saying the same."""
    return _led(alike(tracks.means(), tracks.tags, _ONE_TRACK), masses)


def _led(same: BoolArray, weights: FloatArray) -> IntArray:
    """For each (n,) the heaviest that is alike and follows none itself."""
    leader = np.full(len(weights), -1)
    for row in np.argsort(-weights, kind="stable"):
        if leader[row] < 0:
            leader[same[row] & (leader < 0)] = row
    return leader
