"""`swarmloc replay`: a recording through the localizer again."""

import contextlib
import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import click
import numpy as np

from host.cli import options
from host.cli.console import FRAME_S, Console, State
from host.cli.tally import Tally, rounded, summary, timing
from host.config import RobotConfig
from host.errors import UserError
from host.estimator import profiles
from host.evaluation.labels import TruthTrack
from host.evaluation.metrics import Accumulator
from host.evaluation.runner import Timed
from host.evaluation.truth_scoring import AfterPositions, score
from host.localizer import Localizer
from host.messages import Bearings, Displacement, Estimate, Health, Message, Positions, Scan, Truth
from host.recording.log import SUFFIX, Recording
from host.sessions.runs import read_as
from host.sources.sensors import SENSORS, uses

Watcher = Callable[[Message | None, Sequence[Estimate]], None]
_SCORED = ("gospa_m", "localisation_m", "missed", "false", "rmse_m")


class Comparison:
    """Whether what is estimated now is bit for bit what was recorded.

    equal, different: how many estimates, where `any_recorded`; since: time (s) of the first
    different one.
    """

    def __init__(self) -> None:
        self.equal = 0
        self.different = 0
        self.any_recorded = False
        self.since = math.nan
        self._recorded: list[Estimate] = []
        self._made: list[Estimate] = []

    def take(self, message: Message | None, made: Sequence[Estimate]) -> None:
        """Note the recording's next message, None after the last, and what was made of it."""
        if isinstance(message, Estimate):
            self._recorded.append(message)
            self.any_recorded = True
        elif isinstance(message, Scan | Positions | Bearings | Displacement):
            # The estimates of one message are recorded before the next: these have no equal.
            self._note_differences([*self._recorded, *self._made])
            self._recorded, self._made = [], []
        self._made += made
        pairs = list(zip(self._recorded, self._made, strict=False))
        different = [new for old, new in pairs if _bits(old) != _bits(new)]
        self.equal += len(pairs) - len(different)
        self._note_differences(different)
        self._recorded, self._made = self._recorded[len(pairs) :], self._made[len(pairs) :]
        if message is None:
            # A run that was killed lacks the estimates of its last message; that is no difference.
            self._note_differences(self._recorded)

    def _note_differences(self, estimates: Sequence[Estimate]) -> None:
        if estimates and not self.different:
            self.since = estimates[0].time
        self.different += len(estimates)


def _bits(estimate: Estimate) -> list[tuple[tuple[int, ...], bytes]]:
    values = (np.asarray(getattr(estimate, field.name)) for field in fields(estimate))
    return [(value.shape, value.tobytes()) for value in values]


class Player:
    """Shows messages on the screen, `speed` times as fast as they came."""

    def __init__(self, state: State, speed: float) -> None:
        self._console = Console(state, sys.stdout)
        self._speed = speed
        self._start = time.monotonic()
        self._first = math.nan
        self._next_frame = self._start

    def take(self, message: Message | None, made: Sequence[Estimate]) -> None:
        """Wait until a message is due, then show it and what was made of it."""
        if isinstance(message, Health | Truth):
            self._console.take(message)
        elif isinstance(message, Displacement):  # they come all the time, and at once
            self._first = message.time if math.isnan(self._first) else self._first
            self._wait((message.time - self._first) / self._speed)
        for estimate in made:
            self._console.take(estimate)
        if message is None:
            self._console.draw()

    def close(self) -> None:
        """Give the terminal back."""
        self._console.close()

    def _wait(self, due: float) -> None:
        while True:
            now = time.monotonic()
            if now >= self._next_frame:
                self._next_frame = now + FRAME_S
                self._console.draw()
            left = self._start + due - now
            if left <= 0.0:
                return
            time.sleep(min(left, FRAME_S))


