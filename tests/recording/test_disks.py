"""Disks that are full, read-only or slow: the recording ends, in words, and nobody waits for it."""

import fcntl
import os
import signal
import struct
import subprocess
import sys
import time

import numpy as np
import pytest
from mcap.reader import make_reader

from host.config import RobotConfig
from host.errors import UserError
from host.messages import Bearings, Estimate, Health, Message, Scan
from host.pipeline import Pipeline
from host.recording import background
from host.recording.background import BackgroundFile, BackgroundRecorder
from host.recording.log import Recorder, Recording, RecordingHeader

HEADER = RecordingHeader(RobotConfig(), "lidar")


def a_scan(k: int) -> Scan:
    random = np.random.default_rng(k)
    angles = np.sort(random.uniform(-3.1, 3.1, 700))
    return Scan(0.1 * k, np.full(700, 0.1 * k), angles, random.uniform(0.1, 3.0, 700))


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 200 kB, and how to remount it."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=200k", "none", str(disk)]
    if os.geteuid() or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("only root may mount a file system")
    yield disk
    subprocess.run(["umount", "-l", str(disk)], check=True)


def test_a_full_disk_ends_the_recording_and_keeps_what_was_written(small_disk):
    path = small_disk / "a.mcap"
    with BackgroundRecorder(path, HEADER) as recorder:
        with pytest.raises(UserError, match="No space left on device"):
            write_scans(recorder)
        with pytest.raises(UserError, match="check the folder and the free space"):
            recorder.write(a_scan(0))
    recording = Recording(path)
    found = list(recording.messages())
    assert len(found) > 10
    for k, scan in enumerate(found):
        assert scan.ranges.tobytes() == a_scan(k).ranges.tobytes()
    assert "unfinished" in recording.remarks[0]
    assert "bytes are there" not in recording.remarks[0]  # it was cut to whole records


def write_scans(recorder):
    for k in range(200):
        recorder.write(a_scan(k))
        time.sleep(0.002)


def wait_until_written(path):
    with path.open() as file:
        fcntl.flock(file, fcntl.LOCK_EX)


def test_a_disk_that_is_read_only_is_said_before_the_run(small_disk):
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    with pytest.raises(UserError, match="Read-only file system"):
        Recorder(small_disk / "a.mcap", HEADER)


def test_a_recording_leaves_nothing_open(tmp_path):
    before = open_descriptors()
    with BackgroundRecorder(tmp_path / "a.mcap", HEADER) as recorder:
        recorder.write(a_scan(0))
    assert open_descriptors() == before


@pytest.mark.parametrize("recorder", [Recorder, BackgroundRecorder])
def test_a_recording_that_cannot_begin_leaves_nothing_open(tmp_path, monkeypatch, recorder):
    def fails(*_):
        raise ValueError("no header")

    monkeypatch.setattr(Recorder, "_begin", fails)
    before = open_descriptors()
    with pytest.raises(ValueError, match="no header"):
        recorder(tmp_path / "a.mcap", HEADER)
    assert open_descriptors() == before


