"""What other tools see of a recording, judged by rosbags: types, numbers, frames, how often."""

import json
import math
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from host.config import Lidar, RobotConfig
from host.messages import (
    Bodies,
    DeviceIdentity,
    Displacement,
    Estimate,
    Health,
    Message,
    Names,
    Scan,
    Truth,
)
from host.recording.log import Recorder, RecordingHeader
from host.recording.ros.definitions import schema

UNIX_S = 1_700_000_000.0
CONFIG = RobotConfig(lidar=Lidar(x_m=0.02, y_m=-0.01, heading_rad=0.5))
TYPES = [
    *("sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseArray"),
    *("geometry_msgs/msg/PoseStamped", "tf2_msgs/msg/TFMessage"),
    *("visualization_msgs/msg/MarkerArray", "diagnostic_msgs/msg/DiagnosticArray"),
    "sensor_msgs/msg/CompressedImage",
]
ANGLES = np.radians(np.arange(-150.3, 151.0, 5.0))  # inside their degrees
RANGES = np.where(np.arange(61) % 7, 1.0 + 0.025 * np.arange(61), 0.0)


def what_happened() -> list[Message]:
    messages: list[Message] = [DeviceIdentity(0.0, "board", {"firmware": "0.2.0"})]
    for k in range(100):
        time = 0.02 * (k + 1)
        messages.append(Displacement(time, 0.02, 0.01, 0.0, 0.02, 1e-6, 2e-6, (5, 6)))
    messages += [Scan(2.0 + 0.1 * k, 1.9 + 0.1 * k + ANGLES * 0.0, ANGLES, RANGES) for k in (0, 1)]
    covariance = np.array([[[0.04, 0.0], [0.0, 0.01]], [[0.02, 0.01], [0.01, 0.02]]])
    one = np.ones(2)
    places = np.array([[1.0, 2.0], [-0.5, 0.25]])
    messages += [
        Names(1.9, np.array([8]), np.array([2]), np.ones(1), np.zeros(1)),
        Estimate(2.0, places, covariance, one, one, np.array([3, 8]), np.array([[1.0, -1.0]])),
        Truth(2.0, np.array([1]), np.array([[1.01, 2.01]])),
        Bodies(2.0, np.array([5]), np.array([[0.1, 0.2, math.pi / 2]])),
        Health(2.0, "lidar", False, "gone", {"points": 12}),
    ]
    return messages


@pytest.fixture(scope="module")
def path(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("topics") / "a.mcap"
    with Recorder(path, RecordingHeader(CONFIG, "lidar", None, UNIX_S)) as recorder:
        for message in what_happened():
            recorder.write(message)
    return path


@pytest.fixture(scope="module")
def topics(path):
    """By topic, the messages as rosbags decodes them by the schemas in the file."""
    found = defaultdict(list)
    with AnyReader([path]) as reader:
        for connection, _, raw in reader.messages():
            found[connection.topic].append(reader.deserialize(raw, connection.msgtype))
    return found


def stamp(message) -> float:
    return message.header.stamp.sec - UNIX_S + message.header.stamp.nanosec * 1e-9


def heading(pose) -> float:
    return 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)


@pytest.mark.parametrize("name", TYPES)
def test_types_are_as_ros_humble_defines_them(name):
    store = get_typestore(Stores.ROS2_HUMBLE)
    ours = get_types_from_msg(schema(name).decode(), name)
    assert name in ours
    for part, (_, fields) in ours.items():
        assert fields == store.fielddefs[part][1], part


def test_the_scan_has_the_nearest_return_in_each_degree(topics):
    (scan,) = topics["/scan"]  # the second one came too soon after it
    assert scan.header.frame_id == "lidar"
    assert stamp(scan) == pytest.approx(1.9, abs=1e-6)
    assert len(scan.ranges) == 360
    angles = scan.angle_min + scan.angle_increment * np.arange(360)
    assert angles[-1] == pytest.approx(scan.angle_max, abs=1e-5)
    for angle, distance in zip(ANGLES, RANGES, strict=True):
        place = np.argmin(np.abs(angles - angle))
        if distance:
            assert scan.ranges[place] == pytest.approx(distance)
        else:
            assert scan.ranges[place] == math.inf
    assert np.count_nonzero(np.isfinite(scan.ranges)) == np.count_nonzero(RANGES)


