"""Lidar against cameras: do bearings of strips match the lidar's candidates, and vice versa?

Twice a second while the robot moves, a picture is compared with the scan of its time. A robot that
stands among standing things would only repeat itself: a teammate behind a pillar would be seen by
the cameras alone for as long as it stays there.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from host.config import RobotConfig
from host.errors import UserError
from host.estimator.sensor_models import in_view
from host.geometry import Path, wrap
from host.messages import Bearings, BoolArray, FloatArray, Positions, Scan
from host.perception.turrets import turrets

_EVERY_S = 0.5
_MOVED_M, _MOVED_RAD = 0.08, 0.2  # since the last comparison
_TOGETHER_S = 0.1  # a scan and a picture that are compared
_WINDOW_S = 60.0
_SIGMAS, _TOLERANCE_RAD = 2.0, math.radians(2.0)
_SECTOR_WIDTH, _SECTOR_STEP = math.radians(45.0), math.radians(15.0)
_FEWEST_EVENTS = 30  # in a sector
_BLIND_SHARE = 0.1  # of its events have a counterpart, at most ...
_SEEN_ELSEWHERE = 0.5  # ... and of those elsewhere at least; fewer where most things are posts
_OFFSET_BINS = 72  # of 5 deg
_OFFSET_SPREAD = 2  # bins to either side that belong to a peak
_LEAST_OFFSET_RAD = math.radians(20.0)
_OFFSET_SIGMAS, _OFFSET_EXCESS = 5.0, 40.0  # by which a peak has to surpass an offset of 0
_OFFSET_SHARE = 0.5  # of the bearings that have to be in it


@dataclass(frozen=True, slots=True)
class _Compared:
    """A picture and a scan. offsets: of each bearing from each candidate, rad.

    met (n,), seen (m,): which bearings and which candidates have a counterpart.
    """

    time: float
    camera: str
    bearings: FloatArray
    met: BoolArray
    candidates: FloatArray
    seen: BoolArray
    offsets: FloatArray


class LidarAgainstCameras:
    """Compares pictures with scans and judges the last minute.

    thinned: as above; else every scan is compared, whether the robot moves or not.
    """

    def __init__(self, config: RobotConfig, thinned: bool = True) -> None:
        self._thinned = thinned
        self._lidar = config.lidar
        # Where a camera sees a teammate nearly as well as close by.
        self._near_m = min(0.8 * config.camera.half_range_m, config.lidar.max_range_m)
        self._compared: deque[_Compared] = deque()
        self._positions: Positions | None = None
        self._pose: FloatArray | None = None  # in the path's frame, of the last comparison
        self._paired: set[str] = set()

    @property
    def compared(self) -> int:
        """Pictures compared in the last minute."""
        return len(self._compared)

    def take_scan(self, scan: Scan, path: Path) -> None:
        """Take the next scan. path: of the odometry, which has reached the scan's end."""
        before = -math.inf if self._positions is None else self._positions.time
        if self._thinned and 0.0 <= scan.time - before < _EVERY_S:
            return
        (pose,) = path.poses(np.array([scan.time]))
        if self._pose is not None and self._thinned:
            x, y, rotation = pose - self._pose
            if math.hypot(x, y) < _MOVED_M and abs(rotation) < _MOVED_RAD:
                return
        self._pose, self._paired = pose, set()
        self._positions = turrets.find(scan, self._lidar, path)

    def forget(self) -> None:
        """The odometry has a gap: what was measured before it cannot be compared."""
        self._positions = None

    def take_bearings(self, bearings: Bearings, path: Path) -> None:
        """Take the next picture; each scan is compared with one of each camera."""
        found = self._positions
        if found is None or abs(bearings.time - found.time) > _TOGETHER_S:
            return
        if bearings.camera in self._paired:
            return
        self._paired.add(bearings.camera)
        then, now = path.poses(np.array([bearings.time, found.time]))
        turned = float(then[2] - now[2])
        self._compare(bearings, np.asarray(bearings.bearings + turned), turned, found)
        while self._compared[0].time < bearings.time - _WINDOW_S:
            self._compared.popleft()

    def _compare(
        self, picture: Bearings, bearings: FloatArray, turned: float, found: Positions
    ) -> None:
        """Compare a picture's bearings (n,), carried to the scan's time by `turned` rad."""
        x, y = (found.positions - np.array(picture.origin)).T
        candidates, near = np.arctan2(y, x), np.hypot(x, y) < self._near_m
        offsets = wrap(bearings[:, None] - candidates)
        tolerance = _SIGMAS * np.sqrt(picture.variances) + _TOLERANCE_RAD
        together = np.abs(offsets) < tolerance[:, None]
        met, seen = (np.asarray(together.any(axis=k)) for k in (1, 0))
        judged = near & in_view(candidates, (picture.view[0] + turned, picture.view[1]))
        looked = self._looked(bearings)
        self._compared.append(
            _Compared(
                picture.time,
                picture.camera,
                wrap(bearings[looked]),
                met[looked],
                candidates[judged],
                seen[judged],
                offsets.ravel(),
            )
        )

    def _looked(self, bearings: FloatArray) -> BoolArray:
        """Which bearings (n,) rad point where the lidar is supposed to see."""
        looked: BoolArray = np.abs(wrap(bearings)) <= 0.5 * self._lidar.field_of_view_rad
        for blind in self._lidar.blind_sectors:
            looked &= np.abs(wrap(bearings - blind.centre_rad)) > 0.5 * blind.width_rad
        return looked

    def fault(self) -> UserError | None:
        """How the two contradict each other, None where they do not."""
        return self.rotated() or self._lidar_blind() or self._camera_blind()

    def rotated(self) -> UserError | None:
        """Does every bearing of a camera lie beside its candidate by the same angle?"""
        found = {}
        for camera in sorted({entry.camera for entry in self._compared}):
            entries = [entry for entry in self._compared if entry.camera == camera]
            offset = constant_offset(
                np.concatenate([entry.offsets for entry in entries]),
                sum(len(entry.bearings) for entry in entries),
            )
            if offset is not None:
                found[camera] = math.degrees(offset)
        if not found:
            return None
        degrees = max(found.values(), key=abs)
        names = " and ".join(camera for camera in found if camera) or "front and rear"
        side = "left" if degrees > 0.0 else "right"
        if abs(degrees) > 150:
            return UserError(
                f"strips in the {names} picture are opposite to the turrets that the lidar finds",
                "front and rear camera are exchanged, or the lidar is mounted backwards",
                "exchange the two sources in [camera.front] and [camera.rear] of robot.toml",
            )
        return UserError(
            f"strips in the {names} picture are about {abs(degrees):.0f} deg to the {side} of the "
            "turrets that the lidar finds",
            "heading_rad of the camera or of the lidar is wrong in robot.toml, or one was moved",
            "measure them: swarmloc calibrate camera, swarmloc calibrate lidar",
        )

    def _lidar_blind(self) -> UserError | None:
        sector = self._sector(lambda entry: (entry.bearings, entry.met))
        if sector is None:
            return None
        return UserError(
            f"between {_degrees(sector)} the cameras see strips, but the lidar finds no turret",
            "something covers the lidar's window there, or something of the strip's colour is on "
            "the robot",
            "look at the lidar's window there; a part of the robot belongs into blind_sectors in "
            "[lidar] of robot.toml",
        )

    def _camera_blind(self) -> UserError | None:
        sector = self._sector(lambda entry: (entry.candidates, entry.seen))
        if sector is None:
            return None
        return UserError(
            f"between {_degrees(sector)} the lidar finds turrets, but no camera sees a strip",
            "a camera is covered, dirty or dazzled there, or strips look different in that light",
            "look at that camera's pictures; swarmloc calibrate colour",
        )

    def _sector(
        self, events: Callable[[_Compared], tuple[FloatArray, BoolArray]]
    ) -> tuple[float, float] | None:
        pairs = [events(entry) for entry in self._compared]
        if not pairs:
            return None
        return lonely_sector(
            np.concatenate([bearings for bearings, _ in pairs]),
            np.concatenate([met for _, met in pairs]),
        )


