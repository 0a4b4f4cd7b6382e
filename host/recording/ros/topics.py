"""What other tools draw of a run: its messages as ROS 2 topics, thinned out where they are large.

Frames: odom → base_link (the robot) → lidar; motion capture's is floor. docs/recordings.md lists
the topics, their rates and what they leave out: everything is in the records that replay reads.
"""

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from host.config import RobotConfig
from host.geometry import Path
from host.message_checks import fault
from host.messages import (
    Bodies,
    Displacement,
    Estimate,
    FloatArray,
    Health,
    Message,
    Names,
    Picture,
    Scan,
    Truth,
)
from host.recording.ros.cdr import CdrBuilder, nanoseconds
from host.recording.ros.pictures import picture_topic

# At least, between two.
SCAN_S, TRANSFORM_S, ODOMETRY_S, TEAMMATES_S, MARKERS_S = 0.2, 0.25, 0.5, 0.2, 1.5
HEALTH_S, BODIES_S = 2.0, 0.1
BINS = 360  # of a LaserScan
_BODY_VARIANCE = 1e6  # ROS's way to say that z, roll and pitch are not known
ROBOT, ODOM, LIDAR, FLOOR = "base_link", "odom", "lidar", "floor"
_TEAMMATE, _TRUTH, _OBSTACLE = (0.1, 0.5, 1.0, 0.5), (0.1, 0.8, 0.2, 0.4), (0.6, 0.6, 0.6, 0.4)
_SPHERE, _CYLINDER, _TEXT = 2, 3, 9


class Published(NamedTuple):
    """One message of a topic. data: CDR."""

    topic: str
    type: str
    data: bytes


