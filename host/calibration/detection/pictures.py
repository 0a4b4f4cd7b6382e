"""What to draw of a calibration of detection."""

import math

import numpy as np

from host.calibration.detection.blind_sectors import FoundSector
from host.calibration.detection.camera_views import CameraSurvey
from host.calibration.detection.clutter import Clutter
from host.calibration.detection.lidar_views import LidarSurvey
from host.calibration.detection.range_curve import RangeCurve, Views
from host.calibration.result import ReportPicture, Series, thinned
from host.messages import BoolArray, FloatArray

_BIN_M, _BIN_RAD = 0.25, math.radians(5.0)
_BLIND_M = 2.0  # detection by bearing is that of views nearer than this
_NEAREST_BIN_VIEWS = 5


def lidar_pictures(
    survey: LidarSurvey,
    clear: BoolArray,
    curve: RangeCurve,
    sectors: list[FoundSector],
    clutter: Clutter,
) -> list[ReportPicture]:
    """Detection by range and by bearing, what is off, and clutter; clear (n,): not blind."""
    views = survey.views
    seen = clear & views.seen
    along, across = 1e3 * survey.offsets[seen].T
    robots, false, standing = survey.robots, clutter.places, clutter.standing
    return [
        _by_range("lidar", views.part(clear), curve),
        _by_bearing("lidar", views.part(views.distances < _BLIND_M), sectors),
        ReportPicture(
            title="Errors of the lidar's readings",
            axes=("range, m", "reading minus truth, mm"),
            series=(
                thinned(views.distances[seen], along, "along the line of sight", "along"),
                thinned(views.distances[seen], across, "across", "across"),
            ),
            caption="Readings that lie evenly about zero: mounting and delay are right.",
        ),
        ReportPicture(
            title="False candidates on the floor",
            axes=("x, m", "y, m"),
            series=(
                Series(robots[:, 0], robots[:, 1], "the robot's path", "reference", "line"),
                thinned(false[:, 0], false[:, 1], "clutter", "measured"),
                thinned(standing[:, 0], standing[:, 1], "stands there all the time", "refused"),
            ),
            caption="What stands there all the time is kept as an obstacle and is no clutter.",
            equal=True,
        ),
    ]


def camera_pictures(survey: CameraSurvey, curve: RangeCurve) -> list[ReportPicture]:
    """Detection by range and by bearing, what bearings are off, and false ones."""
    views = survey.views
    seen = views.seen
    errors = np.degrees(survey.errors[seen])
    times, bearings = survey.places.T
    return [
        _by_range("cameras", views, curve),
        _by_bearing("cameras", views.part(views.distances < _BLIND_M), []),
        ReportPicture(
            title="Errors of the cameras' bearings",
            axes=("bearing, deg", "bearing minus truth, deg"),
            series=(thinned(np.degrees(views.bearings[seen]), errors, role="measured"),),
            caption="A wave about zero is a lens or a mounting that is not right yet.",
        ),
        ReportPicture(
            title="False bearings",
            axes=("time, s", "bearing, deg"),
            series=(thinned(times - survey.times.min(), np.degrees(bearings), role="measured"),),
            caption="A row at one bearing is something red that the robot carries; one at 90 deg "
            "to either side is the seam between the two cameras.",
        ),
    ]


def _shares(
    values: FloatArray, seen: BoolArray, edges: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Middles of the bins that hold some values, and the shares seen in them."""
    total, _ = np.histogram(values, edges)
    hits, _ = np.histogram(values[seen], edges)
    some = total >= _NEAREST_BIN_VIEWS
    return (0.5 * (edges[1:] + edges[:-1]))[some], hits[some] / total[some]


def _by_range(sensor: str, views: Views, curve: RangeCurve) -> ReportPicture:
    end = float(views.distances.max()) + _BIN_M
    middles, shares = _shares(views.distances, views.seen, np.arange(0.0, end, _BIN_M))
    line = np.linspace(0.0, end, 100)
    return ReportPicture(
        title=f"Detection by range, {sensor}",
        axes=("range, m", "share of views"),
        series=(
            Series(middles, shares, "detected", "measured", "bars"),
            Series(line, curve.at(line), "fitted curve", "fitted", "line"),
        ),
        caption="Bars follow the curve as far as the data reach.",
    )


def _by_bearing(sensor: str, views: Views, sectors: list[FoundSector]) -> ReportPicture:
    edges = np.arange(-math.pi, math.pi + 0.5 * _BIN_RAD, _BIN_RAD)
    middles, shares = _shares(views.bearings, views.seen, edges)
    series = [Series(np.degrees(middles), shares, "detected", "measured", "bars")]
    if sectors:
        line = np.radians(np.arange(-180.0, 180.0, 0.25))
        open_ = 1.0 - np.any([each.within(line, 0.0) for each in sectors], axis=0)
        series.append(Series(np.degrees(line), open_, "blind sectors: 0", "fitted", "line"))
    return ReportPicture(
        title=f"Detection by bearing, {sensor}, nearer than {_BLIND_M:g} m",
        axes=("bearing, deg", "share of views"),
        series=tuple(series),
        caption="Gaps are where the robot's own pillars hide teammates."
        if sectors
        else "About the same all around.",
    )
