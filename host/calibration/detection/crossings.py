"""When the lidar's beam crossed each teammate in each revolution, and its true position."""

from collections.abc import Sequence

import numpy as np

from host.calibration.gathered import Tracks
from host.config import Lidar
from host.geometry import Path, polar, to_frame, to_parent, wrap
from host.messages import BoolArray, Displacement, FloatArray, Scan

_PATH_STEPS = 12  # some 10 ms each
_BESIDE_RAD = 0.02  # two cylinders nearer in bearing than this are not separated for sure
_NEARER_M = 0.1


def true_path(scan: Scan, tracks: Tracks) -> Path:
    """The robot's own path during one revolution as motion capture saw it, to carry points by."""
    path = Path(keep_seconds=np.inf)
    times = np.linspace(scan.times[0], scan.time, _PATH_STEPS + 1)
    poses = tracks.own(times)
    moves = to_frame(poses[1:, :2], poses[:-1])
    rows = np.column_stack((times[1:], np.diff(times), moves, np.diff(poses[:, 2])))
    for time, interval, dx, dy, dpsi in rows.tolist():
        path.append(Displacement(time, interval, dx, dy, dpsi))
    return path


class Crossings:
    """The teammates as the beam met them, by revolution (s,) and teammate (m,); nan: unknown.

    times (s, m) s. distances (s, m) m and bearings (s, m) rad: in the robot frame of that moment.
    ways (s, m) m and beams (s, m) rad: the same in the lidar's own frame. places (s, m, 2) m:
    where they stood, in the robot frame at the end of the scan, as the finder has it. robots
    (s, 3): the robot on the floor at the end of the scan.
    """

    def __init__(self, scans: Sequence[Scan], tracks: Tracks, lidar: Lidar) -> None:
        shape = (len(scans), len(tracks.identities))
        ends = np.array([scan.time for scan in scans])
        starts = np.array([scan.times[0] for scan in scans])
        self._mounting = np.array([lidar.x_m, lidar.y_m, lidar.heading_rad])
        self.robots = tracks.own(ends)
        self.times = np.repeat((0.5 * (starts + ends))[:, None], shape[1], axis=1)
        self.places = np.zeros((*shape, 2))
        self.distances, self.bearings = np.zeros(shape), np.zeros(shape)
        self.ways, self.beams = np.zeros(shape), np.zeros(shape)
        self._look(tracks)
        for _ in range(2):  # the robot rotates while the lidar does
            for s, scan in enumerate(scans):
                off = np.abs(wrap(scan.angles[:, None] - np.nan_to_num(self.beams[s])))
                self.times[s] = scan.times[np.argmin(off, axis=0)]
            self._look(tracks)

    def _look(self, tracks: Tracks) -> None:
        for j, identity in enumerate(tracks.identities.tolist()):
            times = self.times[:, j]
            floor = tracks.body(identity, times)[:, :2]
            seen = to_frame(floor, tracks.own(times))
            self.distances[:, j], self.bearings[:, j] = polar(seen)
            self.ways[:, j], self.beams[:, j] = polar(to_frame(seen, self._mounting))
            self.places[:, j] = to_frame(floor, self.robots)

    def plain(self, lidar: Lidar) -> BoolArray:
        """Which (s, m) are in the lidar's field of view, and behind no other known body."""
        half = np.arcsin(np.minimum(0.5 * lidar.target_diameter_m / self.ways, 1.0))
        gaps = np.abs(wrap(self.beams[:, :, None] - self.beams[:, None, :]))
        nearer = self.ways[:, None, :] < self.ways[:, :, None] - _NEARER_M
        close = gaps < half[:, :, None] + half[:, None, :] + _BESIDE_RAD
        plain = np.isfinite(self.ways) & ~np.any(close & nearer, axis=2)
        plain &= self.ways > lidar.min_range_m + lidar.target_diameter_m
        if lidar.field_of_view_rad < 2.0 * np.pi:
            plain &= np.abs(self.bearings) + half < 0.5 * lidar.field_of_view_rad
        return np.asarray(plain)

    def points(self, scan: Scan, chosen: BoolArray, path: Path) -> FloatArray:
        """Returns (k, 2) m of a scan, in the robot frame at its end."""
        angles, ranges = scan.angles[chosen], scan.ranges[chosen]
        flat = np.stack((ranges * np.cos(angles), ranges * np.sin(angles)), axis=1)
        return path.carry(to_parent(flat, self._mounting), scan.times[chosen], scan.time)

    def origin(self, scan: Scan, time: float, path: Path) -> FloatArray:
        """Where the lidar was at `time` (2,) m, in the robot frame at the end of the scan."""
        carried = path.carry(self._mounting[None, :2], np.array([time]), scan.time)
        return np.asarray(carried[0])
