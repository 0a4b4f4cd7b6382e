"""Raw samples of a whole drive → the directions in which the robot itself hides the lidar's view.

Behind a pillar nothing ever comes back, whatever the robot turns to. A sample without a return
has no sure direction (the X4 corrects its angles by the range), so only returns are counted: how
many came from each direction, against what comes from beside it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, percentile_filter

from host.config import Lidar
from host.geometry import wrap
from host.messages import BoolArray, FloatArray, Scan

_BINS = 1800
_BIN_RAD = math.tau / _BINS
_AROUND = 301  # bins that tell what is usual in a direction
_BESIDE = 21  # bins about a sector that its edges may be in
_NOTHING = 0.02  # of the usual: a stray return does not make a pillar transparent
_LEAST_USUAL = 12.0  # returns in a bin, to tell nothing from little
_NARROWEST_RAD, _WIDEST_RAD = math.radians(1.0), 3.1
_PIECES = 8  # of the drive; each left out once tells the uncertainty
_SAME_RAD = math.radians(3.0)


@dataclass(frozen=True, slots=True)
class Sector:
    """A blind sector: centre and width (rad, robot frame), and their standard deviations."""

    centre: float
    width: float
    centre_sigma: float = math.nan
    width_sigma: float = math.nan

    def within(self, bearings: FloatArray, margin: FloatArray | float) -> BoolArray:
        """Which bearings (n,) are in the sector or nearer to it than the margin (rad)."""
        return np.asarray(np.abs(wrap(bearings - self.centre)) < 0.5 * self.width + margin)


def find_sectors(scans: Sequence[Scan], lidar: Lidar) -> list[Sector]:
    """Blind sectors by their centres, in directions from the lidar's axis, robot frame.

    Edges are where half of the usual number of returns comes. Returns nearer than the configured
    least range are the pillars themselves. None where there is too little to tell.
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
    return [_with_sigmas(sector, others) for sector in found]


def match(sector: Sector, sectors: Sequence[Sector]) -> Sector | None:
    """The one of `sectors` that is the same as `sector`, if any."""
    near = [
        s for s in sectors if abs(float(wrap(s.centre - sector.centre))) < _SAME_RAD + s.width / 2
    ]
    return min(near, key=lambda s: abs(float(wrap(s.centre - sector.centre))), default=None)


def _with_sigmas(sector: Sector, others: Sequence[list[Sector]]) -> Sector:
    """Jackknife over the pieces of the drive; where one of them decides, nothing is sure."""
    same = [match(sector, sectors) for sectors in others]
    found = [s for s in same if s is not None]
    if len(found) < len(same):
        return Sector(sector.centre, sector.width, sector.width, sector.width)
    share = math.sqrt(len(found) - 1.0)
    centres = wrap(np.array([s.centre for s in found]) - sector.centre)
    widths = np.array([s.width for s in found])
    # Directions are a fraction of a bin apart, but no better known than that.
    centre_sigma = math.hypot(share * float(centres.std()), 0.1 * _BIN_RAD)
    width_sigma = math.hypot(share * float(widths.std()), 0.2 * _BIN_RAD)
    return Sector(sector.centre, sector.width, centre_sigma, width_sigma)


def _sectors(counts: FloatArray, lidar: Lidar) -> list[Sector]:
    """Sectors without returns, from the returns (_BINS,) in each direction."""
    usual = percentile_filter(counts, 75, size=_AROUND, mode="wrap")
    usual = np.maximum(usual, 0.5 * np.median(counts))
    bearing = -math.pi + (np.arange(_BINS) + 0.5) * _BIN_RAD
    looked = np.abs(bearing) <= 0.5 * lidar.field_of_view_rad
    empty = (counts <= _NOTHING * usual) & (usual >= _LEAST_USUAL) & looked
    clear = maximum_filter1d(empty.astype(np.int64), _BESIDE, mode="wrap") == 0
    if not empty.any() or not clear.any():
        return []
    start = int(np.argmax(clear))  # outside of every sector, so that none is cut in two
    counts, usual, empty = (np.roll(array, -start) for array in (counts, usual, empty))
    missing = 1.0 - counts / np.maximum(usual, 1.0)
    found, place = [], 0
    while place < _BINS:
        if not empty[place]:
            place += 1
            continue
        first, last = _edges(missing, place)
        share = missing[first : last + 1]
        width = _BIN_RAD * float(share.sum())
        middle = float((share * np.arange(first, last + 1)).sum() / share.sum())
        if _NARROWEST_RAD <= width < _WIDEST_RAD:
            centre = float(wrap(-math.pi + (start + middle + 0.5) * _BIN_RAD))
            found.append(Sector(centre, width))
        place = last + 1
    return sorted(found, key=lambda sector: sector.centre)


def _edges(missing: FloatArray, inside: int) -> tuple[int, int]:
    """First and last bin of the sector around a bin, with the half-filled ones at its edges."""
    first = last = inside
    while first > 0 and missing[first] > 0.5:
        first -= 1
    while last < _BINS - 1 and missing[last] > 0.5:
        last += 1
    return first, last
