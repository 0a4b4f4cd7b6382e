"""UTIAS MR.CLAM recordings: robots with a camera that reads barcodes, odometry and Vicon truth.

A dataset is a folder of `RobotN_Odometry.dat`, `RobotN_Measurement.dat`, `RobotN_Groundtruth.dat`,
`Barcodes.dat` and `Landmark_Groundtruth.dat`. Source: Leung, Halpern, Barfoot & Liu, "The UTIAS
multi-robot cooperative localization and mapping dataset", IJRR 30(8), 2011.

The figures of noise below were measured in dataset 6 against Vicon: the camera's as robust
deviations of its readings of robots by range, the odometry's as a least-squares fit of its squared
error over 5 s, about as long as a teammate stays known without a new reading.
"""

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast, get_args

import numpy as np

from host.errors import UserError
from host.geometry import to_frame
from host.messages import Displacement, FloatArray, IntArray, Positions, Truth

SOURCE = "mrclam:"  # how `swarmloc evaluate` is given a dataset
Landmarks = Literal["drop", "clutter"]
_LANDMARKS = get_args(Landmarks)

ROBOTS = (1, 2, 3, 4, 5)  # subjects above these are landmarks

# The camera: readings lie 3 cm beyond truth; the noise of range grows with range.
RANGE_BIAS_M = 0.03
RANGE_STD_M, RANGE_STD_PER_M = 0.03, 0.031
BEARING_STD_RAD = 0.0105
FRAME_PERIOD_S = 0.236
_SAME_FRAME_S = 0.005  # readings of one frame are stamped up to 1 ms apart
_LONGEST_STEP_S = 0.1

# The odometry is the commanded velocity, not corrected for its gains (rotations 0.71 to 0.98 by
# robot) nor its lag; so this noise is far above that of encoders. Per m, per rad and per second.
TRANSLATION_VARIANCE_PER_M = 0.002
HEADING_VARIANCE_PER_RAD = 0.016
HEADING_VARIANCE_PER_S = 2.4e-4
DRIVEN_LATER_S = 0.2  # that lag

VICON_GAP_S = 0.2  # neighbouring samples further apart than this are a gap


@dataclass(frozen=True, slots=True)
class RobotLog:
    """One robot's files, times in seconds since the dataset's start.

    odometry (n, 3): time, forward velocity m/s, rotation rate rad/s; it holds until the next row.
    readings (n, 3): time, range m, bearing rad. subjects (n,): who was read, 0 an unknown barcode.
    vicon (n, 4): time, x m, y m, heading rad (not wrapped) in the hall's frame.
    """

    odometry: FloatArray
    readings: FloatArray
    subjects: IntArray
    vicon: FloatArray


@dataclass(frozen=True, slots=True)
class Dataset:
    """A whole MR.CLAM dataset. landmarks (k, 2): in the hall's frame, m. span: when every robot's
    Vicon record has begun and none has ended, s."""

    robots: dict[int, RobotLog]
    landmarks: FloatArray
    span: tuple[float, float]

    def messages(self, observer: int, landmarks: Landmarks) -> list[Displacement | Positions]:
        """What `observer` drove and saw, in time order; a displacement ends at every frame.

        Each camera frame is one `Positions`. The log has no frame in which nothing was read, but
        the camera ran on at its period: those frames are put in, empty, between the logged ones.
        landmarks: "drop" leaves their readings out (their frames stay), "clutter" keeps them.
        Identities are 1 to 5 for robots, -1 for landmarks and unknown barcodes.
        """
        log = self.robots[observer]
        logged = list(_frames(log.readings[:, 0]))
        times = np.array([log.readings[rows.start, 0] for rows in logged])
        frames = [_positions(log, rows, landmarks) for rows in logged]
        frames += [_positions(log, slice(0, 0), landmarks, float(t)) for t in _unlogged(times)]
        steps = _displacements(log.odometry, np.array([frame.time for frame in frames]))
        # Stable, so that at equal times the displacement comes first.
        return sorted([*steps, *frames], key=lambda message: message.time)

    def motion(self, robot: int) -> list[Displacement]:
        """What `robot` drove, alone."""
        return _displacements(self.robots[robot].odometry, np.zeros(0))

    def has_vicon(self, time: float) -> bool:
        """Whether Vicon saw every robot around `time`: no gap of its record lies there."""
        return all(_covered(log.vicon[:, 0], time) for log in self.robots.values())

    def pose(self, robot: int, time: float) -> FloatArray:
        """The robot's pose (3,) in the hall's frame, interpolated from Vicon: m, m, rad."""
        vicon = self.robots[robot].vicon
        return np.array([np.interp(time, vicon[:, 0], vicon[:, k]) for k in (1, 2, 3)])

    def truth(self, observer: int, time: float) -> Truth:
        """Where the other robots are in the observer's frame."""
        others = [robot for robot in self.robots if robot != observer]
        positions = np.array([self.pose(robot, time)[:2] for robot in others])
        return Truth(time, np.array(others), to_frame(positions, self.pose(observer, time)))

    def landmarks_seen_from(self, observer: int, time: float) -> FloatArray:
        """Where the landmarks (k, 2) are in the observer's frame, m."""
        return to_frame(self.landmarks, self.pose(observer, time))


