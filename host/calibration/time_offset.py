"""How late a sensor is: a scan over delays, then the delay fitted together with the mounting.

A reading stamped t was made at t - delay. On some paths (a circle at constant speed) a delay and a
turn of the sensor are the same thing; the curvature at the least cost does not show that, the
curve as a whole does: it is flat.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from host.messages import FloatArray


@dataclass(frozen=True, slots=True)
class DelayCurve:
    """What the best fit costs at each delay: delays (k,) s, ascending, and costs (k,)."""

    delays: FloatArray
    costs: FloatArray

    @property
    def best(self) -> float:
        """The delay (s) of least cost: of the parabola through the least one and its neighbours."""
        index = int(np.argmin(self.costs))
        if not 0 < index < len(self.costs) - 1:
            return float(self.delays[index])
        before, here, after = self.costs[index - 1 : index + 2]
        bend = before - 2.0 * here + after
        share = 0.5 * (before - after) / bend if bend > 0.0 else 0.0
        return float(self.delays[index] + share * (self.delays[index + 1] - self.delays[index]))

    def interval(self, rise: float) -> tuple[float, float]:
        """From which to which delay (s) the cost is nowhere sure to be above the least one.

        rise: in the cost, what is significant. Another dip as deep lies inside, too: the interval
        goes from the last delay that is sure to be too small to the first that is sure to be too
        large, or to the end of the scan where the cost has not risen until there.
        """
        inside = np.flatnonzero(self.costs <= float(self.costs.min()) + rise)
        first = max(int(inside[0]) - 1, 0)
        last = min(int(inside[-1]) + 1, len(self.costs) - 1)
        return float(self.delays[first]), float(self.delays[last])


def scan(cost: Callable[[float], float], low: float, high: float, step: float) -> DelayCurve:
    """The cost of the best fit at each delay from `low` to `high` (s), every `step`.

    cost(delay): of everything else fitted at that delay, by a robust measure that does not change
    with the delay (such as the mean of squared errors, each cut off at a fixed bound).
    """
    delays: FloatArray = low + step * np.arange(round((high - low) / step) + 1)
    return DelayCurve(delays, np.array([cost(float(delay)) for delay in delays]))
