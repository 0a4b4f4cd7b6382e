"""Scans and true paths → every view the lidar had of a teammate, and what it saw that was none."""

import math
from dataclasses import dataclass

import numpy as np

from host.calibration.detection.blind_sectors import FoundSector
from host.calibration.detection.crossings import Crossings, true_path
from host.calibration.detection.range_curve import Views
from host.calibration.gathered import Gathered, Tracks, untracked
from host.calibration.robust.statistics import ratio_variance
from host.config import Lidar
from host.drivers.x4.packets import angle_correction
from host.geometry import SECTORS, Path, polar, sector, to_frame, to_parent, wrap
from host.messages import BoolArray, FloatArray, Positions, Scan
from host.perception.turrets import turrets

GATE_M = 0.12  # a candidate is the teammate this near: half of what robots keep apart
_SEARCH_M = 0.5  # how far candidates are looked for, by which a wrong mounting is noticed
_HIDING_M = 0.12  # a thing nearer by more than this hides
_EVERYWHERE_M = 12.0  # the curve is that of the finder, however much of it is used
_CORE = 0.8  # of the turret's radius: samples further aside may be of what is behind
_REACH_M = 0.02  # samples this far off the circle are of the turret
_BLIND_MARGIN_RAD = math.radians(1.0)
_WIDEST_GAP_RAD = math.radians(3.0)
_NEAREST_RANGE_M = 0.3  # as the finder has it: noise falls no further


@dataclass(frozen=True, slots=True)
class LidarSurvey:
    """What one drive's scans show, held against the truth: scans (s,), views (n,).

    times (s,): ends of the scans. views: of teammates in plain view, be it where the lidar is
    blind. offsets (n, 2) m: the nearest candidate minus the truth, along and across the line of
    sight, nan where there is none in half a metre. nulls (n,): share of the samples on the
    teammate that gave no return. scatter (n, 2): squares (summed) of how far samples are off the
    fitted circle, in units of the range noise of 1 m, and how many are free of the fit.
    false (f, 3): scan and place on the floor of candidates that are no teammates, within the
    range that is used. areas (s,) m²: what was in view, there; 0 where not all were tracked.
    clearances (s, SECTORS) m and robots (s, 3): see Positions; the robot on the floor.
    """

    times: FloatArray
    views: Views
    offsets: FloatArray
    nulls: FloatArray
    scatter: FloatArray
    false: FloatArray
    areas: FloatArray
    clearances: FloatArray
    robots: FloatArray


def open_to(
    bearings: FloatArray, distances: FloatArray, sectors: list[FoundSector], lidar: Lidar
) -> BoolArray:
    """Which directions (n,) rad show a turret at distances (n,) m clear of all blind sectors."""
    half = np.arcsin(np.minimum(0.5 * lidar.target_diameter_m / distances, 1.0))
    clear = np.ones(len(bearings), dtype=bool)
    for blind in sectors:
        clear &= ~blind.within(bearings, half + _BLIND_MARGIN_RAD)
    return clear


def survey_lidar(gathered: Gathered, tracks: Tracks) -> LidarSurvey:
    """Run the turret finder over all scans and compare it with motion capture.

    Raises UserError where no scan falls into the time in which the robot was tracked.
    """
    lidar = gathered.config.lidar
    scans = _tracked(gathered.scans, tracks)
    if not scans:
        raise untracked("no revolution of the lidar")
    crossings = Crossings(scans, tracks, lidar)
    plain = crossings.plain(lidar)
    finder = lidar.model_copy(update={"max_range_m": _EVERYWHERE_M})
    rows: list[tuple[int, int]] = []
    measured: list[tuple[float, ...]] = []
    false: list[FloatArray] = [np.zeros((0, 3))]
    areas, clearances = np.zeros(len(scans)), np.zeros((len(scans), SECTORS))
    for s, scan in enumerate(scans):
        path = true_path(scan, tracks)
        found = turrets.find(scan, finder, path)
        if found.clearance is not None:
            clearances[s] = found.clearance
        for j in np.flatnonzero(plain[s]).tolist():
            if not behind_something(crossings.places[s, [j]], clearances[[s]], lidar)[0]:
                rows.append((s, j))
                measured.append(_view(scan, found, crossings, (s, j), path, lidar))
        if np.isfinite(crossings.ways[s]).all():
            areas[s] = visible_area(scan, lidar.max_range_m)
            false.append(_false(s, found, crossings, lidar))
    which, mates = np.array(rows, dtype=np.int64).reshape(-1, 2).T
    table = np.array(measured).reshape(-1, 5)
    views = Views(
        times=crossings.times[which, mates],
        teammates=tracks.identities[mates],
        distances=crossings.distances[which, mates],
        bearings=crossings.bearings[which, mates],
        seen=np.hypot(table[:, 0], table[:, 1]) < GATE_M,
        caught=np.ones(len(which)),
        mistaken=np.zeros(len(which)),
    )
    return LidarSurvey(
        np.array([scan.time for scan in scans]),
        views,
        table[:, :2],
        table[:, 2],
        table[:, 3:],
        np.concatenate(false),
        areas,
        clearances,
        crossings.robots,
    )


def _tracked(scans: list[Scan], tracks: Tracks) -> list[Scan]:
    scans = [scan for scan in scans if len(scan.times)]
    starts, ends = np.array([(scan.times[0], scan.time) for scan in scans]).reshape(-1, 2).T
    known = np.isfinite(np.hstack((tracks.own(starts), tracks.own(ends)))).all(axis=1)
    return [scans[k] for k in np.flatnonzero(known)]


