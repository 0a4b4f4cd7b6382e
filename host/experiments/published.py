"""Published results of the papers, to compare with ours.

Perera 2021: section 4.1 (simulation: 20 robots in 6x6 m for 300 s) and figure 24 (real: 4 robots
in 3x3 m). Belaroussi 2024 states no numbers: his results are pictures (docs/experiments.md says
what they show).
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from host.evaluation.curves import nearest_errors, time_over, weight_sums
from host.evaluation.metrics import Instant
from host.messages import FloatArray
from host.sources.sensors import LIDAR_AND_CAMERA, LIDAR_ONLY

# Teammates of one observer: in which of the two experiments a source is counted as.
SIMULATED_TEAMMATES, REAL_TEAMMATES = 19, 3
# Figure 24: share of the time for which the error of each teammate was above 30 cm, worst first.
OVER_30CM = {LIDAR_ONLY: (0.207, 0.109, 0.010), LIDAR_AND_CAMERA: (0.127, 0.026, 0.002)}
# Section 4.1: how many of the 20 robots had that error for more than a quarter of the time.
OFTEN = 0.25
OFTEN_OVER = {LIDAR_ONLY: 9.0, LIDAR_AND_CAMERA: 4.0}
# Section 4.1 and figure 8: the sum of all weights, averaged over the run.
MEAN_WEIGHT = {LIDAR_AND_CAMERA: 15.0}


class Comparison(NamedTuple):
    """One measure: its name, where it is published, and both values (nan: not published)."""

    measure: str
    where: str
    ours: float
    published: float


def beside_published(instants: list[Instant], sensors: str) -> Iterator[Comparison]:
    """Our numbers of one filter and choice of sensors beside the thesis'.

    Yields nothing where the number of teammates is that of neither experiment.
    """
    found = nearest_errors(instants)
    over = worst_first(time_over(found.errors))
    if len(found.robots) == REAL_TEAMMATES:
        published = OVER_30CM.get(sensors, (math.nan,) * REAL_TEAMMATES)
        for rank, (ours, theirs) in enumerate(zip(over, published, strict=True), start=1):
            measure = f"time over 30 cm, robot {rank} of 3 (worst first), share"
            yield Comparison(measure, "Perera 2021, fig. 24", float(ours), theirs)
    if len(found.robots) == SIMULATED_TEAMMATES:
        often = float(np.sum(over > OFTEN))
        yield Comparison(
            "robots over 30 cm for more than 25 % of the time",
            "Perera 2021, fig. 7",
            often,
            OFTEN_OVER.get(sensors, math.nan),
        )
        weights, _ = weight_sums(instants)
        yield Comparison(
            "mean sum of the weights",
            "Perera 2021, fig. 8",
            float(np.mean(weights)) if len(weights) else math.nan,
            MEAN_WEIGHT.get(sensors, math.nan),
        )


def worst_first(shares: FloatArray) -> FloatArray:
    """Shares (m,) from the greatest to the smallest; nan (never in range) last."""
    return -np.sort(-shares)
