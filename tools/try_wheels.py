"""Shows what the wheels do, to find out what is wired the other way round (docs/hardware.md).

    .venv/bin/python tools/try_wheels.py my_robot.toml                 # rotate them by hand
    .venv/bin/python tools/try_wheels.py my_robot.toml --drive left    # one drives forward, slowly

Lift the wheels off the ground first: one whose motor and encoder disagree runs at full speed.
"""

import math
import threading
import time
from pathlib import Path

import click

from host import config
from host.config import RobotConfig
from host.drivers.romeo.device import Romeo
from host.errors import UserError, one_line
from host.messages import Displacement, Health, Message

SPEED_MPS = 0.1
WHEEL_SPEEDS = {"left": (1, 0), "right": (0, 1), "straight": (1, 1), "turn": (-1, 1)}
LINE_S = 0.5
COMMAND_S = 0.05  # well within the life of a command
PATIENCE_S = 10.0  # for the first displacement


class Watch:
    """Sums what the board reports. counts_per_turn: as in robot.toml."""

    def __init__(self, counts_per_turn: int) -> None:
        self.started = threading.Event()  # set by the first displacement
        self._counts_per_turn = counts_per_turn
        self._lock = threading.Lock()
        self._left, self._right, self._heading = 0, 0, 0.0
        self._health = "waiting for the board"

    def take(self, message: Message) -> None:
        """Note a message of the board."""
        with self._lock:
            if isinstance(message, Displacement) and message.ticks is not None:
                self._left += message.ticks[0]
                self._right += message.ticks[1]
                self._heading += message.dpsi
                self.started.set()
            elif isinstance(message, Health):
                self._health = "" if message.ok else one_line(message.reason)

    def line(self) -> str:
        """Ticks and revolutions of both wheels and the heading; or why there are none."""
        with self._lock:
            wheels = "   ".join(
                f"{name} {ticks:+7d} ticks {ticks / self._counts_per_turn:+7.2f} rev"
                for name, ticks in (("left", self._left), ("right", self._right))
            )
            heading = math.degrees(self._heading)
            if not self.started.is_set():
                return self._health
            # Also of a board with a fault: its ticks may show what it is.
            return f"{wheels}   heading {heading:+7.1f} deg   {self._health}".rstrip()


def motion(drive: str, robot: RobotConfig) -> tuple[float, float]:
    """Speed (m/s) and turn rate (rad/s, counter-clockwise) of what `--drive` names."""
    left, right = WHEEL_SPEEDS[drive]
    track = robot.wheels.track_m
    return SPEED_MPS * (left + right) / 2.0, SPEED_MPS * (right - left) / track


def watch(robot: RobotConfig, drive: str | None, seconds: float) -> None:
    """Print a line each LINE_S for so long, from the first displacement on where it drives."""
    romeo, seen, stop = Romeo(robot), Watch(robot.wheels.counts_per_turn), threading.Event()
    driver = threading.Thread(target=romeo.run, args=(seen.take, stop), daemon=True)
    driver.start()
    try:
        if drive is not None and not seen.started.wait(PATIENCE_S):
            raise UserError("the board does not report", seen.line())
        end = time.monotonic() + seconds
        next_line = time.monotonic() + LINE_S
        while time.monotonic() < end:
            if drive is not None:
                romeo.command(*motion(drive, robot))
            time.sleep(COMMAND_S)
            if time.monotonic() >= next_line:
                click.echo(seen.line())
                next_line += LINE_S
        click.echo(seen.line())
    finally:
        stop.set()  # the driver stops the wheels
        driver.join()


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("robot_toml", type=click.Path(path_type=Path))
@click.option(
    "--drive",
    type=click.Choice(list(WHEEL_SPEEDS)),
    help="Drive one wheel or both forward at 0.1 m/s, or rotate left on the spot.",
)
@click.option(
    "--seconds", type=click.FloatRange(0.1), help="For so long.  [default: 3 driving, else 600]"
)
def main(robot_toml: Path, drive: str | None, seconds: float | None) -> None:
    """Show ticks and revolutions of both wheels, rotated by hand or, with --drive, by a motor.

    Lift the wheels off the ground first.
    """
    try:
        watch(config.load_config(robot_toml), drive, seconds or (600.0 if drive is None else 3.0))
    except UserError as error:
        raise click.ClickException(str(error)) from error


if __name__ == "__main__":
    main()