class Topics:
    """Turns the messages of one run into topics. unix_s: to add to the host's times for a date."""

    def __init__(self, config: RobotConfig, unix_s: float) -> None:
        self._lidar = config.lidar
        self._unix_s = unix_s
        self._path = Path(keep_seconds=1.0)
        self._due: dict[str, float] = {}
        self._names: dict[int, int] = {}  # robots' numbers by label

    def of(self, message: Message) -> Iterator[Published]:
        """What a message publishes; nothing where it is malformed."""
        if fault(message) is not None:
            return
        if isinstance(message, Scan) and self._is_due("scan", message.time, SCAN_S):
            yield self._scan(message)
        elif isinstance(message, Displacement):
            yield from self._odometry(message)
        elif isinstance(message, Estimate):
            yield from self._estimate(message)
        elif isinstance(message, Truth) and self._is_due("truth", message.time, MARKERS_S):
            poses = _at(message.positions)
            yield self._poses("/teammates/truth", message.time, ROBOT, poses)
        elif isinstance(message, Bodies):
            yield from self._bodies(message)
        elif isinstance(message, Health) and self._is_due(message.device, message.time, HEALTH_S):
            yield self._health(message)
        elif isinstance(message, Picture):
            yield self._picture(message)
        elif isinstance(message, Names):
            named = zip(message.labels.tolist(), message.identities.tolist(), strict=True)
            self._names = dict(named)

    def _is_due(self, name: str, time: float, period_s: float) -> bool:
        """Is a topic to be published at `time` (s)? Then again after `period_s`."""
        if time < self._due.get(name, -math.inf):
            return False
        self._due[name] = time + 0.99 * period_s
        return True

    def _header(self, cdr: CdrBuilder, time: float, frame: str) -> None:
        stamp = nanoseconds(time + self._unix_s)
        cdr.numbers("i", stamp // 10**9 & 0x7FFFFFFF)
        cdr.numbers("I", stamp % 10**9)
        cdr.text(frame)

    def _scan(self, scan: Scan) -> Published:
        cdr = CdrBuilder()
        seconds = scan.time - float(scan.times[0]) if len(scan.times) else 0.0
        self._header(cdr, scan.time - seconds, LIDAR)
        step = math.tau / BINS
        ends = (-math.pi + step / 2.0, math.pi - step / 2.0)
        limits = (self._lidar.min_range_m, max(16.0, self._lidar.max_range_m))
        cdr.numbers("f", *ends, step, seconds / BINS, seconds, *limits)
        cdr.floats(_nearest(scan))
        cdr.floats(np.zeros(0, np.float32))
        return Published("/scan", "sensor_msgs/msg/LaserScan", cdr.data)

    def _odometry(self, step: Displacement) -> Iterator[Published]:
        self._path.append(step)
        (pose,) = self._path.poses(np.array([step.time]))
        if self._is_due("transform", step.time, TRANSFORM_S):
            yield self._transforms("/tf", step.time, [(ODOM, ROBOT, pose)])
        if not self._is_due("odometry", step.time, ODOMETRY_S):
            return
        cdr = CdrBuilder()
        self._header(cdr, step.time, ODOM)
        cdr.text(ROBOT)
        _put_pose(cdr, pose)
        _put_covariance(cdr, step.translation_variance, step.heading_variance)
        speed = max(step.interval, 1e-6)
        cdr.numbers("d", step.dx / speed, step.dy / speed, 0.0, 0.0, 0.0, step.dpsi / speed)
        variances = step.translation_variance / speed**2, step.heading_variance / speed**2
        _put_covariance(cdr, *variances)
        yield Published("/odom", "nav_msgs/msg/Odometry", cdr.data)

    def mounting(self, time: float) -> Published:
        """Where the lidar stands on the robot."""
        mounted = np.array([self._lidar.x_m, self._lidar.y_m, self._lidar.heading_rad])
        return self._transforms("/tf_static", time, [(ROBOT, LIDAR, mounted)])

    def _transforms(
        self, topic: str, time: float, moved: list[tuple[str, str, FloatArray]]
    ) -> Published:
        cdr = CdrBuilder()
        cdr.numbers("I", len(moved))
        for parent, child, (x, y, heading) in moved:
            self._header(cdr, time, parent)
            cdr.text(child)
            cdr.numbers("d", x, y, 0.0, *_quaternion(heading))
        return Published(topic, "tf2_msgs/msg/TFMessage", cdr.data)

    def _poses(self, topic: str, time: float, frame: str, poses: FloatArray) -> Published:
        cdr = CdrBuilder()
        self._header(cdr, time, frame)
        cdr.numbers("I", len(poses))
        for pose in poses:
            _put_pose(cdr, pose)
        return Published(topic, "geometry_msgs/msg/PoseArray", cdr.data)

    def _estimate(self, estimate: Estimate) -> Iterator[Published]:
        if self._is_due("estimate", estimate.time, TEAMMATES_S):
            yield self._poses("/teammates", estimate.time, ROBOT, _at(estimate.positions))
        if self._is_due("markers", estimate.time, MARKERS_S):
            yield self._markers(estimate)

    def _markers(self, estimate: Estimate) -> Published:
        """Ellipses of two standard deviations with labels, and the obstacles."""
        cdr = CdrBuilder()
        obstacles = list(enumerate(estimate.obstacles))
        cdr.numbers("I", 2 * len(estimate.labels) + len(obstacles))
        for label, position, covariance in zip(
            estimate.labels.tolist(), estimate.positions, estimate.covariances, strict=True
        ):
            heading, scale = _ellipse(covariance)
            pose = np.array([*position, heading])
            self._marker(cdr, estimate.time, ("teammate", label, _CYLINDER), pose, scale, _TEAMMATE)
            text = f"robot {self._names[label]}" if label in self._names else str(label)
            kind = ("label", label, _TEXT)
            self._marker(cdr, estimate.time, kind, pose, (0.0, 0.0, 0.08), (1.0,) * 4, text)
        for number, position in obstacles:
            kind = ("obstacle", number, _CYLINDER)
            pose = np.array([*position, 0.0])
            self._marker(cdr, estimate.time, kind, pose, (0.06, 0.06, 0.02), _OBSTACLE)
        return Published("/teammates/markers", "visualization_msgs/msg/MarkerArray", cdr.data)

    def _marker(
        self,
        cdr: CdrBuilder,
        time: float,
        kind: tuple[str, int, int],
        pose: FloatArray,
        scale: tuple[float, ...],
        color: tuple[float, ...],
        text: str = "",
    ) -> None:
        self._header(cdr, time, ROBOT)
        name, number, shape = kind
        cdr.text(name)
        cdr.numbers("i", number & 0x7FFFFFFF, shape, 0)
        _put_pose(cdr, pose)
        cdr.numbers("d", *scale)
        cdr.numbers("f", *color)
        cdr.numbers("i", 0)
        cdr.numbers("I", round(1.5e9 * MARKERS_S))  # then it disappears
        cdr.numbers("?", False)
        cdr.numbers("I", 0, 0)  # points, colors
        cdr.text("")  # texture_resource, and a texture of no content
        cdr.numbers("i", 0)
        cdr.numbers("I", 0)
        cdr.text("")
        cdr.text("")
        cdr.numbers("I", 0, 0)  # its data, uv_coordinates
        cdr.text(text)
        cdr.text("")  # mesh_resource, mesh_file
        cdr.text("")
        cdr.numbers("I", 0)
        cdr.numbers("?", False)

    def _bodies(self, bodies: Bodies) -> Iterator[Published]:
        for identity, pose in zip(bodies.identities.tolist(), bodies.poses, strict=True):
            if self._is_due(f"body {identity}", bodies.time, BODIES_S):
                cdr = CdrBuilder()
                self._header(cdr, bodies.time, FLOOR)
                _put_pose(cdr, pose)
                topic = f"/mocap/body_{identity}".replace("-", "_")
                yield Published(topic, "geometry_msgs/msg/PoseStamped", cdr.data)

    def _health(self, health: Health) -> Published:
        cdr = CdrBuilder()
        self._header(cdr, health.time, "")
        cdr.numbers("I", 1)
        cdr.numbers("B", 0 if health.ok else 2)
        for text in (health.device, health.reason, health.device):
            cdr.text(text)
        _put_pairs(cdr, health.counts)
        return Published("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", cdr.data)

    def _picture(self, picture: Picture) -> Published:
        cdr = CdrBuilder()
        self._header(cdr, picture.time, f"{picture.camera}_camera")
        cdr.text("jpeg")
        cdr.octets(picture.jpeg)
        topic = picture_topic(picture.camera)
        return Published(topic, "sensor_msgs/msg/CompressedImage", cdr.data)


def _nearest(scan: Scan) -> FloatArray:
    """The nearest return in each degree, inf where there is none: float32 (BINS,)."""
    ranges = np.full(BINS, np.inf, np.float32)
    seen = scan.ranges > 0.0
    places = ((scan.angles[seen] + math.pi) * (BINS / math.tau)).astype(np.int64) % BINS
    np.minimum.at(ranges, places, scan.ranges[seen].astype(np.float32))
    return np.asarray(ranges)


def _at(positions: FloatArray) -> FloatArray:
    """Poses (n, 3) of positions (n, 2) whose heading nobody knows."""
    return np.column_stack((positions, np.zeros(len(positions))))


def _quaternion(heading: float) -> tuple[float, float, float, float]:
    if not math.isfinite(heading):  # of what is no pose
        return math.nan, math.nan, math.nan, math.nan
    return 0.0, 0.0, math.sin(heading / 2.0), math.cos(heading / 2.0)


def _put_pose(cdr: CdrBuilder, pose: FloatArray) -> None:
    x, y, heading = pose
    cdr.numbers("d", x, y, 0.0, *_quaternion(heading))


def _put_covariance(cdr: CdrBuilder, translation: float, heading: float) -> None:
    """6 x 6 of x, y, z and the rotations about them."""
    diagonal = (translation, translation, *[_BODY_VARIANCE] * 3, heading)
    cdr.numbers("d", *np.diag(diagonal).reshape(-1))


def _put_pairs(cdr: CdrBuilder, values: Mapping[str, object]) -> None:
    cdr.numbers("I", len(values))
    for key, value in values.items():
        cdr.text(key)
        cdr.text(str(value))


def _ellipse(covariance: FloatArray) -> tuple[float, tuple[float, float, float]]:
    """Heading (rad) of the long axis, and both diameters (m) of two standard deviations."""
    if not np.all(np.isfinite(covariance)):
        return 0.0, (0.0, 0.0, 0.0)
    variances, axes = np.linalg.eigh(covariance)
    short, long = 4.0 * np.sqrt(np.maximum(variances, 1e-8))
    return math.atan2(axes[1, 1], axes[0, 1]), (float(long), float(short), 0.02)