def test_without_a_process_to_write_it_there_is_no_recording_and_no_file(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
    before = open_descriptors()
    with pytest.raises(UserError, match="no process can be started to write it: No such file"):
        BackgroundRecorder(tmp_path / "a.mcap", HEADER)
    assert open_descriptors() == before
    assert not (tmp_path / "a.mcap").exists()


def test_where_no_large_pipe_is_allowed_a_small_one_serves(tmp_path, monkeypatch):
    def refused(*_):
        raise PermissionError  # by fs.pipe-user-pages-soft, or in some containers

    monkeypatch.setattr(background.fcntl, "fcntl", refused)
    with BackgroundRecorder(tmp_path / "a.mcap", HEADER) as recorder:
        write_scans(recorder)
    assert len(list(Recording(tmp_path / "a.mcap").messages())) == 200


def open_descriptors():
    return len(os.listdir("/proc/self/fd"))


def test_a_disk_that_hangs_delays_nobody(tmp_path):
    recorder = BackgroundRecorder(tmp_path / "a.mcap", HEADER)
    os.kill(recorder.pid, signal.SIGSTOP)
    with pytest.raises(UserError, match="its disk is too slow"):  # would hang here if it waited
        write_scans(recorder)
    recorder.picture(bytes(1000), Bearings(0.0, np.zeros(0), np.zeros(0)))  # not any more
    recorder.close()  # known already, so it is not raised again
    os.kill(recorder.pid, signal.SIGCONT)
    wait_until_written(tmp_path / "a.mcap")
    assert len(list(Recording(tmp_path / "a.mcap").messages())) > 40


def test_pictures_are_left_out_where_the_disk_lags(tmp_path):
    with BackgroundRecorder(tmp_path / "a.mcap", HEADER) as recorder:
        os.kill(recorder.pid, signal.SIGSTOP)
        for k in range(40):
            recorder.picture(
                bytes(100_000), Bearings(0.1 * k, np.zeros(0), np.zeros(0), camera="front")
            )
        recorder.write(a_scan(0))
        os.kill(recorder.pid, signal.SIGCONT)
    recording = Recording(tmp_path / "a.mcap")
    assert len(list(recording.messages())) == 1
    assert not recording.remarks
    with (tmp_path / "a.mcap").open("rb") as file:
        topics = [channel.topic for _, channel, _ in make_reader(file).iter_messages()]
    assert 2 <= topics.count("/camera/front/image/compressed") <= 5


def test_what_cannot_be_written_is_said_and_leaves_no_end(tmp_path):
    recorder = BackgroundRecorder(tmp_path / "a.mcap", HEADER)
    recorder.write(Health(0.0, "lidar", True, "", {"points": 1}))
    for _ in range(2):
        with pytest.raises(struct.error):
            recorder.write(Health(1.0, "lidar", True, "", {"points": 1 << 70}))
    recorder.close()
    recording = Recording(tmp_path / "a.mcap")
    assert [message.time for message in recording.messages()] == [0.0]
    assert "unfinished" in recording.remarks[0]


RUN_AND_BE_KILLED = """
import os, pathlib, signal, sys
from host.config import RobotConfig
from host.messages import Health
from host.recording.background import BackgroundFile, BackgroundRecorder
from host.recording.log import RecordingHeader
recorder = BackgroundRecorder(pathlib.Path(sys.argv[1]), RecordingHeader(RobotConfig(), "lidar"))
os.kill(recorder.pid, signal.SIGTERM)  # as systemd does with all processes of a service
for k in range(200):
    recorder.write(Health(float(k), "lidar", True, "", {}))
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_run_that_is_killed_loses_nothing_of_what_it_recorded(tmp_path):
    path = tmp_path / "a.mcap"
    killed = subprocess.run([sys.executable, "-c", RUN_AND_BE_KILLED, str(path)], check=False)
    assert killed.returncode == -signal.SIGKILL
    wait_until_written(path)
    recording = Recording(path)
    assert len(list(recording.messages())) == 200
    assert "unfinished" in recording.remarks[0]


def test_who_is_interrupted_writes_no_end(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        interrupted(tmp_path / "a.mcap")
    recording = Recording(tmp_path / "a.mcap")
    assert len(list(recording.messages())) == 1
    assert "unfinished" in recording.remarks[0]


def interrupted(path):
    with Recorder(path, HEADER) as recorder:
        recorder.write(a_scan(0))
        raise KeyboardInterrupt


class Scans:
    """A lidar."""

    def run(self, emit, stop):
        for k in range(1000):
            if stop.wait(0.002):
                return
            emit(a_scan(k))


def test_a_full_disk_does_not_end_the_run(small_disk):
    from host.estimator import profiles
    from host.localizer import Localizer

    config = RobotConfig()
    taken: list[Message] = []
    recorder = BackgroundRecorder(small_disk / "a.mcap", HEADER)
    localizer = Localizer(config, profiles.make("perera2021", config))
    sinks = {"recording": recorder.write, "list": taken.append}
    with recorder, Pipeline(localizer, {"lidar": Scans()}, sinks) as pipeline:
        end = time.monotonic() + 30.0
        while "recording" not in pipeline.failures and time.monotonic() < end:
            time.sleep(0.01)
        before = len(taken)
        while len(taken) < before + 20 and time.monotonic() < end:
            time.sleep(0.01)
    assert len(taken) >= before + 20
    (said,) = [m for m in taken if isinstance(m, Health) and m.device == "recording"]
    assert not said.ok
    assert "No space left on device" in said.reason
    assert isinstance(taken[-1], Scan | Estimate | Health)


def test_a_writing_process_that_is_killed_before_the_end_is_said_at_the_end(tmp_path):
    file = BackgroundFile(tmp_path / "run.mcap")
    file.write(b"record")
    file.whole()
    os.kill(file.pid, signal.SIGKILL)
    with pytest.raises(UserError, match="process that writes it was killed"):
        file.close()