@click.command(
    short_help="A recording through the localizer again.",
    epilog=f"""\b
Examples:
  swarmloc replay today{SUFFIX}
  swarmloc replay today{SUFFIX} --filter perera2021 --speed 1""",
)
@click.argument("file", type=click.Path(path_type=Path))
@options.robot_or_recordings_option
@options.filter_option
@click.option(
    "--sensors",
    type=click.Choice(SENSORS),
    help="Sensors to use besides the wheels.  [default: the recording's]",
)
@click.option(
    "--speed",
    type=click.FloatRange(0.0, min_open=True),
    help="Show it on the screen, so many times as fast as it was.",
)
@options.json_option
def replay(
    file: Path,
    robot_path: Path | None,
    filter_name: str | None,
    sensors: str | None,
    speed: float | None,
    json_path: Path | None,
) -> None:
    """Run a recording through the localizer again, as fast as possible.

    With the recording's own configuration the estimates are compared with the recorded ones;
    exit code 1 where a bit differs.
    """
    recording = Recording(file)
    header = recording.header
    robot = header.config if robot_path is None else options.robot(robot_path)
    robot = options.with_filter(robot, filter_name or robot.filter.profile)
    sensors = sensors or header.sensors
    comparison = Comparison()
    watchers = [comparison.take]
    with contextlib.ExitStack() as stack:
        if speed is not None:
            title = f"{file} (recorded)"
            player = Player(State(title, robot.filter.profile, sensors), speed)
            stack.callback(player.close)
            watchers.append(player.take)
        figures = _replay(recording, robot, sensors, watchers)
    same = robot == header.config and sensors == header.sensors
    if not comparison.any_recorded:
        verdict = "none in the recording to compare with"
    elif not same:
        verdict = "not compared with the recorded ones: the filter, sensors or configuration differ"
    else:
        verdict = (
            f"{comparison.equal} bit-identical, {comparison.different} different from the recorded"
        )
    figures["recorded_estimates"] = verdict
    if recording.torn:
        figures["recording"] = "its last line is torn: the run was cut short"
    click.echo(summary(figures))
    options.write_json(json_path, figures)
    if same and comparison.any_recorded and comparison.different:
        raise UserError(
            f"{comparison.different} estimates differ from the recorded ones",
            f"the first at {comparison.since:.3f} s of the recording's clock",
            "another version of swarmloc or numpy may compute differently: use the one that wrote "
            "it",
        )


def _replay(
    recording: Recording, robot: RobotConfig, sensors: str, watchers: Sequence[Watcher]
) -> dict[str, Any]:
    """Replay to the end; return the figures."""
    update_seconds: list[float] = []
    kept = AfterPositions(Timed(profiles.make(robot.filter.profile, robot), update_seconds))
    tally, truths, times = Tally(), list[Truth](), list[float]()
    begin = time.monotonic()
    messages = read_as(recording, robot)
    for message, made in _steps(messages, Localizer(robot, kept), sensors):
        for watch in watchers:
            watch(message, made)
        if isinstance(message, Truth):
            truths.append(message)
        elif isinstance(message, Health):
            tally.take(message)
        for estimate in made:
            tally.take(estimate)
            times.append(estimate.time)
    wall = time.monotonic() - begin
    seconds = times[-1] - times[0] if times else 0.0
    return {
        "seconds": round(seconds, 1),
        "times_real_time": round(seconds / wall, 1),
        **tally.figures(),
        **timing(update_seconds),
        **_scores(kept.estimates, truths),
        "devices": tally.devices(),
    }


def _steps(
    messages: Iterator[Message], localizer: Localizer, sensors: str
) -> Iterator[tuple[Message | None, list[Estimate]]]:
    """Each message of the recording with the estimates made of it; last, None."""
    for message in messages:
        yield message, localizer.handle(message) if uses(message, sensors) else []
    yield None, localizer.finish()


def _scores(estimates: Sequence[Estimate], truths: list[Truth]) -> dict[str, Any]:
    if not truths:
        return {}
    scored = Accumulator()
    score(estimates, TruthTrack(sorted(truths, key=lambda truth: truth.time)), scored)
    row = scored.row("", "", "", "").as_json()
    return {name: rounded(row[name]) for name in _SCORED}
