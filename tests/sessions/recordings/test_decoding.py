"""A recording decoded again: the same where the decoders are, and what they missed where not."""

import numpy as np
import pytest

from host.errors import UserError
from host.messages import DeviceBytes, Displacement, Scan
from host.recording.log import Recorder, Recording
from host.sessions.recordings.decoding import Redecoder
from host.sessions.recordings.replaying import replay_recording
from tools.kill_recordings import what_a_run_records

SCENARIO = "arena4:seconds=4,seed=2"


@pytest.fixture(scope="module")
def recorded():
    return what_a_run_records(SCENARIO)


def write(path, recorded, keep=lambda message: True):
    header, messages = recorded
    with Recorder(path, header) as recorder:
        for message in filter(keep, messages):
            recorder.write(message)
    return Recording(path)


def bits(message):
    if isinstance(message, Scan):
        return message.time, message.angles.tobytes(), message.ranges.tobytes()
    return message if isinstance(message, Displacement) else (type(message), message.time)


def test_the_bytes_give_every_estimate_again(recorded, tmp_path):
    recording = write(tmp_path / "a.mcap", recorded)
    for from_bytes in (False, True):
        replayed = replay_recording(recording, from_bytes=from_bytes)
        replayed.check()
        assert replayed.comparisons["estimates"].equal > 50
    again = list(Redecoder(recording.header.config).of(recording.messages()))
    assert list(map(bits, again)) == list(map(bits, recording.messages()))
    assert sum(isinstance(message, Scan) for message in again) > 20


def test_what_was_not_decoded_then_is_there_now(recorded, tmp_path):
    _, messages = recorded
    scans = [message for message in messages if isinstance(message, Scan)]
    lost = {scan.time for scan in scans[5:15:2]} | {scans[-1].time}
    recording = write(
        tmp_path / "a.mcap", recorded, lambda message: getattr(message, "time", 0) not in lost
    )
    of_bytes = Redecoder(recording.header.config).of(recording.messages())
    times = [message.time for message in of_bytes if isinstance(message, Scan)]
    assert times[:-1] == [scan.time for scan in scans][: len(times) - 1]
    assert len(times) >= len(scans) - 1


def test_a_device_without_bytes_keeps_its_messages(recorded, tmp_path):
    recording = write(
        tmp_path / "a.mcap",
        recorded,
        lambda message: not (isinstance(message, DeviceBytes) and message.device == "lidar"),
    )
    again = Redecoder(recording.header.config).of(recording.messages())
    assert np.array_equal(
        [message.time for message in again if isinstance(message, Scan)],
        [message.time for message in recorded[1] if isinstance(message, Scan)],
    )


def test_a_damaged_recording_is_replayed_up_to_there_and_that_is_a_failure(recorded, tmp_path):
    path = tmp_path / "a.mcap"
    write(path, recorded)
    data = bytearray(path.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 2000] = bytes(2000)
    path.write_bytes(data)
    replayed = replay_recording(Recording(path))
    assert replayed.figures["updates"] > 20
    with pytest.raises(UserError, match="is damaged at byte"):
        replayed.check()
