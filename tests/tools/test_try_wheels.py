"""tools/try_wheels.py against the stand-in board on a pseudo-terminal."""

import importlib.util
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner

from host.config import RobotConfig
from host.drivers.romeo.differential_drive import wheel_speeds
from host.messages import Displacement, Health
from host.simulation.devices.romeo_stand_in import RomeoStandIn
from host.simulation.live import Terminal

ROOT = Path(__file__).resolve().parents[2]
SPEC = importlib.util.spec_from_file_location("try_wheels", ROOT / "tools/try_wheels.py")
assert SPEC is not None
assert SPEC.loader is not None
tool = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(tool)


class Plugged:
    """A stand-in whose wheels follow its commands, on a port."""

    def __init__(self, port: Path) -> None:
        self.port = port
        self.commanded: set[tuple[int, int]] = set()
        self._turned = [0.0, 0.0]
        self._last = time.monotonic()
        self._stop = threading.Event()
        self._board = RomeoStandIn(
            lambda _: (int(self._turned[0]), int(self._turned[1])), self._last
        )
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        terminal = Terminal(self.port)
        terminal.plug()
        while not self._stop.wait(0.005):
            now = time.monotonic()
            self._board.receive(terminal.read(), now)
            speeds = self._board.wheel_speeds(now)
            self.commanded.add(speeds)
            for wheel, speed in enumerate(speeds):
                self._turned[wheel] += speed * (now - self._last)
            self._last = now
            for _, data in self._board.transmit(now):
                terminal.write(data)
        terminal.unplug()

    def pull(self) -> None:
        self._stop.set()
        self._thread.join()


@pytest.fixture
def board(tmp_path: Path) -> Iterator[Plugged]:
    plugged = Plugged(tmp_path / "board")
    yield plugged
    plugged.pull()


def run(tmp_path: Path, *arguments: str) -> tuple[int, str]:
    robot = tmp_path / "robot.toml"
    robot.write_text(f'[board]\nport = "{tmp_path / "board"}"\n', encoding="utf-8")
    result = CliRunner().invoke(tool.main, [str(robot), *arguments])
    return result.exit_code, result.output


@pytest.mark.parametrize(
    ("drive", "signs"), [("left", "+ "), ("right", " +"), ("straight", "++"), ("turn", "-+")]
)
def test_drives_what_it_is_told_and_stops(
    tmp_path: Path, board: Plugged, drive: str, signs: str
) -> None:
    for seconds in ("0.7", "10"):  # the first is too short on a computer that stands still
        code, output = run(tmp_path, "--drive", drive, "--seconds", seconds)
        assert code == 0, output
        words = output.splitlines()[-1].split()
        shown = int(words[words.index("left") + 1]), int(words[words.index("right") + 1])
        if any(shown):
            break
    speed = round(wheel_speeds(RobotConfig().wheels, 0.1, 0.0)[0])
    left, right = (0 if sign == " " else int(f"{sign}{speed}") for sign in signs)
    assert board.commanded == {(0, 0), (left, right)}
    for ticks, wanted in zip(shown, (left, right), strict=True):
        assert (ticks > 0) == (wanted > 0)
        assert (ticks < 0) == (wanted < 0)


def test_lines_show_ticks_revolutions_and_a_counter_clockwise_heading() -> None:
    seen = tool.Watch(1920)
    assert seen.line() == "waiting for the board"
    seen.take(Health(0.0, "board", False, "cannot open it\nit is away", {}))
    assert seen.line() == "cannot open it; it is away"
    seen.take(Health(0.0, "board", True, "firmware 1.0.0", {}))
    seen.take(Displacement(1.0, 0.02, 0.0, 0.0, 1.0, ticks=(-960, 1920)))
    seen.take(Displacement(2.0, 0.02, 0.0, 0.0, 0.5, ticks=(0, 1)))
    words = "left -960 ticks -0.50 rev right +1921 ticks +1.00 rev heading +85.9 deg"
    assert seen.line().split() == words.split()
    assert seen.started.is_set()


def test_failures_are_told_in_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tool, "PATIENCE_S", 0.5)
    code, output = run(tmp_path, "--drive", "left")
    assert code == 1
    assert "the board does not report\ncannot open" in output
    result = CliRunner().invoke(tool.main, [str(tmp_path / "none.toml")])
    assert result.exit_code == 1
    assert "cannot read the configuration" in result.output