def test_odometry_and_its_transform_agree_and_are_thinned_out(topics):
    assert len(topics["/odom"]) == pytest.approx(2.0 * 2.0, abs=1)
    assert len(topics["/tf"]) == pytest.approx(4.0 * 2.0, abs=1)
    last = topics["/odom"][-1]
    steps = round(stamp(last) / 0.02)
    x = y = 0.0
    for k in range(steps):  # each in the frame of the one before
        x += 0.01 * math.cos(0.02 * k)
        y += 0.01 * math.sin(0.02 * k)
    assert (last.header.frame_id, last.child_frame_id) == ("odom", "base_link")
    pose = last.pose.pose
    assert (pose.position.x, pose.position.y) == pytest.approx((x, y))
    assert heading(pose) == pytest.approx(0.02 * steps)
    assert (last.twist.twist.linear.x, last.twist.twist.angular.z) == pytest.approx((0.5, 1.0))
    moved = {stamp(message): message.pose.pose.position.x for message in topics["/odom"]}
    both = 0
    for (transform,) in (message.transforms for message in topics["/tf"]):
        if stamp(transform) in moved:
            assert transform.transform.translation.x == moved[stamp(transform)]
            both += 1
    assert both
    ((mounted,),) = (message.transforms for message in topics["/tf_static"])
    assert (mounted.header.frame_id, mounted.child_frame_id) == ("base_link", "lidar")
    assert mounted.transform.translation.y == -0.01
    assert mounted.transform.rotation.z == pytest.approx(math.sin(0.25))


def test_teammates_are_poses_and_ellipses_of_two_standard_deviations(topics):
    (poses,) = topics["/teammates"]
    assert [(p.position.x, p.position.y) for p in poses.poses] == [(1.0, 2.0), (-0.5, 0.25)]
    (markers,) = topics["/teammates/markers"]
    by_name = defaultdict(list)
    for marker in markers.markers:
        by_name[marker.ns].append(marker)
        assert marker.lifetime.nanosec + 1e9 * marker.lifetime.sec == 2.25e9
    first, second = by_name["teammate"]
    assert [first.id, second.id] == [3, 8]
    assert (first.scale.x, first.scale.y) == pytest.approx((0.8, 0.4))
    assert abs(math.sin(heading(first.pose))) < 1e-9
    # Axes of [[2, 1], [1, 2]]: variances 3 and 1, the long one at 45 degrees.
    assert (second.scale.x, second.scale.y) == pytest.approx(
        (4.0 * math.sqrt(0.03), 4.0 * math.sqrt(0.01))
    )
    assert heading(second.pose) % math.pi == pytest.approx(math.pi / 4)
    assert [marker.text for marker in by_name["label"]] == ["3", "robot 2"]
    ((obstacle),) = by_name["obstacle"]
    assert (obstacle.pose.position.x, obstacle.pose.position.y) == (1.0, -1.0)
    (truth,) = topics["/teammates/truth"]
    assert truth.poses[0].position.x == 1.01


def test_motion_capture_and_health_are_there(topics):
    (body,) = topics["/mocap/body_5"]
    assert (body.header.frame_id, stamp(body)) == ("floor", pytest.approx(2.0, abs=1e-6))
    assert heading(body.pose) == pytest.approx(math.pi / 2)
    (health,) = topics["/diagnostics"]
    (status,) = health.status
    assert (status.level, status.name, status.message) == (2, "lidar", "gone")
    assert [(pair.key, pair.value) for pair in status.values] == [("points", "12")]


def test_configuration_software_and_firmware_are_inside(path):
    with path.open("rb") as file:
        reader = make_reader(file)
        metadata = {each.name: each.metadata for each in reader.iter_metadata()}
        (attachment,) = reader.iter_attachments()
        assert reader.get_header().profile == "ros2"
    assert metadata["device board"] == {"firmware": "0.2.0"}
    assert metadata["swarmloc"]["sensors"] == "lidar"
    assert {"swarmloc", "numpy", "scipy"} <= set(metadata["swarmloc"])
    assert attachment.name == "robot.json"
    assert RobotConfig.model_validate(json.loads(attachment.data)) == CONFIG
