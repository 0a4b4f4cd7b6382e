"""Poses of bodies in ROS bags, 1 and 2, whoever tracked them.

A body is a topic of PoseStamped, PoseWithCovarianceStamped, Odometry or TransformStamped, or a
child frame in the transforms of a topic of TFMessage. Needs the extra `ros` (rosbags).
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from host.recording.elsewhere.bags import opened, read_messages, stamp_s
from host.recording.elsewhere.posed_body import PosedBody, posed_body

_TRANSFORM, _TRANSFORMS = "geometry_msgs/msg/TransformStamped", "tf2_msgs/msg/TFMessage"
_KINDS = (
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "nav_msgs/msg/Odometry",
    _TRANSFORM,
    _TRANSFORMS,
)
_ENDINGS = (".bag", ".mcap", ".db3", ".zstd")


def is_bag(path: Path) -> bool:
    """Whether a path is one of a bag, by its ending; those of ROS 2 are folders, too."""
    return path.is_dir() or path.suffix in _ENDINGS


def read_bag_bodies(path: Path) -> list[PosedBody]:
    """All bodies in a bag; rows that are no pose are left out. Raises UserError for no bag."""
    rows: dict[str, list[list[float]]] = {}
    with opened(path) as reader:
        chosen = [each for each in reader.connections if each.msgtype in _KINDS]
        for connection, received, message in read_messages(path, reader, chosen) if chosen else ():
            for name, stamped, pose in _poses(message, connection):
                time = stamp_s(stamped, received)
                rows.setdefault(name, []).append([time, *pose])
    tables = [(name, np.array(table)) for name, table in rows.items()]
    return [posed_body(name, rows[:, 0], rows[:, 1:4], rows[:, 4:]) for name, rows in tables]


def _poses(message: Any, connection: Any) -> Iterator[tuple[str, Any, list[float]]]:
    """Name, what carries the header, and x, y, z, qx, qy, qz, qw of each body in a message."""
    if connection.msgtype in (_TRANSFORM, _TRANSFORMS):
        single = connection.msgtype == _TRANSFORM
        for each in [message] if single else message.transforms:
            place, turn = each.transform.translation, each.transform.rotation
            name = connection.topic if single else each.child_frame_id
            yield name, each, [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w]
        return
    pose = message.pose
    while hasattr(pose, "pose"):  # with a covariance
        pose = pose.pose
    place, turn = pose.position, pose.orientation
    yield connection.topic, message, [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w]