def lonely_sector(bearings: FloatArray, met: BoolArray) -> tuple[float, float] | None:
    """The sector (from, to) rad where what one sensor sees has no counterpart in the other.

    bearings (n,) rad of what it saw; met (n,): which had one, as half of those
    outside the sector must.
    """
    centres = np.arange(-math.pi, math.pi, _SECTOR_STEP)
    inside = np.abs(wrap(bearings - centres[:, None])) < 0.5 * _SECTOR_WIDTH
    events, meetings = inside.sum(axis=1), (inside & met).sum(axis=1)
    lonely = (events >= _FEWEST_EVENTS) & (meetings <= _BLIND_SHARE * events)
    if not lonely.any():
        return None
    outside = ~inside[lonely].any(axis=0)
    if np.count_nonzero(outside) < _FEWEST_EVENTS or met[outside].mean() < _SEEN_ELSEWHERE:
        return None
    # From the middle of them all, as sectors meet around the circle.
    middle = float(np.angle(np.exp(1j * centres[lonely]).sum()))
    reach = wrap(centres[lonely] - middle)
    return (
        middle + float(reach.min()) - 0.5 * _SECTOR_WIDTH,
        middle + float(reach.max()) + 0.5 * _SECTOR_WIDTH,
    )


def constant_offset(offsets: FloatArray, bearings: int) -> float | None:
    """The angle (rad) by which many of the bearings miss a candidate while few meet one.

    offsets (n,) rad: of each bearing from each candidate; bearings: how many there were.
    """
    index = np.floor((offsets + math.pi) * (_OFFSET_BINS / math.tau)).astype(np.intp)
    counts = np.bincount(index % _OFFSET_BINS, minlength=_OFFSET_BINS)
    around = range(-_OFFSET_SPREAD, _OFFSET_SPREAD + 1)
    smooth = np.sum([np.roll(counts, shift) for shift in around], axis=0)
    # Zero is the border of two bins.
    at_zero = float(smooth[[_OFFSET_BINS // 2 - 1, _OFFSET_BINS // 2]].max())
    peak = int(np.argmax(smooth))
    excess = smooth[peak] - at_zero
    offset = (peak + 0.5) * math.tau / _OFFSET_BINS - math.pi
    if (
        abs(offset) < _LEAST_OFFSET_RAD
        or excess < max(_OFFSET_EXCESS, _OFFSET_SIGMAS * math.sqrt(smooth[peak] + at_zero))
        or smooth[peak] < _OFFSET_SHARE * bearings
    ):
        return None
    return offset


def _degrees(sector: tuple[float, float]) -> str:
    begin, end = (round(math.degrees(float(wrap(edge)))) for edge in sector)
    return f"{begin} and {end} deg"
