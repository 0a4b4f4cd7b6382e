"""Raw samples of a whole drive → the directions in which the robot itself hides the lidar's view.

Behind a pillar nothing ever comes back, whatever heading the robot has. A sample without a return
has no sure direction (the X4 corrects its angles by the range), so only returns are counted: how
many came from each direction, against what comes from beside it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import find_objects, grey_closing, label, maximum_filter1d, percentile_filter

from host.calibration.robust.statistics import jackknife_sigma
from host.config import Lidar
from host.geometry import wrap
from host.messages import BoolArray, FloatArray, Scan

_BINS = 1800
_BIN_RAD = math.tau / _BINS
_AROUND = 301  # bins by which the usual count in a direction is known
_EDGE, _BESIDE = 5, 21  # bins an edge may be blurred over; those that the usual count is of
_NOTHING = 0.02  # of the usual: a stray return does not make a pillar transparent
_LEAST_USUAL = 12.0  # returns in a bin, for none to be significant
_NARROWEST_RAD, _WIDEST_RAD = math.radians(1.0), 3.1
_PIECES = 8  # of the drive, each left out once
_RESOLUTION_RAD = _BIN_RAD * np.array([0.1, 0.2])  # of a centre and of a width
_SAME_RAD = math.radians(3.0)


@dataclass(frozen=True, slots=True)
class FoundSector:
    """A blind sector: centre and width (rad, robot frame), and their standard deviations."""

    centre: float
    width: float
    centre_sigma: float = math.nan
    width_sigma: float = math.nan

    def within(self, bearings: FloatArray, margin: FloatArray | float) -> BoolArray:
        """Which bearings (n,) are in the sector or nearer to it than the margin (rad)."""
        return np.asarray(np.abs(wrap(bearings - self.centre)) < 0.5 * self.width + margin)


def find_sectors(scans: Sequence[Scan], lidar: Lidar) -> list[FoundSector]:
    """Blind sectors by their centres, in directions from the lidar's axis, robot frame.

    Edges are where half of the usual number of returns comes. Returns nearer than the configured
    least range are the pillars themselves. None where too few scans are given.
    """
    counts = np.zeros((_PIECES, _BINS))
    for number, scan in enumerate(scans):
        seen = scan.ranges >= max(lidar.min_range_m, 1e-6)
        bearing = wrap(scan.angles[seen] + lidar.heading_rad)
        place = ((bearing + math.pi) / _BIN_RAD).astype(np.int64) % _BINS
        counts[number * _PIECES // len(scans)] += np.bincount(place, minlength=_BINS)
    total = counts.sum(axis=0)
    found = _sectors(total, lidar)
    others = [_sectors(total - left_out, lidar) for left_out in counts]
    return [with_sigmas(sector, others) for sector in found]


def same_sector(sector: FoundSector, sectors: Sequence[FoundSector]) -> FoundSector | None:
    """The one of `sectors` that is the same as `sector`, if any."""
    near = [s for s in sectors if _apart(s, sector) < _SAME_RAD + s.width / 2]
    return min(near, key=lambda s: _apart(s, sector), default=None)


def _apart(one: FoundSector, other: FoundSector) -> float:
    return abs(float(wrap(one.centre - other.centre)))


def with_sigmas(sector: FoundSector, others: Sequence[list[FoundSector]]) -> FoundSector:
    """Jackknife over the pieces of the drive; where one of them decides, nothing is sure."""
    found = [near for sectors in others if (near := same_sector(sector, sectors))]
    if len(found) < len(others):
        return FoundSector(sector.centre, sector.width, sector.width, sector.width)
    off = [(float(wrap(s.centre - sector.centre)), s.width) for s in found]
    # Directions are a fraction of a bin apart, but no better known than that.
    sigmas = np.hypot(jackknife_sigma(np.array(off)), _RESOLUTION_RAD)
    return FoundSector(sector.centre, sector.width, *sigmas.tolist())


def _sectors(counts: FloatArray, lidar: Lidar) -> list[FoundSector]:
    """Sectors without returns, from the returns (_BINS,) in each direction."""
    usual = percentile_filter(counts, 75, size=_AROUND, mode="wrap")
    usual = np.maximum(usual, 0.5 * np.median(counts))
    bearing = -math.pi + (np.arange(_BINS) + 0.5) * _BIN_RAD
    looked = np.abs(bearing) <= 0.5 * lidar.field_of_view_rad
    empty = (counts <= _NOTHING * usual) & (usual >= _LEAST_USUAL) & looked
    # One odd bin does not cut a sector in two.
    closed = grey_closing(empty.view(np.uint8), 3, mode="wrap")
    clear = maximum_filter1d(closed, _BESIDE, mode="wrap") == 0
    if not clear.any():
        return []
    start = int(np.argmax(clear))  # outside of every sector, so that none is cut in two
    counts, closed = np.roll(counts, -start), np.roll(closed, -start)
    found = []
    for (sector,) in find_objects(label(closed)[0]):
        before = _beyond(counts[: sector.start][::-1])
        after = _beyond(counts[sector.stop :])
        width = _BIN_RAD * (sector.stop - sector.start + before + after)
        middle = 0.5 * (sector.start - before + sector.stop + after)
        if _NARROWEST_RAD <= width < _WIDEST_RAD:
            found.append(FoundSector(float(wrap(-math.pi + (start + middle) * _BIN_RAD)), width))
    return sorted(found, key=lambda sector: sector.centre)


def _beyond(counts: FloatArray) -> float:
    """How many bins a sector goes on past its empty ones: half-filled bins at its edge.

    counts (k,): of the bins from there outwards; the usual count is that of those a little further.
    """
    usual = float(np.median(counts[_EDGE : _EDGE + _BESIDE])) if len(counts) > _EDGE else 0.0
    if usual == 0.0:
        return 0.0
    blurred = int(np.argmax(np.append(counts[:_EDGE] >= 0.5 * usual, True))) + 1
    return float(np.sum(1.0 - np.minimum(counts[:blurred] / usual, 1.0)))
