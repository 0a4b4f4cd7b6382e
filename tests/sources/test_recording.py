"""What a recording says of itself while it grows, and when its disk does not keep up."""

import os
import shutil
import signal
import threading
from collections import namedtuple
from pathlib import Path

import numpy as np
import pytest

from host.config import RobotConfig
from host.doctor import disk
from host.doctor.findings import Level
from host.messages import Health, Scan
from host.recording.background import BackgroundRecorder
from host.recording.log import RecordingHeader
from host.sources import recording
from host.sources.recording import RecordingHealth

Usage = namedtuple("Usage", "free")


def a_scan(k: int) -> Scan:
    ranges = np.random.default_rng(k).uniform(0.1, 3.0, 700)
    return Scan(0.1 * k, np.full(700, 0.1 * k), np.linspace(-3.0, 3.0, 700), ranges)


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording, "_PERIOD_S", 0.05)


def said_of(recorder: BackgroundRecorder, path: Path, scans: int = 10) -> Health:
    """Its third report, scans being written meanwhile."""
    stop, health = threading.Event(), list[Health]()

    def emit(message: object) -> None:
        assert isinstance(message, Health)
        health.append(message)
        for k in range(scans):
            recorder.write(a_scan(k))
        if len(health) == 3:
            stop.set()

    RecordingHealth(recorder, path).run(emit, stop)
    return health[-1]


@pytest.mark.usefixtures("quick")
def test_a_recording_that_grows_says_how_fast(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with BackgroundRecorder(path, RecordingHeader(RobotConfig(), "lidar")) as recorder:
        said = said_of(recorder, path)
    assert said.device == "recording"
    assert said.ok
    rate, unit = said.reason.split()
    assert float(rate) > 10.0
    assert unit == "kB/s"


@pytest.mark.usefixtures("quick")
def test_a_disk_that_is_behind_is_said_with_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recording, "_BEHIND_S", 0.01)
    path = tmp_path / "a.mcap"
    with BackgroundRecorder(path, RecordingHeader(RobotConfig(), "lidar")) as recorder:
        os.kill(recorder.pid, signal.SIGSTOP)
        behind = said_of(recorder, path)
        without_pictures = said_of(recorder, path, scans=60)
        os.kill(recorder.pid, signal.SIGCONT)
    assert behind.ok
    assert "s behind: use another card" in behind.reason
    assert "pictures are left out: use another card" in without_pictures.reason


@pytest.mark.usefixtures("quick")
def test_a_recording_that_has_failed_stays_failed(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with BackgroundRecorder(path, RecordingHeader(RobotConfig(), "lidar")) as recorder:
        recorder.failure = OSError("the card is gone")
        said = said_of(recorder, path, scans=0)
        recorder.failure = None
    assert not said.ok
    assert said.reason == "the card is gone"


def test_a_disk_that_is_nearly_full_is_said_by_run_and_doctor_alike(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert recording.room(tmp_path) == (None, [])  # this computer's own
    for free, level, words in (
        (3e8, Level.WARN, "only 300 MB are free, for 2.1 h"),
        (2e7, Level.FAIL, "only 20 MB are free"),
    ):
        monkeypatch.setattr(shutil, "disk_usage", lambda folder, free=free: Usage(int(free)))
        found = [each for each in disk.findings(tmp_path) if words in each.what]
        assert [each.level for each in found] == [level]
        assert found[0].next_step == recording.DELETE


def test_a_disk_that_was_pulled_out_is_said_by_run_and_doctor_alike(tmp_path: Path) -> None:
    gone = tmp_path / "stick"
    full, _ = recording.room(gone)
    assert str(full) == (
        f"nothing can be recorded in {gone}\nNo such file or directory\n{recording.OTHER_DISK}"
    )
    assert [each.next_step for each in disk.findings(gone)] == [recording.OTHER_DISK]
