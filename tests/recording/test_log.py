"""Recordings: exact both ways, and whatever is damaged is found."""

import dataclasses
import os
import resource
import signal
import subprocess
import sys
import typing
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_typestore

from host.config import Lidar, RobotConfig
from host.errors import UserError
from host.messages import (
    Bearings,
    Bodies,
    DeviceIdentity,
    Displacement,
    Estimate,
    Health,
    Names,
    Picture,
    Positions,
    Scan,
    TeammateOdometry,
    Truth,
)
from host.recording.content import digest
from host.recording.log import Recorder, Recording, RecordingHeader

HEADER = RecordingHeader(
    RobotConfig(name="tester", lidar=Lidar(delay_s=0.1)), "lidar", "arena4:seed=1"
)
KINDS = (
    *(Scan, Positions, Bearings, Displacement, Estimate, Truth, Bodies, Health),
    *(DeviceIdentity, TeammateOdometry, Names),
)

finite = st.floats(allow_nan=False, allow_infinity=False)
integers = st.integers(-(2**62), 2**62)


def floats(*shape: int) -> st.SearchStrategy:
    return arrays(np.float64, shape, elements=st.floats(allow_nan=True, allow_infinity=True))


def values(hint: object, n: int, name: str) -> st.SearchStrategy:
    """Anything that a field of this type may hold."""
    shape = {
        **dict.fromkeys(("positions", "obstacles"), (n, 2)),
        **dict.fromkeys(("covariances", "obstacle_covariances"), (n, 2, 2)),
        "poses": (n, 3),
    }.get(name, (n,))
    options = [part for part in typing.get_args(hint) if part is not type(None)]
    if type(None) in typing.get_args(hint):
        (inner,) = options
        return st.none() | values(inner, n, name)
    if typing.get_origin(hint) is tuple:
        return st.tuples(*(values(part, n, name) for part in options))
    if typing.get_origin(hint) is dict:
        inner = integers if hint == dict[str, int] else st.text(max_size=8)
        return st.dictionaries(st.text(max_size=8), inner, max_size=4)
    if "int64" in str(hint):
        return arrays(np.int64, (n,), elements=integers)
    if "float64" in str(hint):
        return floats(*shape)
    return {
        float: finite,
        int: integers,
        str: st.text(max_size=30),
        bool: st.booleans(),
        bytes: st.binary(max_size=30),
    }[hint]


@st.composite
def messages(draw):
    kind = draw(st.sampled_from(KINDS))
    n = draw(st.integers(0, 5))
    hints = typing.get_type_hints(kind)
    return kind(**{name: draw(values(hint, n, name)) for name, hint in hints.items()})


