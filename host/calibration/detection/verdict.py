"""Are there views enough to fit detection to, and what is still missing while the robot drives?"""

import math

import numpy as np

from host.calibration.coverage import DIRECTIONS, missing_directions, tracks_so_far
from host.calibration.detection.camera_views import GATE_SIGMAS, CameraSurvey
from host.calibration.detection.lidar_views import LidarSurvey
from host.calibration.detection.range_curve import RangeCurve, Views
from host.calibration.gathered import Gathered
from host.calibration.result import Check, at_least, at_most
from host.config import Cameras, Lidar
from host.geometry import polar
from host.messages import BoolArray

_LEAST_SCANS, _LEAST_PICTURES, _LEAST_VIEWS = 300, 300, 200
_NEAR_M, _FAR_M, _LEAST_SIDE_VIEWS = 1.0, 1.5, 30
_LEAST_IN_ONE, _LEAST_DIRECTIONS, _LEAST_HEADINGS = 3, 7, 6  # of a direction; directions of 8
_BESIDE_M = 0.06  # candidates further from the truth: a wrong mounting
_NOWHERE_M = 0.5  # where candidates are not looked for any more
_MEAN_ERROR_RAD, _MEAN_SHARE = math.radians(1.0), 0.5
_LEAST_FREE_RAD = 200.0  # over all pictures; 6.3 rad a picture where nobody is
_ADVICE_MOMENTS = 300
_ENOUGH_S = 60.0


def lidar_verdict(
    survey: LidarSurvey, clear: BoolArray, curve: RangeCurve, lidar: Lidar
) -> list[Check]:
    """Conditions on what the lidar saw; clear (n,): the views outside of its blind sectors."""
    off = np.hypot(*survey.offsets[clear].T)
    off = off[np.isfinite(off)]
    offset = float(np.median(off)) if len(off) else _NOWHERE_M
    headings = len(DIRECTIONS) - len(missing_directions(survey.robots[:, 2], _LEAST_IN_ONE))
    return [
        at_least("revolutions of the lidar", len(survey.times), _LEAST_SCANS).otherwise(
            "drive longer"
        ),
        at_least("robot headings covered", headings, _LEAST_HEADINGS).otherwise(
            "rotate the robot all around: a dark wall and a pillar look alike until it does"
        ),
        at_most("offset of candidates from the truth", offset, _BESIDE_M, "mm").otherwise(
            "most turrets are found beside where motion capture has the teammates: run "
            "`swarmloc calibrate lidar` first"
        ),
        *_view_checks("lidar", survey.views.part(clear)),
        *_kept_half_range("lidar", curve, lidar.half_range_m),
    ]


def camera_verdict(
    survey: CameraSurvey, curve: RangeCurve, cameras: Cameras, mean: float
) -> list[Check]:
    """Conditions on what the cameras saw; mean (rad): the mean error of their bearings."""
    return [
        at_least("pictures", len(survey.times), _LEAST_PICTURES).otherwise("drive longer"),
        at_most(
            "mean error of the bearings",
            abs(mean),
            max(_MEAN_ERROR_RAD, _MEAN_SHARE * survey.gate / GATE_SIGMAS),
            "deg",
        ).otherwise(
            "the cameras see teammates beside where they are: run `swarmloc calibrate camera` first"
        ),
        *_view_checks("camera", survey.views),
        at_least(
            "view without teammates", float(survey.free.sum()), _LEAST_FREE_RAD, "rad"
        ).otherwise(
            "false blobs are recognised only away from teammates: use fewer of them, or drive on"
        ),
        *_kept_half_range("camera", curve, cameras.half_range_m),
    ]


def _view_checks(sensor: str, views: Views) -> list[Check]:
    near, far = views.distances < _NEAR_M, views.distances > _FAR_M
    around = len(DIRECTIONS) - len(missing_directions(views.bearings, _LEAST_IN_ONE))
    return [
        at_least(f"{sensor}: views of teammates", len(views), _LEAST_VIEWS).otherwise(
            "keep teammates in plain view, apart from each other, and drive longer"
        ),
        at_least(
            f"{sensor}: views nearer than {_NEAR_M:g} m", near.sum(), _LEAST_SIDE_VIEWS
        ).otherwise("drive close to teammates"),
        at_least(f"{sensor}: views beyond {_FAR_M:g} m", far.sum(), _LEAST_SIDE_VIEWS).otherwise(
            "drive further away from teammates"
        ),
        at_least(
            f"{sensor}: directions with views of teammates", around, _LEAST_DIRECTIONS
        ).otherwise("drive so that teammates are seen on all sides of the robot"),
    ]


def _kept_half_range(sensor: str, curve: RangeCurve, configured_m: float) -> list[Check]:
    """Of a half-range that is kept: no views that speak against it."""
    if curve.reached:
        return []
    return [
        at_most(
            f"{sensor}: views within the half-range that is kept", curve.reach_m, configured_m, "m"
        ).otherwise(
            f"teammates are still detected at {curve.reach_m:.1f} m, beyond the configured "
            "half-range: drive further away from them"
        )
    ]


def detection_advice(gathered: Gathered) -> list[str]:
    """What is still missing while the robot drives, as text; empty when there is enough.

    Raises UserError where motion capture never saw this robot.
    """
    if not gathered.bodies:
        return ["no motion capture yet"]
    if not gathered.scans and not gathered.bearings:
        return ["neither scans nor pictures yet"]
    tracks = tracks_so_far(gathered)
    if not len(tracks.identities):
        return ["motion capture sees no teammate"]
    times = np.linspace(*tracks.span, _ADVICE_MOMENTS)
    seen = tracks.teammates(times).reshape(-1, 2)
    seen = seen[np.isfinite(seen).all(axis=1)]
    distances, bearings = polar(seen)
    length = gathered.bodies[-1].time - gathered.bodies[0].time
    nearest, farthest = float(distances.min(initial=99.0)), float(distances.max(initial=0.0))
    headings = len(DIRECTIONS) - len(missing_directions(tracks.own(times)[:, 2], _LEAST_IN_ONE))
    unseen = missing_directions(bearings, _LEAST_IN_ONE)
    near, far = np.sum(distances < _NEAR_M), np.sum(distances > _FAR_M)
    found = []
    if length < _ENOUGH_S - 1.0:
        found.append(f"drive for {_ENOUGH_S:.0f} s: {length:.0f} s so far")
    if near < _LEAST_IN_ONE:
        found.append(f"drive nearer to teammates than {_NEAR_M:g} m: {nearest:.1f} m so far")
    if far < _LEAST_IN_ONE:
        found.append(f"drive further from teammates than {_FAR_M:g} m: {farthest:.1f} m so far")
    if gathered.scans and headings < _LEAST_HEADINGS:
        found.append(f"rotate all around: {headings} of {len(DIRECTIONS)} directions so far")
    if len(unseen) > len(DIRECTIONS) - _LEAST_DIRECTIONS:
        found.append(f"let a teammate be seen {', '.join(unseen)}")
    return found
