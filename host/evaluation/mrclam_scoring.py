"""How filters are scored on MR.CLAM recordings.

The camera sees ±32° and a robot may stay out of it for minutes; what has not been seen for long
cannot be known. So an observer answers only for robots that it has read in the last 5 s; the
others and the landmarks are don't-cares. Estimates hold readings up to the instant and are carried
to it by odometry. Matching is cut off at MRCLAM_CUT_OFF_M.
"""

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from host.config import FilterSettings, Lidar, PmbSettings, RobotConfig
from host.estimator.interface import Filter
from host.estimator.profiles import filter_entry
from host.evaluation.metrics import MRCLAM_CUT_OFF_M, Accumulator, Instant, Row
from host.evaluation.runner import estimates_at
from host.messages import Displacement, FloatArray, IntArray, Positions
from host.recording.elsewhere.mrclam import Dataset, Landmarks

_WARM_UP_S = 60.0
_EVERY_S = 1.0
_REMEMBER_S = 5.0  # T
CAMERA = "camera"  # of ranges and bearings

NewFilter = Callable[[], Filter]

# The camera that reads barcodes, in the place of a lidar: how any filter is set for it. A robot in
# view is read in 0.46 of the frames at 1.5-2 m, but misses come in runs, so as independent ones
# they weigh only a third of that. Some robots return after minutes: an estimate is given up when
# it is known worse than 0.4 m, after 5 s or so.
MRCLAM_ROBOT = RobotConfig(
    name="mrclam",
    lidar=Lidar(
        field_of_view_rad=math.radians(64.0),
        min_range_m=0.9,
        max_range_m=8.0,
        detection_probability=0.14,
        half_range_m=6.0,
        range_steepness_per_m=1.0,
        clutter_per_m2=0.002,
        target_diameter_m=0.011,
        blind_sectors=(),
    ),
    filter=FilterSettings(
        survival_range_m=8.0,
        # Who is read is a robot, or a landmark, which is not scored; robots drive at 6.5 cm/s.
        pmb=PmbSettings(
            speed_mps=0.065,
            appear_per_m2_s=0.1,
            obstacle_share=0.0,
            report_error_m=MRCLAM_CUT_OFF_M,
        ),
    ),
)


def mrclam_maker(name: str, robot: RobotConfig = MRCLAM_ROBOT) -> NewFilter:
    """How a filter is made for the datasets. Raises UserError for one that is not registered."""
    entry = filter_entry(name)
    return entry.make_mrclam or (lambda: entry.make(robot))


def scored_instants(dataset: Dataset) -> list[float]:
    """When to score, s: every second from 60 s after the start while Vicon sees all robots."""
    start, end = dataset.span
    count = int((end - start - _WARM_UP_S) / _EVERY_S) + 1
    grid = [start + _WARM_UP_S + _EVERY_S * k for k in range(max(0, count))]
    return [time for time in grid if dataset.has_vicon(time)]


def score_observer(
    dataset: Dataset,
    observer: int,
    messages: Sequence[Displacement | Positions],
    filter_: Filter,
) -> Accumulator:
    """Run a filter on `messages`, which are the observer's of the dataset, and score it."""
    times, identities = _sightings(messages)
    scored = Accumulator(p=2.0, c=MRCLAM_CUT_OFF_M)
    when = scored_instants(dataset)
    estimates = estimates_at(filter_, messages, when, scored.update_seconds)
    for time, estimate in zip(when, estimates, strict=True):
        recent = identities[(times > time - _REMEMBER_S) & (times <= time)]
        truth = dataset.truth(observer, time)
        wanted = np.isin(truth.identities, recent)
        others = np.concatenate(
            (truth.positions[~wanted], dataset.landmarks_seen_from(observer, time))
        )
        gospa = scored.add(truth.positions[wanted], others, estimate, truth.positions)
        scored.instants.append(Instant(truth, wanted, estimate, gospa))
    return scored


def mrclam_scores(
    dataset: Dataset, new_filter: NewFilter, landmarks: Landmarks
) -> dict[int, Accumulator]:
    """A filter on every observer's recording, by observer."""
    return {
        robot: score_observer(dataset, robot, dataset.messages(robot, landmarks), new_filter())
        for robot in dataset.robots
    }


def mrclam_rows(scores: Mapping[int, Accumulator], name: str, source: str) -> list[Row]:
    """Rows of a filter: one for every observer, then all of them pooled."""
    rows = [scored.row(source, str(robot), name, CAMERA) for robot, scored in scores.items()]
    return [*rows, Accumulator.pooled(scores.values()).row(source, "all", name, CAMERA)]


def _sightings(
    messages: Sequence[Displacement | Positions],
) -> tuple[FloatArray, IntArray]:
    """Time (n,) and robot (n,) of every reading of a robot."""
    seen = [
        (message.time, int(identity))
        for message in messages
        if isinstance(message, Positions) and message.identities is not None
        for identity in message.identities
        if identity >= 0
    ]
    return np.array([time for time, _ in seen]), np.array([who for _, who in seen], dtype=np.int64)
