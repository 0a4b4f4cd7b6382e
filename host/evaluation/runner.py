"""Drives one filter through recorded messages and asks it for estimates at given instants."""

import copy
import math
from collections.abc import Iterable, Iterator
from time import perf_counter

from host.estimator.interface import Filter
from host.geometry import Path
from host.messages import Bearings, Displacement, Estimate, Message, Positions

_CARRY_AT_LEAST_S = 2.0
_KEEP_S = 10.0


def estimates_at(
    filter_: Filter,
    messages: Iterable[Message],
    instants: Iterable[float],
    update_seconds: list[float],
) -> Iterator[Estimate]:
    """The filter's estimates at `instants` (s, ascending), of all readings up to each.

    messages: displacements, positions and bearings in time order; others are passed over. What
    each predict and update takes is appended to `update_seconds`. The instants leave no trace in
    the filter: it is carried there on a copy.
    """
    path = Path(keep_seconds=_KEEP_S)
    now = math.nan
    waiting = iter(instants)
    instant = next(waiting, math.inf)
    for message in messages:
        if not isinstance(message, Positions | Bearings | Displacement):
            continue
        if isinstance(message, Displacement):
            path.append(message)
        if math.isnan(now):
            now = message.time - (message.interval if isinstance(message, Displacement) else 0.0)
        while instant < message.time:
            yield _estimate_at(filter_, path, now, instant)
            instant = next(waiting, math.inf)
        if not isinstance(message, Displacement):
            motion = path.between(now, message.time)
            start = perf_counter()
            filter_.predict(motion)
            filter_.update(message)
            update_seconds.append(perf_counter() - start)
            now = message.time
        elif message.time - now > _CARRY_AT_LEAST_S:
            # Without readings: before the path forgets how the robot moved.
            filter_.predict(path.between(now, message.time))
            now = message.time
    while instant < math.inf:
        yield _estimate_at(filter_, path, now, instant)
        instant = next(waiting, math.inf)


def _estimate_at(filter_: Filter, path: Path, now: float, instant: float) -> Estimate:
    carried = copy.deepcopy(filter_)
    if instant > now:
        carried.predict(path.between(now, instant))
    return carried.estimate()
