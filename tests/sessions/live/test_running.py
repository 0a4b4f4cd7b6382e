"""A run without a screen: any sinks, any reason to stop, and what failed on the way."""

import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from host.config import RobotConfig
from host.errors import UserError
from host.messages import Displacement, Estimate, Message, Positions
from host.recording.log import Recording
from host.sessions.live.running import run_devices
from host.sources.rig import Rig


class Steps:
    """A device that sends a displacement and a teammate straight ahead, 50 times a second."""

    def run(self, emit: Callable[[Message], None], stop: threading.Event) -> None:
        while not stop.wait(0.02):
            now = time.monotonic()
            emit(Displacement(now, 0.02, 0.0, 0.0, 0.0))
            emit(Positions(now, np.array([[1.0, 0.0]]), np.array([1e-4 * np.eye(2)])))


class Broken:
    """A device that fails at once."""

    def run(self, emit: Callable[[Message], None], stop: threading.Event) -> None:
        raise UserError("the device burns")


def a_rig(**sources: Steps | Broken) -> Rig:
    return Rig("test", RobotConfig(), "lidar", sources)


def test_every_sink_gets_every_message_until_it_is_stopped(tmp_path: Path) -> None:
    taken: list[Message] = []
    watched: list[int] = []
    path = tmp_path / "run.mcap"
    outcome = run_devices(
        a_rig(steps=Steps()),
        {"list": taken.append},
        record=path,
        stopped=lambda: any(isinstance(message, Estimate) for message in list(taken)),
        watch=lambda: watched.append(len(taken)),
        watch_every_s=0.01,
    )
    assert not outcome.failures
    assert outcome.figures["updates"] == sum(isinstance(m, Estimate) for m in taken) >= 1
    assert watched[-1] == len(taken)  # the last look is after the end
    recorded = [message.time for message in Recording(path).messages()]
    assert recorded == [message.time for message in taken]


def test_it_ends_by_itself_and_names_what_failed() -> None:
    begin = time.monotonic()
    outcome = run_devices(a_rig(steps=Steps(), broken=Broken()), {}, seconds=0.3)
    assert time.monotonic() - begin >= 0.3
    assert list(outcome.failures) == ["broken"]
    assert outcome.figures["devices"]["broken"]["reason"] == "the device burns"
    assert outcome.figures["updates"] > 0


def test_a_recording_that_exists_is_refused_before_any_device_starts(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_text("")
    with pytest.raises(UserError, match="exists already"):
        run_devices(a_rig(steps=Steps()), {}, record=path)
