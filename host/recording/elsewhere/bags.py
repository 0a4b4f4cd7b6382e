"""ROS bags, 1 and 2, read as recordings: a robot that is not ours, by its own lidar and odometry.

Read are one sensor_msgs/LaserScan, one nav_msgs/Odometry and, as motion capture, any number of
geometry_msgs/PoseStamped. Needs the extra `ros` (rosbags).
"""

import contextlib
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from host.config import RobotConfig, Wheels
from host.errors import UserError
from host.geometry import to_frame, wrap
from host.messages import Bodies, Displacement, FloatArray, Message, Scan
from host.recording.log import RecordingHeader

PREFIX = "bag:"
SCAN, ODOMETRY, POSE = (
    "sensor_msgs/msg/LaserScan",
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseStamped",
)
_SYNTAX = "bag:FILE,scan=TOPIC,odom=TOPIC,own=TOPIC,others=TOPIC+TOPIC"
_REPAIRS = {
    ".mcap": "if it was cut short, `swarmloc record --repair` keeps what is there; else ",
    ".bag": "if it was cut short, `rosbag reindex` keeps what is there; else ",
    ".db3": "if it was cut short, `.recover` of sqlite3 keeps what is there; else ",
}
_LARGEST_STEP_S = 1.0  # a longer hole of the odometry is none of its steps


@dataclass(frozen=True, slots=True)
class BagSource:
    """A file, and its topics; "": the only one of its type. own, others: poses of robot and
    teammates, of which there may be none."""

    path: Path
    scan: str = ""
    odom: str = ""
    own: str = ""
    others: tuple[str, ...] = ()


def parse_bag(source: str) -> BagSource:
    """What a source that begins with "bag:" names. Raises UserError."""
    name, *settings = source.removeprefix(PREFIX).split(",")
    values: dict[str, str] = {}
    for setting in settings:
        key, equals, value = setting.partition("=")
        if key not in ("scan", "odom", "own", "others") or not equals or not value:
            raise UserError(f"{source!r} has no setting {setting!r}", f"write {_SYNTAX}", "")
        values[key] = value
    others = tuple(topic for topic in values.pop("others", "").split("+") if topic)
    return BagSource(Path(name), **values, others=others)


class Bag:
    """A bag as `host.recording.log.Recording` is: header, messages, remarks, share.

    Times are those of the messages' headers. The robot's own pose is body 1 of the configuration,
    teammates are 2 and so on. Raises UserError where the file cannot be read.
    """

    def __init__(self, source: str) -> None:
        self._source = parse_bag(source)
        self.path = self._source.path
        config = RobotConfig(name=self.path.stem or "bag")
        self._wheels = config.wheels
        self.header = RecordingHeader(config, "lidar")
        self.remarks: list[str] = []
        self.share = 0.0
        with opened(self.path) as reader:
            self._chosen(reader)

    def messages(self) -> Iterator[Message]:
        """Scans, displacements and bodies, in the order of the bag."""
        with opened(self.path) as reader:
            chosen = self._chosen(reader)
            bodies = [self._source.own, *self._source.others]
            last: tuple[float, FloatArray] | None = None
            for connection, stamp, message in read_messages(self.path, reader, chosen):
                self.share = (stamp - reader.start_time) / max(1, reader.duration)
                time = stamp_s(message, stamp)
                if connection.msgtype == SCAN:
                    yield _scan(message, time)
                elif connection.msgtype == POSE:
                    pose = _pose(message.pose)
                    number = np.array([bodies.index(connection.topic) + 1])
                    yield Bodies(time, number, pose[None])
                else:
                    pose = _pose(message.pose.pose)
                    if last is not None and 0.0 < time - last[0] < _LARGEST_STEP_S:
                        yield _step(self._wheels, last[1], pose, time, time - last[0])
                    last = time, pose

    def _chosen(self, reader: Any) -> list[Any]:
        """The connections of the topics to be read. Raises UserError."""
        topics = [
            self._only(reader, SCAN, self._source.scan, "scan"),
            self._only(reader, ODOMETRY, self._source.odom, "odom"),
        ]
        poses = _topics(reader, POSE)
        for topic in (self._source.own, *self._source.others):
            if topic and topic not in poses:
                raise self._unfit(f"no topic {topic} of {POSE}", poses)
            topics += [topic] * bool(topic)
        return [each for each in reader.connections if each.topic in topics]

    def _only(self, reader: Any, kind: str, wanted: str, key: str) -> str:
        """The topic of a type that is wanted, or the only one."""
        found = _topics(reader, kind)
        if wanted and wanted not in found:
            raise self._unfit(f"no topic {wanted} of {kind}", found)
        if not wanted and len(found) != 1:
            what = f"{len(found)} topics of {kind}" if found else f"no {kind}"
            raise self._unfit(what, found, f"choose one: {PREFIX}{self.path},{key}=TOPIC")
        return wanted or found[0]

    def _unfit(self, what: str, found: list[str], step: str = "") -> UserError:
        there = ", ".join(found) or "no topic of this type"
        return UserError(f"{self.path} has {what}", f"there is {there}", step or f"write {_SYNTAX}")


