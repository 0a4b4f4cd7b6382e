"""Whether a fit of the lidar's mounting is to be used, and what to do where it is not."""

from dataclasses import dataclass

import numpy as np

from host.calibration.coverage import DIRECTIONS, missing_directions
from host.calibration.result import Check, at_least, at_most
from host.calibration.robust.time_offset import DelayCurve
from host.geometry import polar
from host.messages import BoolArray, FloatArray

_LEAST_DIRECTIONS, _LEAST_IN_ONE = 7, 10
_LEAST_RANGES_M = 0.6
_LEAST_PAIRS, _LEAST_SHARE = 100, 0.1
WIDEST_S = 0.1  # of the plausible delays
STEP_S = 0.02  # from one delay that is searched to the next
_LEAST_BEYOND_S = 0.5 * STEP_S
_LARGEST_RMS_M = 0.02
_PERCENTILES = [5.0, 95.0]


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """A fit and its data. Rows (n,) are turrets that were taken for teammates.

    truths (n, 2) m: where these were, in the robot frame; errors, before (n, 2) m: where the lidar
    put them, less the truth, as fitted and as configured. used (n,): not rejected as wrong.
    origin (2,) m: the lidar. candidates: all turrets. curve: cost by the delay in all;
    plausible: from which to which delay (s) it does not rise significantly.
    """

    truths: FloatArray
    errors: FloatArray
    before: FloatArray
    used: BoolArray
    origin: FloatArray
    candidates: int
    curve: DelayCurve
    plausible: tuple[float, float]

    @property
    def beyond(self) -> float:
        """How far (s) the delays searched go on beyond the plausible ones, on the shorter side."""
        first, last = self.curve.delays[[0, -1]]
        return float(min(self.plausible[0] - first, last - self.plausible[1]))

    @property
    def separable(self) -> bool:
        """Whether the path separates the delay from a rotation of the lidar."""
        low, high = self.plausible
        return high - low <= WIDEST_S and self.beyond >= _LEAST_BEYOND_S

    @property
    def share(self) -> float:
        """Of all turrets those that were teammates, 0 to 1."""
        return float(np.count_nonzero(self.used)) / max(self.candidates, 1)

    @property
    def rms(self) -> float:
        """Of the length of the errors of what was used, m."""
        return float(np.sqrt(np.mean(np.sum(self.errors[self.used] ** 2, axis=1))))

    @property
    def polar(self) -> tuple[FloatArray, FloatArray]:
        """Range (m) and bearing (rad) of what was used (k,), from the lidar."""
        return polar(self.truths[self.used] - self.origin)

    @property
    def along_across(self) -> tuple[FloatArray, FloatArray]:
        """Errors (k,) m of what was used: along the beam (away from the lidar), and across."""
        offset = self.truths[self.used] - self.origin
        x, y = (offset / np.maximum(np.hypot(*offset.T), 1e-9)[:, None]).T
        errors = self.errors[self.used]
        return errors[:, 0] * x + errors[:, 1] * y, errors[:, 1] * x - errors[:, 0] * y


def coverage_checks(ranges: FloatArray, bearings: FloatArray) -> tuple[Check, Check, Check]:
    """Whether teammates were seen often enough, all around, near and far: ranges m, bearings rad.

    Both (n,), of the sightings so far.
    """
    missing = missing_directions(bearings, _LEAST_IN_ONE)
    near, far = np.percentile(ranges, _PERCENTILES) if len(ranges) else (0.0, 0.0)
    return (
        at_least("teammates seen", len(ranges), _LEAST_PAIRS).otherwise(
            f"drive on, with a teammate 0.5 to 2 m away: {len(ranges)} sightings so far, "
            f"{_LEAST_PAIRS} are needed"
        ),
        at_least(
            "bearings covered", len(DIRECTIONS) - len(missing), _LEAST_DIRECTIONS, "of 8 directions"
        ).otherwise(f"let a teammate be seen {', '.join(missing)}"),
        at_least("ranges covered", far - near, _LEAST_RANGES_M, "m").otherwise(
            f"let a teammate come from 0.5 to 2 m away: {near:.1f} to {far:.1f} m so far"
        ),
    )


def verdict(outcome: Outcome) -> tuple[Check, ...]:
    """The conditions under which the fit is to be used."""
    seen, around, near_and_far = coverage_checks(*outcome.polar)
    return (
        seen,
        at_least("turrets that are teammates", outcome.share, _LEAST_SHARE, "%").otherwise(
            "see that [mocap] body is this robot, that every robot on the floor has a body, and "
            "clear the floor of other things as thin as a turret"
        ),
        *_delay_checks(outcome),
        around,
        near_and_far,
        at_most("residual", outcome.rms, _LARGEST_RMS_M, "mm rms").otherwise(
            "the lidar and motion capture do not agree: see that the bodies' origins are above the "
            "middle of the turrets, and that lidar.target_diameter_m is right"
        ),
    )


def _delay_checks(outcome: Outcome) -> tuple[Check, Check]:
    """That one delay stands out, and that it is not at an end of those that were searched."""
    low, high = outcome.plausible
    first, last = outcome.curve.delays[[0, -1]]
    end = "longest" if last - high < low - first else "shortest"
    return (
        at_most("delays that fit as well as the best", high - low, WIDEST_S, "ms").otherwise(
            f"all delays from {1e3 * low:.0f} to {1e3 * high:.0f} ms fit as well, since on a path "
            "like a circle at constant speed, delay and rotation of the lidar are one; rotate "
            "both ways, and change the speed"
        ),
        at_least(
            "delays searched beyond those that fit", outcome.beyond, _LEAST_BEYOND_S, "ms"
        ).otherwise(
            f"of the delays searched, {1e3 * first:.0f} to {1e3 * last:.0f} ms, the {end} fits "
            "about as well as the best, so the true one may lie beyond: see that lidar and motion "
            "capture are stamped by one clock, or rotate both ways and change the speed"
        ),
    )
