"""ROS bags, written here by rosbags, are read as recordings: what was driven, seen and true."""

import math
import shutil

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from host.config import RobotConfig
from host.errors import UserError
from host.geometry import Path as OdometryPath
from host.messages import Bodies, Displacement, Scan
from host.recording.elsewhere.bag_poses import read_bag_bodies
from host.recording.elsewhere.bags import Bag
from host.recording.log import Recording
from host.sessions.offline.evaluating import score_sources
from host.sessions.recordings.exporting import export
from host.simulation.offline import Simulation
from host.simulation.world import scenarios

EPOCH = 1_700_000_000.0
BINS = 1440
SETTINGS = "own=/pose/body_1,others=/pose/body_2+/pose/body_3+/pose/body_4"


@pytest.fixture(scope="module")
def driven():
    """What a simulated robot measured, and where motion capture saw all of them."""
    scenario = scenarios.parse_scenario("arena4:seconds=9,seed=1,mocap_hz=50")
    return list(Simulation(scenario, RobotConfig()).messages())


class Ros:
    """Makes the messages of one ROS version."""

    def __init__(self, one: bool) -> None:
        self.store = get_typestore(Stores.ROS1_NOETIC if one else Stores.ROS2_HUMBLE)
        self.one = one

    def make(self, name, *values):
        return self.store.types[name](*values)

    def data(self, message):
        kind = message.__msgtype__
        write = self.store.serialize_ros1 if self.one else self.store.serialize_cdr
        return kind, write(message, kind)

    def header(self, time, frame):
        nanoseconds = round((EPOCH + time) * 1e9)
        stamp = self.make("builtin_interfaces/msg/Time", *divmod(nanoseconds, 10**9))
        number = [0] * self.one
        return self.make("std_msgs/msg/Header", *number, stamp, frame)

    def pose(self, x, y, heading):
        return self.make(
            "geometry_msgs/msg/Pose",
            self.make("geometry_msgs/msg/Point", x, y, 0.0),
            self.make(
                "geometry_msgs/msg/Quaternion",
                *(0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2)),
            ),
        )

    def scan(self, scan):
        step = 2 * math.pi / BINS
        places = ((scan.angles + math.pi) / step).astype(int) % BINS
        ranges = np.full(BINS, np.inf, np.float32)
        ranges[places] = np.where(scan.ranges > 0.0, scan.ranges, np.inf)
        seconds = scan.time - scan.times[0]
        return self.make(
            "sensor_msgs/msg/LaserScan",
            self.header(scan.times[0], "laser"),
            *(-math.pi + step / 2, math.pi - step / 2, step, seconds / BINS, seconds, 0.1, 12.0),
            *(ranges, np.zeros(0, np.float32)),
        )

    def odometry(self, time, pose):
        zero = self.make("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
        covariance = np.zeros(36)
        return self.make(
            "nav_msgs/msg/Odometry",
            self.header(time, "odom"),
            "base_link",
            self.make("geometry_msgs/msg/PoseWithCovariance", self.pose(*pose), covariance),
            self.make(
                "geometry_msgs/msg/TwistWithCovariance",
                self.make("geometry_msgs/msg/Twist", zero, zero),
                covariance,
            ),
        )

    def messages(self, driven):
        path = OdometryPath(keep_seconds=100.0)
        for message in driven:
            if isinstance(message, Scan):
                yield "/scan", message.time, self.scan(message)
            elif isinstance(message, Displacement):
                path.append(message)
                (pose,) = path.poses(np.array([message.time]))
                yield "/odom", message.time, self.odometry(message.time, pose)
            elif isinstance(message, Bodies):
                for identity, pose in zip(message.identities, message.poses, strict=True):
                    stamped = self.make(
                        "geometry_msgs/msg/PoseStamped",
                        self.header(message.time, "world"),
                        self.pose(*pose),
                    )
                    yield f"/pose/body_{identity}", message.time, stamped


def write_bag(path, driven, kind):
    ros = Ros(kind == "ros1")
    if kind == "ros1":
        writer = Writer1(path)
    else:
        storage = StoragePlugin.MCAP if kind == "ros2 mcap" else StoragePlugin.SQLITE3
        writer = Writer2(path, version=9, storage_plugin=storage)
    connections = {}
    with writer:
        for topic, time, message in ros.messages(driven):
            name, data = ros.data(message)
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=ros.store)
            writer.write(connections[topic], round((EPOCH + time) * 1e9), data)
    return path