def read_source(source: str) -> tuple[Path, Landmarks]:
    """Folder and landmarks of a source mrclam:FOLDER,landmarks=drop. Raises UserError."""
    text = source.removeprefix(SOURCE)
    folder, _, setting = text.rpartition(",")
    if not folder or Path(text).is_dir():  # a folder's name may hold a comma
        folder, setting = text, "landmarks=drop"
    key, _, value = (part.strip() for part in setting.partition("="))
    if key != "landmarks" or value not in _LANDMARKS:
        raise UserError(
            f"dataset {source!r} has no setting {setting!r}",
            "landmarks=drop leaves readings of landmarks out, landmarks=clutter keeps them",
            f"write {SOURCE}{folder},landmarks=drop",
        )
    if not Path(folder).is_dir():
        load_dataset(Path(folder))  # its error reports what is missing
    return Path(folder), cast(Landmarks, value)


def load_dataset(folder: str | Path) -> Dataset:
    """Read a dataset, the same one once only; it is not to be changed.

    Raises UserError naming file and line for what is missing or torn.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise UserError(
            f"there is no MR.CLAM dataset at {folder}",
            "no such folder",
            "unpack a dataset from asrl.utias.utoronto.ca/datasets/mrclam and give its folder",
        )
    files = ((file.name, file.stat().st_mtime_ns) for file in folder.glob("*.dat"))
    return _read(folder, tuple(sorted(files)))


@functools.lru_cache(maxsize=1)
def _read(folder: Path, files: tuple[tuple[str, int], ...]) -> Dataset:
    """files: names and times of what is in the folder, so that what has changed is read again."""
    subjects = {
        int(barcode): int(subject) for subject, barcode in _table(folder, "Barcodes.dat", 2)
    }
    landmarks = _table(folder, "Landmark_Groundtruth.dat", 5)
    tables = {
        robot: (
            _table(folder, f"Robot{robot}_Odometry.dat", 3, in_time=True),
            _table(folder, f"Robot{robot}_Measurement.dat", 4, in_time=True),
            _table(folder, f"Robot{robot}_Groundtruth.dat", 4, in_time=True),
        )
        for robot in ROBOTS
    }
    start = min(vicon[0, 0] for _, _, vicon in tables.values())
    logs = {}
    for robot, (odometry, readings, vicon) in tables.items():
        for table in (odometry, readings, vicon):
            table[:, 0] -= start
        vicon[:, 3] = np.unwrap(vicon[:, 3])
        who = np.array([subjects.get(int(code), 0) for code in readings[:, 1]], dtype=np.int64)
        logs[robot] = RobotLog(odometry, readings[:, (0, 2, 3)], who, vicon)
    span = (
        max(float(log.vicon[0, 0]) for log in logs.values()),
        min(float(log.vicon[-1, 0]) for log in logs.values()),
    )
    return Dataset(logs, landmarks[:, 1:3], span)


def _table(folder: Path, name: str, columns: int, in_time: bool = False) -> FloatArray:
    """The numbers of one file (n, columns), n at least 1; in_time: the first one never falls."""
    path = folder / name
    try:
        lines = path.read_text(encoding="ascii").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "it is not a text file"
        raise UserError(
            f"cannot read {path}", why or str(error), "the dataset is incomplete: unpack it again"
        ) from error
    rows: list[list[float]] = []
    for number, line in enumerate(lines, 1):
        if line.startswith("#") or not line.strip():
            continue
        row = _numbers(line)
        if len(row) != columns or not all(map(math.isfinite, row)):
            raise _torn(path, number, f"expected {columns} numbers, found {line.strip()!r}")
        if in_time and rows and row[0] < rows[-1][0]:
            raise _torn(path, number, f"time goes back from {rows[-1][0]:.3f} to {row[0]:.3f} s")
        rows.append(row)
    if not rows:
        raise _torn(path, len(lines), "the file holds no numbers")
    # Column by column in memory, so that interpolating a column copies nothing.
    return np.asfortranarray(rows)


def _numbers(line: str) -> list[float]:
    try:
        return list(map(float, line.split()))
    except ValueError:
        return []


def _torn(path: Path, line: int, why: str) -> UserError:
    return UserError(
        f"{path}, line {line}: not MR.CLAM data", why, "the file is damaged: unpack it again"
    )


def _frames(times: FloatArray) -> Iterator[slice]:
    """The rows of each camera frame: readings stamped within 5 ms of the frame's first."""
    first = 0
    for k in range(1, len(times) + 1):
        if k == len(times) or times[k] - times[first] > _SAME_FRAME_S:
            yield slice(first, k)
            first = k


