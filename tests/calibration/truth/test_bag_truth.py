"""Truth from ROS bags: every message that holds a pose, whichever axis is up."""

import gc
import io
import math

import numpy as np
import pytest
from mcap.writer import Writer
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from host.calibration.truth.files import read_truth
from host.errors import UserError
from host.recording.elsewhere.named_columns import Units
from host.recording.repair import repair

EPOCH_S = 1_700_000_000
POSES = np.column_stack((np.linspace(0.0, 2.0, 9), np.linspace(1.0, 0.0, 9), np.linspace(0, 3, 9)))
KINDS = ("PoseStamped", "PoseWithCovarianceStamped", "Odometry", "TransformStamped", "TFMessage")


def messages(store, kind, ros1, up):
    """A message of `kind` for each pose; the fourth has no orientation, the sixth is a repeat."""
    full = _full(kind)

    def make(name, *values):
        return store.types[name](*values)

    for k, (x, y, heading) in enumerate(POSES):
        time = make("builtin_interfaces/msg/Time", EPOCH_S + (4 if k == 5 else k), 0)
        header = make("std_msgs/msg/Header", *[0] * ros1, time, "world")
        half = 0.5 * heading
        size = 0.0 if k == 3 else 1.0
        turn = (0.0, 0.0, math.sin(half)) if up == "z" else (0.0, math.sin(half), 0.0)
        place = (x, y, 0.2) if up == "z" else (x, 0.2, -y)
        rotation = make(
            "geometry_msgs/msg/Quaternion", *(size * v for v in turn), size * math.cos(half)
        )
        point = make("geometry_msgs/msg/Point", *place)
        vector = make("geometry_msgs/msg/Vector3", *place)
        pose = make("geometry_msgs/msg/Pose", point, rotation)
        covariant = make("geometry_msgs/msg/PoseWithCovariance", pose, np.zeros(36))
        still = make("geometry_msgs/msg/Twist", vector, vector)
        twist = make("geometry_msgs/msg/TwistWithCovariance", still, np.zeros(36))
        transform = make(
            "geometry_msgs/msg/TransformStamped",
            header,
            "robot",
            make("geometry_msgs/msg/Transform", vector, rotation),
        )
        contents = {
            "PoseStamped": (header, pose),
            "PoseWithCovarianceStamped": (header, covariant),
            "Odometry": (header, "robot", covariant, twist),
            "TFMessage": ([transform],),
        }
        yield make(full, *contents[kind]) if kind in contents else transform


def _full(kind):
    package = {"Odometry": "nav_msgs", "TFMessage": "tf2_msgs"}.get(kind, "geometry_msgs")
    return f"{package}/msg/{kind}"


def bag(folder, kind, form="mcap", up="z"):
    ros1 = form == "bag"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    path = folder / ("a.bag" if ros1 else "a")
    storage = StoragePlugin.MCAP if form == "mcap" else StoragePlugin.SQLITE3
    with Writer1(path) if ros1 else Writer2(path, version=9, storage_plugin=storage) as writer:
        connection = writer.add_connection("/robot", _full(kind), typestore=store)
        write = store.serialize_ros1 if ros1 else store.serialize_cdr
        for k, message in enumerate(messages(store, kind, ros1, up)):
            writer.write(connection, k, write(message, _full(kind)))
    return path


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("up", ["y", "z"])
def test_every_message_with_a_pose(tmp_path, kind, up):
    path = bag(tmp_path, kind, up=up)
    (body,) = read_truth(path / "a.mcap" if up == "z" else path, Units())
    assert body.name == ("robot" if kind == "TFMessage" else "/robot")
    kept = [0, 1, 2, 4, 6, 7, 8]  # without the one of no rotation and the second of its time
    assert (body.times - EPOCH_S).tolist() == kept
    assert body.poses == pytest.approx(POSES[kept])


@pytest.mark.parametrize("form", ["bag", "db3"])
def test_bags_of_other_forms(tmp_path, form):
    (body,) = read_truth(bag(tmp_path, "PoseStamped", form), Units())
    assert len(body.times) == 7


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_no_bag_is_refused(tmp_path):
    """Older versions of rosbags leave a file open that they refuse."""
    (tmp_path / "a.mcap").write_text("time,x,y,heading\n")
    for path in (tmp_path / "a.mcap", tmp_path):
        with pytest.raises(UserError, match="cannot read the bag"):
            read_truth(path, Units())
    gc.collect()


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_of_a_bag_that_was_cut_short_the_rest_can_be_kept(tmp_path):
    """Its poses stand in chunks; the last one is cut."""
    store, name = get_typestore(Stores.ROS2_HUMBLE), _full("PoseStamped")
    content = io.BytesIO()
    writer = Writer(content, chunk_size=1000)
    writer.start(profile="ros2", library="another")
    definition = store.generate_msgdef(name, ros_version=2)[0].encode()
    schema = writer.register_schema(name, "ros2msg", definition)
    channel = writer.register_channel("/robot", "cdr", schema)
    for again in range(20):
        for k, message in enumerate(messages(store, "PoseStamped", False, "z")):
            message.header.stamp.sec += 10 * again
            data = bytes(store.serialize_cdr(message, name))
            writer.add_message(channel, 10 * again + k, data, 10 * again + k)
    writer.finish()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(content.getvalue()[: len(content.getvalue()) // 2])
    with pytest.raises(UserError, match=r"record --repair"):
        read_truth(cut, Units())
    gc.collect()
    repair(cut, tmp_path / "kept.mcap")
    (body,) = read_truth(tmp_path / "kept.mcap", Units())
    assert 40 < len(body.times) < 100
    assert body.poses[:3] == pytest.approx(POSES[:3])