def behind_something(places: FloatArray, clearances: FloatArray, lidar: Lidar) -> BoolArray:
    """Which turrets at places (n, 2) m the scans show to be behind something nearer, in part.

    clearances (n, SECTORS) m. What hides is nearer than the turret, so this does not depend on
    whether the turret itself was detected.
    """
    distance, bearing = polar(places)
    half = np.arcsin(np.minimum(0.5 * lidar.target_diameter_m / distance, 1.0))
    rays = wrap(bearing[:, None] + half[:, None] * np.linspace(-1.0, 1.0, 5))
    free = np.take_along_axis(clearances, sector(rays), axis=1)
    # A sector of no samples shows nothing.
    free = np.where(free > 0.0, free, np.inf)
    return np.asarray(free.min(axis=1) < distance - _HIDING_M)


def visible_area(scan: Scan, max_range_m: float) -> float:
    """How much floor (m²) lies between the lidar and what it met, within the range used.

    Triangles between returns side by side. Where nothing came back for longer, nothing was seen.
    """
    returned = scan.ranges > 0.0
    order = np.argsort(scan.angles[returned], kind="stable")
    angles = scan.angles[returned][order]
    reach = np.minimum(scan.ranges[returned][order], max_range_m)
    gaps = np.diff(angles, append=angles[:1] + math.tau)
    gaps[gaps > _WIDEST_GAP_RAD] = 0.0
    return 0.5 * float(np.sum(reach * np.roll(reach, -1) * np.sin(gaps)))


def _view(
    scan: Scan,
    found: Positions,
    crossings: Crossings,
    which: tuple[int, int],
    path: Path,
    lidar: Lidar,
) -> tuple[float, ...]:
    """One view as a row: offset along and across, share of nulls, scatter, degrees of freedom."""
    truth, way, beam = crossings.places[which], crossings.ways[which], crossings.beams[which]
    half = math.asin(min(0.5 * lidar.target_diameter_m / way, 1.0))
    returned = scan.ranges > 0.0
    # Nulls carry the angle without the correction that a return from here would have had.
    angles = np.where(returned, scan.angles, scan.angles - float(angle_correction(way)))
    on_it = np.abs(wrap(angles - beam)) < _CORE * half
    nulls = float(np.mean(~returned[on_it])) if on_it.any() else math.nan
    off = found.positions - truth
    if not len(off) or np.hypot(*off.T).min() > _SEARCH_M:
        return math.nan, math.nan, nulls, 0.0, 0.0
    nearest = int(np.argmin(np.hypot(*off.T)))
    origin = crossings.origin(scan, float(crossings.times[which]), path)
    ray = (truth - origin) / max(float(np.hypot(*(truth - origin))), 1e-9)
    along, across = to_frame(
        off[nearest], np.array([0.0, 0.0, math.atan2(ray[1], ray[0])])
    ).tolist()
    scatter, free = 0.0, 0.0
    if math.hypot(along, across) < GATE_M:
        points = crossings.points(
            scan, returned & (np.abs(wrap(scan.angles - beam)) < 2 * half), path
        )
        scatter, free = _scatter(points - found.positions[nearest], ray, lidar)
        scatter /= max(way, _NEAREST_RANGE_M) ** 2
    return along, across, nulls, scatter, free


def _scatter(points: FloatArray, ray: FloatArray, lidar: Lidar) -> tuple[float, float]:
    """How far points (n, 2), from a turret's fitted centre, are off its circle along the beam.

    Sum of squares (m²) after the best shift of the centre, and its degrees of freedom.
    """
    radius = 0.5 * lidar.target_diameter_m
    length = np.hypot(*points.T)
    aside = np.abs(ray[0] * points[:, 1] - ray[1] * points[:, 0])
    chosen = (np.abs(length - radius) < _REACH_M) & (aside < _CORE * radius)
    if chosen.sum() < 3:
        return 0.0, 0.0
    units = points[chosen] / length[chosen, None]
    facing = np.maximum(-(units @ ray), 0.5)
    design = units / facing[:, None]
    residual = (length[chosen] - radius) / facing
    shift = np.linalg.lstsq(design, residual, rcond=None)[0]
    rest = residual - design @ shift
    return float(rest @ rest), float(chosen.sum() - 2)


def _false(s: int, found: Positions, crossings: Crossings, lidar: Lidar) -> FloatArray:
    """Candidates (f, 3) of a scan that no teammate is near: scan, place on the floor."""
    mount = np.array([lidar.x_m, lidar.y_m])
    used = np.hypot(*(found.positions - mount).T) <= lidar.max_range_m
    away = np.hypot(*np.moveaxis(found.positions[:, None] - crossings.places[s], 2, 0))
    places = to_parent(found.positions[used & (away >= GATE_M).all(axis=1)], crossings.robots[s])
    return np.column_stack((np.full(len(places), float(s)), places))


def range_noise(survey: LidarSurvey, chosen: BoolArray) -> tuple[float, float]:
    """Standard deviation (m) of one sample at 1 m, and its own; nan where no view is of use.

    chosen (n,): the views to go by.
    """
    squares, free = survey.scatter[chosen].T
    if free.sum() < 1.0:
        return math.nan, math.nan
    variance = float(squares.sum() / free.sum())
    blocks = survey.views.part(chosen).blocks
    spread = math.sqrt(ratio_variance(squares, free, variance, blocks))
    return math.sqrt(variance), 0.5 * spread / math.sqrt(max(variance, 1e-12))
