"""Recordings as they were before MCAP are still read, and their damage is found."""

import base64
import json
import zlib

import numpy as np
import pytest

from host.config import RobotConfig
from host.errors import UserError
from host.messages import Bearings, Displacement, Health, Scan
from host.recording.log import Recording

CONFIG = RobotConfig(name="tester")


def sealed(content: dict) -> bytes:
    """A line as the recorder of that time wrote it."""
    body = json.dumps(content, separators=(",", ":")).encode()
    return b'{"crc":"%08x",%b\n' % (zlib.crc32(body), body[1:])


def array(values, name="f8"):
    data = np.asarray(values, dtype=f"<{name}")
    return [name, list(data.shape), base64.b64encode(data.tobytes()).decode()]


def header(**changed) -> bytes:
    content = {
        "kind": "header",
        "version": 1,
        "robot": "tester",
        "sensors": "lidar",
        "scenario": "arena4:seed=1",
        "config": CONFIG.model_dump(mode="json"),
    }
    return sealed(content | changed)


def lines() -> list[bytes]:
    return [
        header(),
        sealed(
            {
                "kind": "scan",
                "time": 1.0,
                "times": array([0.9, 1.0]),
                "angles": array([0.0, -3.0]),
                "ranges": array([0.0, 2.0]),
            }
        ),
        sealed(
            {
                "kind": "displacement",
                "time": 1.25,
                "interval": 0.25,
                "dx": 0.1,
                "dy": 0.0,
                "dpsi": -0.2,
                "translation_variance": 1e-5,
                "heading_variance": 1e-6,
                "ticks": [3, -4],
            }
        ),
        sealed(
            {
                "kind": "bearings",
                "time": 1.3,
                "bearings": array([0.5]),
                "variances": array([1e-4]),
                "eye": "rear",
            }
        ),
        sealed(
            {
                "kind": "health",
                "time": 1.5,
                "device": "lidar",
                "ok": False,
                "reason": "gone\nü",
                "counts": {"revolutions": 3},
            }
        ),
    ]


def write(path, content):
    path.write_bytes(b"".join(content))
    return path


def test_an_old_recording_is_read(tmp_path):
    recording = Recording(write(tmp_path / "a.swarmloc", lines()))
    assert recording.header.config == CONFIG
    assert (recording.header.sensors, recording.header.scenario) == ("lidar", "arena4:seed=1")
    scan, step, bearings, health = recording.messages()
    assert isinstance(scan, Scan)
    assert scan.ranges.tolist() == [0.0, 2.0]
    scan.ranges[0] = 1.0  # it can be written to
    assert step == Displacement(1.25, 0.25, 0.1, 0.0, -0.2, 1e-5, 1e-6, (3, -4))
    assert isinstance(bearings, Bearings)
    assert bearings.camera == "rear"
    assert health == Health(1.5, "lidar", False, "gone\nü", {"revolutions": 3})
    assert not recording.remarks


def test_cut_anywhere_it_loses_no_complete_line(tmp_path):
    content = lines()
    whole = b"".join(content)
    ends = np.cumsum([len(line) for line in content]).tolist()
    for cut in range(0, len(whole) + 1, 7):
        path = write(tmp_path / "cut", [whole[:cut]])
        if cut < ends[0]:
            with pytest.raises(UserError, match=r"holds no recording|not a swarmloc recording"):
                Recording(path)
            continue
        recording = Recording(path)
        assert len(list(recording.messages())) == sum(end <= cut for end in ends) - 1
        assert bool(recording.remarks) == (cut not in ends)


def test_every_damaged_byte_is_found_and_its_line_named(tmp_path):
    content = lines()
    random = np.random.default_rng(7)
    for number in range(2, len(content)):
        for place in range(0, len(content[number - 1]) - 1, 3):
            line = bytearray(content[number - 1])
            line[place] ^= 1 << int(random.integers(8))
            if line[place] in b"\n\r":
                continue  # two torn lines
            path = write(
                tmp_path / "damaged", [*content[: number - 1], bytes(line), *content[number:]]
            )
            with pytest.raises(UserError, match=f"line {number}:"):
                list(Recording(path).messages())


@pytest.mark.parametrize(
    "content",
    [
        {"kind": "tachyon", "time": 1.0},
        {"time": 1.0},
        {"kind": "truth", "time": 1.0},
        {"kind": "truth", "time": 1.0, "identities": ["i8", [3], "AAAA"], "positions": []},
        {"kind": "truth", "time": 1.0, "identities": [], "positions": ["f8", [0, 2], ""]},
    ],
)
def test_what_is_sound_but_makes_no_message_is_damage(tmp_path, content):
    path = write(tmp_path / "a", [header(), sealed(content)])
    with pytest.raises(UserError, match="line 2: the recording is damaged"):
        list(Recording(path).messages())


def test_what_it_does_not_know_is_refused_in_words(tmp_path):
    for line, words in (
        (header(version=99), "version 99"),
        (header(config={"wings": 2}), "configuration cannot be read"),
        (b"hello\n", "not a swarmloc recording"),
    ):
        with pytest.raises(UserError, match=words):
            Recording(write(tmp_path / "a", [line]))
