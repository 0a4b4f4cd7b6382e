"""What the person wants: asked at the terminal, or read from a file of answers."""

import socket
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from tools.bring_up.machine import StepError

# Each answer: what is asked, and what it is where nothing is said.
QUESTIONS: dict[str, tuple[str, Any]] = {
    "packages": ("Install this system's packages (apt-get)?", True),
    "rules": ("Write udev rules for the robot's devices, and join their groups?", True),
    "firmware": ("Flash the board?", True),
    "service": ("Start the localizer at boot, as a service of systemd?", True),
    "spin": (
        "Let the wheels turn for the check? The robot stands on the floor, free around.",
        False,
    ),
    "name": ("Name of this robot", ""),
    "lidar": ("Lidar, x4 or x4pro", "x4"),
    "mocap": ("Motion capture: none, natnet or ceiling", "none"),
    "mocap_server": ("Address of the computer with Motive", "192.168.0.100"),
    "body": ("Number of this robot's body in the motion capture", 1),
}


class Answers:
    """given: of a file or of options; what is missing is asked. ask: reads a line."""

    def __init__(
        self, given: Mapping[str, Any], silent: bool, ask: Callable[[str], str] = input
    ) -> None:
        unknown = sorted(set(given) - set(QUESTIONS) - {"settings"})
        if unknown:
            raise StepError(f"unknown answers: {', '.join(unknown)}; known: {', '.join(QUESTIONS)}")
        self._given = dict(given)
        self._silent = silent
        self._ask = ask

    @property
    def settings(self) -> Mapping[str, Any]:
        """Other settings of robot.toml, by dotted key."""
        settings: Mapping[str, Any] = self._given.get("settings", {})
        return settings

    def get(self, name: str) -> Any:
        """The answer to a question; asked once."""
        if name not in self._given:
            question, default = QUESTIONS[name]
            default = default if default != "" else socket.gethostname()
            self._given[name] = default if self._silent else self._asked(question, default)
        return self._given[name]

    def _asked(self, question: str, default: Any) -> Any:
        if isinstance(default, bool):
            answer = self._ask(f"  {question} [{'Y/n' if default else 'y/N'}] ").strip().lower()
            return default if not answer else answer.startswith("y")
        answer = self._ask(f"  {question} [{default}] ").strip()
        return type(default)(answer) if answer else default


def read_answers(path: Path) -> dict[str, Any]:
    """Answers from a TOML file. Raises StepError."""
    try:
        return tomllib.loads(path.read_text("utf-8"))
    except (OSError, tomllib.TOMLDecodeError) as error:
        raise StepError(f"cannot read the answers in {path}: {error}") from error