@pytest.fixture(scope="module", params=["ros1", "ros2", "ros2 mcap"])
def bag(request, driven, tmp_path_factory):
    folder = tmp_path_factory.mktemp("bag")
    return write_bag(folder / ("a.bag" if request.param == "ros1" else "a"), driven, request.param)


def test_it_holds_what_was_driven_seen_and_true(bag, driven):
    found = list(Bag(f"bag:{bag},{SETTINGS}").messages())
    ours = [message for message in driven if isinstance(message, Displacement)]
    steps = [message for message in found if isinstance(message, Displacement)]
    assert len(steps) == len(ours) - 1
    for step, own in zip(steps, ours[1:], strict=True):
        assert step.time - EPOCH == pytest.approx(own.time, abs=1e-6)
        assert (step.dx, step.dy, step.dpsi) == pytest.approx((own.dx, own.dy, own.dpsi), abs=1e-6)
        assert step.translation_variance == pytest.approx(own.translation_variance, rel=1e-2)
    scans = [message for message in found if isinstance(message, Scan)]
    our_scans = [message for message in driven if isinstance(message, Scan)]
    assert len(scans) == len(our_scans)
    for scan, own in zip(scans, our_scans, strict=True):
        bins = ((own.angles + math.pi) / (2 * math.pi) * BINS).astype(int)
        alone = np.flatnonzero((np.bincount(bins, minlength=BINS)[bins] == 1) & (own.ranges > 0.0))
        assert len(alone) > 100
        assert scan.ranges[bins[alone]] == pytest.approx(own.ranges[alone], abs=1e-6)
        assert np.abs(scan.angles[bins] - own.angles).max() <= math.pi / BINS + 1e-6
        assert np.count_nonzero(scan.ranges) <= np.count_nonzero(own.ranges)
        assert scan.time - EPOCH == pytest.approx(own.time, abs=1e-3)
    bodies = [message for message in found if isinstance(message, Bodies)]
    ours_seen = [message for message in driven if isinstance(message, Bodies)]
    assert len(bodies) == sum(len(message.identities) for message in ours_seen)
    assert {int(message.identities[0]) for message in bodies} == {1, 2, 3, 4}


@pytest.mark.parametrize("bag", ["ros2"], indirect=True)
def test_a_robot_that_is_not_ours_is_localized_from_its_own_bag(bag, tmp_path):
    source = f"bag:{bag},{SETTINGS}"
    (row,) = score_sources([source], ["pmb"], ["lidar"])
    assert row.gospa_m < 0.3
    output = tmp_path / "a.mcap"
    figures = export(source, output)
    assert figures["scan_messages"] > 50
    (exported,) = score_sources([str(output)], ["pmb"], ["lidar"])
    assert exported.gospa_m == row.gospa_m
    assert Recording(output).header.config.name == "a"


def test_a_bag_that_is_given_as_a_recording_is_told_apart(bag):
    if bag.is_dir() and (files := list(bag.glob("*.mcap"))):
        with pytest.raises(UserError, match=f"(?s)no recording of swarmloc.*bag:{files[0]}"):
            Recording(files[0])


def test_a_damaged_bag_is_said(bag, tmp_path):
    """Of it, rosbags raises whatever its parsers meet: of ROS 2, UnicodeDecodeError here."""
    copy = tmp_path / bag.name
    (shutil.copytree if bag.is_dir() else shutil.copy)(bag, copy)
    for file in copy.iterdir() if copy.is_dir() else [copy]:
        file.write_bytes(file.read_bytes().replace(b"LaserScan", 9 * b"\xff"))
    with pytest.raises(UserError, match="cannot read the bag"):
        list(Bag(f"bag:{copy}").messages())
    with pytest.raises(UserError, match="cannot read the bag"):
        read_bag_bodies(copy)


def test_what_is_not_in_a_bag_is_said(bag, tmp_path):
    for settings, words in (
        ("scan=/laser", "no topic /laser of sensor_msgs/msg/LaserScan"),
        ("own=/nobody", "no topic /nobody of geometry_msgs/msg/PoseStamped"),
        ("speed=3", "has no setting 'speed=3'"),
    ):
        with pytest.raises(UserError, match=words):
            Bag(f"bag:{bag},{settings}")
    (tmp_path / "text.bag").write_text("hello")
    for name in ("text.bag", "none.bag"):
        with pytest.raises(UserError, match="cannot read the bag"):
            Bag(f"bag:{tmp_path / name}")