def bits(value):
    """A value in a form that tells apart whatever differs in one bit, or in type."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, tuple):
        return tuple(map(bits, value))
    return type(value), repr(value)


def all_bits(message):
    if isinstance(message, Estimate):
        return digest(message), message.time, bits(message.labels), message.covariances.shape
    fields = dataclasses.fields(message)
    return type(message), [bits(getattr(message, field.name)) for field in fields]


def some_messages():
    positions = np.array([[1.0, 0.1], [-2.0, 1e-300]])
    return [
        Scan(1.0, np.array([0.9, 1.0]), np.array([0.0, -3.0]), np.array([0.0, 2.0])),
        Positions(1.0, positions, np.tile(np.eye(2), (2, 1, 1)), identities=np.array([4, -1])),
        Displacement(1.25, 0.25, 0.1, 0.0, -0.2, 1e-5, 1e-6, (3, -4)),
        Health(1.5, "lidar", False, "gone\nfor ever ü", {"revolutions": 3}),
    ]


def write(path: Path, content, header=HEADER) -> Path:
    with Recorder(path, header) as recorder:
        for message in content:
            recorder.write(message)
    return path


@settings(derandomize=True, deadline=None, max_examples=60)
@given(content=st.lists(messages(), max_size=6))
def test_what_is_read_is_bit_for_bit_what_was_written(content, tmp_path_factory):
    path = write(tmp_path_factory.mktemp("log") / "a.mcap", content)
    recording = Recording(path)
    assert recording.header == HEADER
    assert [all_bits(m) for m in recording.messages()] == [all_bits(m) for m in content]
    assert not recording.remarks


def test_pictures_are_read_by_who_asks_for_them(tmp_path):
    header = dataclasses.replace(HEADER, unix_s=1_764_000_000.123456)
    pictures = [Picture(1.5, "rear", b"\xff\xd8 one"), Picture(38_000.25, "front", b"")]
    path = write(tmp_path / "a.mcap", [pictures[0], *some_messages(), pictures[1]], header)
    recording = Recording(path)
    assert not any(isinstance(message, Picture) for message in recording.messages())
    assert recording.cameras == ["front", "rear"]
    first, *others, last = recording.messages(with_pictures=True)
    assert len(others) == len(some_messages())
    for found, picture in zip((first, last), pictures, strict=True):
        assert found.time == pytest.approx(picture.time, abs=1e-6)
        assert dataclasses.replace(found, time=picture.time) == picture


def test_estimates_are_rounded_to_what_anyone_would_draw(tmp_path):
    random = np.random.default_rng(5)
    sigmas, sides = 10.0 ** random.uniform(-4, 1, (2, 300))
    places = np.concatenate(
        (random.uniform(-8, 8, (297, 2)), [[0.0, np.inf], [-np.inf, np.nan], [5e-324, 1e300]])
    )
    estimate = Estimate(
        *(1.0, places, sigmas[:, None, None] * np.eye(2), random.uniform(0, 2, 300), sides),
        np.arange(300),
    )
    (found,) = Recording(write(tmp_path / "a.mcap", [estimate])).messages()
    assert isinstance(found, Estimate)
    assert np.abs(found.positions[:297] - places[:297]).max() < 1e-4
    assert found.covariances == pytest.approx(estimate.covariances, rel=2.0**-12)
    assert found.weights == pytest.approx(estimate.weights, rel=2.0**-12)
    assert found.ages == pytest.approx(estimate.ages, rel=2.0**-12)
    assert found.labels.tolist() == list(range(300))
    assert found.positions[297:].tolist()[:1] == [[0.0, np.inf]]
    assert np.isneginf(found.positions[298, 0])
    assert np.isnan(found.positions[298, 1])
    assert found.positions[299].tolist() == [0.0, np.inf]


def test_pictures_are_there_for_other_tools(tmp_path):
    path = write(tmp_path / "a.mcap", [Picture(1.5, "rear", b"\xff\xd8 jpeg"), *some_messages()])
    with path.open("rb") as file:
        ((schema, channel, message),) = make_reader(file).iter_messages(
            "/camera/rear/image/compressed"
        )
    store = get_typestore(Stores.ROS2_HUMBLE)
    picture = store.deserialize_cdr(message.data, schema.name)
    assert (picture.format, bytes(picture.data)) == ("jpeg", b"\xff\xd8 jpeg")
    assert picture.header.frame_id == "rear_camera"
    assert (picture.header.stamp.sec, picture.header.stamp.nanosec) == (1, 500_000_000)
    assert channel.message_encoding == "cdr"
    recording = Recording(path)
    assert len(list(recording.messages())) == len(some_messages())
    assert not recording.remarks


def test_arrays_can_be_written_to(tmp_path):
    scan = next(Recording(write(tmp_path / "a", some_messages())).messages())
    scan.ranges[0] = 1.0


def test_other_files_and_no_files_are_refused_in_words(tmp_path):
    (tmp_path / "text").write_text("hello\n")
    with pytest.raises(UserError, match="not a swarmloc recording"):
        Recording(tmp_path / "text")
    with pytest.raises(UserError, match="No such file"):
        Recording(tmp_path / "nothing")
    with pytest.raises(UserError, match="cannot read"):
        Recording(tmp_path)


def test_a_recording_is_never_overwritten(tmp_path):
    path = write(tmp_path / "a", some_messages())
    before = path.read_bytes()
    with pytest.raises(UserError, match="exists already"):
        Recorder(path, HEADER)
    assert path.read_bytes() == before
    with pytest.raises(UserError, match="cannot write"):
        Recorder(tmp_path / "no" / "folder", HEADER)


def test_a_full_disk_is_told_in_words(tmp_path):
    _, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    with Recorder(tmp_path / "a", HEADER) as recorder:
        resource.setrlimit(resource.RLIMIT_FSIZE, ((tmp_path / "a").stat().st_size + 10, hard))
        try:
            with pytest.raises(UserError, match="cannot write"):
                recorder.write(some_messages()[0])
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
    recording = Recording(tmp_path / "a")
    assert list(recording.messages()) == []
    assert "unfinished" in recording.remarks[0]


def test_killed_it_has_lost_nothing_that_was_written(tmp_path):
    script = (
        "import os, signal, sys, pathlib\n"
        "from host.config import RobotConfig\n"
        "from host.messages import Health\n"
        "from host.recording.log import RecordingHeader, Recorder\n"
        "recorder = Recorder(pathlib.Path(sys.argv[1]), RecordingHeader(RobotConfig(), 'lidar'))\n"
        "for k in range(100):\n"
        "    recorder.write(Health(float(k), 'lidar', True, '', {}))\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    path = tmp_path / "a"
    done = subprocess.run([sys.executable, "-c", script, str(path)], env=os.environ, check=False)
    assert done.returncode == -signal.SIGKILL
    assert [m.time for m in Recording(path).messages()] == [float(k) for k in range(100)]