@contextlib.contextmanager
def opened(path: Path) -> Iterator[Any]:
    """A reader of rosbags. Raises UserError where there is no such package, or no such bag."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise UserError(
            "ROS bags cannot be read", "rosbags is missing", "pip install 'swarmloc[ros]'"
        ) from error
    with contextlib.ExitStack() as stack:
        with _reading(path):
            store = get_typestore(Stores.ROS2_HUMBLE)
            reader = stack.enter_context(AnyReader([path], default_typestore=store))
        yield reader


def read_messages(path: Path, reader: Any, chosen: list[Any]) -> Iterator[tuple[Any, int, Any]]:
    """The messages of the connections that are chosen: each with its connection and time (ns).

    Raises UserError where the bag is damaged, after those before the damage.
    """
    with _reading(path):
        for connection, stamp, raw in reader.messages(connections=chosen):
            yield connection, stamp, reader.deserialize(raw, connection.msgtype)


@contextlib.contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Whatever rosbags raises here is the bag's: of a damaged one, all that its parsers meet."""
    try:
        yield
    except Exception as error:
        raise UserError(
            f"cannot read the bag {path}",
            str(error) or type(error).__name__,
            _repair_of(path) + "give a .bag file of ROS 1, or a folder or an .mcap file of ROS 2",
        ) from error


def _repair_of(path: Path) -> str:
    """What may help for a bag, by the kind of its file."""
    files = [path, *(sorted(path.iterdir()) if path.is_dir() else ())]
    return next((_REPAIRS[file.suffix] for file in files if file.suffix in _REPAIRS), "")


def _topics(reader: Any, kind: str) -> list[str]:
    return sorted({each.topic for each in reader.connections if each.msgtype == kind})


def stamp_s(message: Any, received_ns: int) -> float:
    """The time in the header, or where there is none that of the bag, s."""
    stamp = message.header.stamp
    return float(stamp.sec + stamp.nanosec * 1e-9) or received_ns * 1e-9


def _scan(message: Any, time: float) -> Scan:
    """A LaserScan's stamp is that of its first ray; what is no return there is 0 here."""
    with np.errstate(invalid="ignore"):  # a damaged one may hold any number
        ranges = np.asarray(message.ranges, dtype=np.float64)
    number = np.arange(len(ranges))
    interval = message.time_increment or message.scan_time / max(1, len(ranges))
    times = time + max(0.0, interval) * number
    angles = wrap(message.angle_min + message.angle_increment * number)
    with np.errstate(invalid="ignore"):
        seen = (ranges >= message.range_min) & (ranges <= message.range_max)
    end = float(times[-1]) if len(times) else time
    return Scan(end, times, angles, np.where(seen, ranges, 0.0))


def _pose(pose: Any) -> FloatArray:
    """x, y (m) and heading (rad) of a geometry_msgs/Pose."""
    q = pose.orientation
    heading = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
    return np.array([pose.position.x, pose.position.y, heading])


def _step(
    wheels: Wheels, before: FloatArray, after: FloatArray, time: float, interval: float
) -> Displacement:
    """From one pose of the odometry to the next, as uncertain as wheels are by default."""
    dx, dy = to_frame(after[:2], before)
    dpsi = float(wrap(after[2] - before[2]))
    way = math.hypot(dx, dy)
    return Displacement(
        time,
        interval,
        float(dx),
        float(dy),
        dpsi,
        wheels.distance_noise_m**2 * way,
        wheels.heading_noise_rad**2 * abs(dpsi) + wheels.drift_noise_rad**2 * way,
    )