def _unlogged(times: FloatArray) -> FloatArray:
    """Times of the frames without readings: as many as fit evenly between logged neighbours."""
    gaps = np.diff(times)
    parts = np.maximum(1, np.round(gaps / FRAME_PERIOD_S)).astype(int)
    inner = [
        start + gap * np.arange(1, n) / n
        for start, gap, n in zip(times[:-1], gaps, parts, strict=True)
    ]
    return np.concatenate([*inner, np.zeros(0)])


def _positions(
    log: RobotLog, rows: slice, landmarks: Landmarks, time: float | None = None
) -> Positions:
    """One frame's readings as positions; `time` where the frame has no readings."""
    readings, who = log.readings[rows], log.subjects[rows]
    when = float(readings[0, 0]) if time is None else time
    if landmarks == "drop":
        kept = who <= ROBOTS[-1]
        readings, who = readings[kept], who[kept]
    distance, bearing = readings[:, 1] - RANGE_BIAS_M, readings[:, 2]
    along = np.stack((np.cos(bearing), np.sin(bearing)), axis=1)
    across = along[:, ::-1] * np.array([-1.0, 1.0])
    radial = (RANGE_STD_M + RANGE_STD_PER_M * distance) ** 2
    lateral = (BEARING_STD_RAD * distance) ** 2
    return Positions(
        time=when,
        positions=distance[:, None] * along,
        covariances=radial[:, None, None] * along[:, :, None] * along[:, None, :]
        + lateral[:, None, None] * across[:, :, None] * across[:, None, :],
        identities=np.where(np.isin(who, ROBOTS), who, -1),
    )


def _displacements(odometry: FloatArray, frame_times: FloatArray) -> list[Displacement]:
    """The logged velocities, each held until the next, as arcs that end at changes and frames."""
    times = odometry[:, 0]
    # Most rows repeat the command before them; short steps keep interpolation close to the arc.
    changes = np.any(np.diff(odometry[:, 1:], axis=0) != 0.0, axis=1)
    inside = frame_times[(frame_times > times[0]) & (frame_times < times[-1])]
    regular = np.arange(times[0], times[-1], _LONGEST_STEP_S)
    grid = np.unique(np.concatenate((times[1:][changes], inside, regular, times[-1:])))
    rows = np.searchsorted(times, grid[:-1], side="right") - 1
    intervals = np.diff(grid)
    lengths, rotations = odometry[rows, 1] * intervals, odometry[rows, 2] * intervals
    chords = lengths * np.sinc(rotations / (2.0 * np.pi))
    columns = (
        grid[1:],
        intervals,
        chords * np.cos(rotations / 2.0),
        chords * np.sin(rotations / 2.0),
        rotations,
        TRANSLATION_VARIANCE_PER_M * np.abs(lengths),
        HEADING_VARIANCE_PER_RAD * np.abs(rotations) + HEADING_VARIANCE_PER_S * intervals,
    )
    return [Displacement(*row) for row in np.stack(columns, axis=1).tolist()]


def _covered(times: FloatArray, time: float) -> bool:
    after = int(np.searchsorted(times, time, side="right"))
    if after == len(times):
        return bool(times[-1] == time)
    return after > 0 and bool(times[after] - times[after - 1] <= VICON_GAP_S)
