"""A filter with what an evaluation needs around it: timing, labels from truth, kept estimates."""

import copy
from collections.abc import MutableSequence
from time import perf_counter

from host.estimator.interface import Filter, Learning
from host.evaluation.labels import TruthTrack, label_by_track
from host.messages import Bearings, Displacement, Estimate, Positions


class MonitoredFilter:
    """Passes everything on to a filter (see `host.estimator.interface.Filter`) and takes notes.

    update_seconds: what each update takes, with the predict before it, is appended.
    estimates: those made right after readings of the kind kept_after are appended, others not; so
    each teammate's estimate counts once a scan, whatever other sensors there are.
    track: truth from which each reading gets its identity; None: readings stay as they are.
    """

    def __init__(
        self,
        filter_: Filter,
        update_seconds: MutableSequence[float],
        estimates: MutableSequence[Estimate] | None = None,
        track: TruthTrack | None = None,
        kept_after: type[Positions | Bearings] = Positions,
    ) -> None:
        self.learnt = filter_.learnt if isinstance(filter_, Learning) else None
        self._filter = filter_
        self._update_seconds = update_seconds
        self._estimates = estimates
        self._track = track
        self._kept_after = kept_after
        self._predicting = 0.0
        self._keeps = False

    def __deepcopy__(self, memo: dict[int, object]) -> Filter:
        """A copy of the filter alone: what is tried on a copy is not to be noted."""
        return copy.deepcopy(self._filter, memo)

    def predict(self, motion: Displacement) -> None:
        """As the filter's."""
        self._keeps = False  # what is estimated now belongs to no reading
        start = perf_counter()
        self._filter.predict(motion)
        self._predicting += perf_counter() - start

    def update(self, measurement: Positions | Bearings) -> None:
        """As the filter's."""
        self._keeps = isinstance(measurement, self._kept_after)
        if self._track is not None:
            measurement = label_by_track(measurement, self._track)
        start = perf_counter()
        self._filter.update(measurement)
        self._update_seconds.append(self._predicting + perf_counter() - start)
        self._predicting = 0.0

    def estimate(self) -> Estimate:
        """As the filter's."""
        estimate = self._filter.estimate()
        if self._estimates is not None and self._keeps:
            self._estimates.append(estimate)
        return estimate
