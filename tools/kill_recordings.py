"""Recorders killed at random moments: how many messages are lost, and does all else read well?

    python tools/kill_recordings.py 200

A process writes what all sensors of arena4 gave, with the estimates, three times as fast as it
came, and is killed (SIGKILL) somewhere in its first half second. What is read is compared with what
the recorder had been given; the most that was lost is printed. A file that reads badly is an error.
"""

import fcntl
import mmap
import os
import random
import signal
import struct
import sys
import tempfile
import time
from pathlib import Path

from host.config import RobotConfig
from host.errors import UserError
from host.estimator import profiles
from host.localizer import Localizer
from host.messages import Bearings, DeviceBytes, Displacement, Message, Scan
from host.recording.background import BackgroundRecorder
from host.recording.log import Recorder, Recording, RecordingHeader
from host.sessions.recordings.runs import simulated
from host.simulation.world import scenarios

SPEED = 3.0
SCENARIO = "arena4:seconds=12,seed=3,mocap_hz=20"


def main() -> None:
    """Kill as often as was asked for, and print what came of it."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    header, messages = what_a_run_records(SCENARIO)
    with tempfile.TemporaryDirectory() as folder:
        for beside in (False, True):
            lost = [
                killed(Path(folder) / f"{seed}{beside}.mcap", header, messages, seed, beside)
                for seed in range(count)
            ]
            how = "by a process beside the run" if beside else "by the one who records"
            print(
                f"{how}: killed {count} times, lost at most {max(lost)} messages, "
                f"{sum(lost) / count:.2f} in the mean"
            )


def what_a_run_records(scenario: str) -> tuple[RecordingHeader, list[Message]]:
    """The messages of a scenario, each followed by the estimates that are made of it."""
    simulation, messages = simulated(scenarios.parse_scenario(scenario), RobotConfig())
    config = simulation.config
    localizer = Localizer(config, profiles.make(config.filter.profile, config))
    recorded: list[Message] = []
    for message in messages:
        recorded.append(message)
        if isinstance(message, Scan | Bearings | Displacement):
            recorded += localizer.handle(message)
    return RecordingHeader(config, "lidar+camera", scenario), recorded


def killed(
    path: Path, header: RecordingHeader, messages: list[Message], seed: int, beside: bool = False
) -> int:
    """How many of the messages that a recorder was given are lost when it is killed.

    beside: another process writes, as in a run; it is not killed. Raises ValueError where what is
    read is not what was written, in order, from the first on.
    """
    given = mmap.mmap(-1, 8)
    child = os.fork()
    if not child:
        _write(path, header, messages, given, beside)
    time.sleep(random.Random(seed).uniform(0.0, 0.5))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    (count,) = struct.unpack("<q", given)
    if not count:
        return 0
    try:
        with path.open() as file:
            fcntl.flock(file, fcntl.LOCK_EX)  # until who writes is done
        found = list(Recording(path).messages())
    except UserError as error:
        raise ValueError(f"seed {seed}: {error}") from error
    # A device's bytes are kept back for the message that is made of them.
    expected = [message.time for message in messages if not isinstance(message, DeviceBytes)]
    times = [message.time for message in found if not isinstance(message, DeviceBytes)]
    if times != expected[: len(times)]:
        raise ValueError(f"seed {seed}: what was read is not what was written")
    given_count = sum(not isinstance(message, DeviceBytes) for message in messages[:count])
    return max(0, given_count - len(times))


def _write(
    path: Path,
    header: RecordingHeader,
    messages: list[Message],
    given: mmap.mmap,
    beside: bool,
) -> None:
    recorder = BackgroundRecorder(path, header) if beside else Recorder(path, header)
    begin = time.monotonic()
    for number, message in enumerate(messages, 1):
        time.sleep(max(0.0, begin + message.time / SPEED - time.monotonic()))
        recorder.write(message)
        given[:] = struct.pack("<q", number)
    signal.pause()


if __name__ == "__main__":
    main()
