"""A recording through the localizer again, and whether every estimate comes out bit-identical."""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from host.calibration.reinterpretation import Reinterpretation
from host.config import RobotConfig
from host.errors import UserError
from host.estimator import profiles
from host.evaluation.labels import TruthTrack
from host.evaluation.metrics import Accumulator
from host.evaluation.monitored import MonitoredFilter
from host.evaluation.truth_scoring import score_by_track
from host.localizer import Localizer, unnoticed
from host.message_checks import fault
from host.messages import (
    Bearings,
    Displacement,
    Estimate,
    Health,
    Measurement,
    Message,
    Names,
    Positions,
    Scan,
    Truth,
)
from host.recording.content import digest
from host.recording.log import Recording
from host.sessions.figures import Tally, rounded, timing
from host.sessions.recordings.decoding import Redecoder
from host.sources.sensors import uses
from host.systems.id_phd.naming import Naming

Result = Estimate | Names
Watcher = Callable[[Message | None, Sequence[Result]], None]
_NOT_COMPARED = "not compared with the recorded ones: the filter, sensors or configuration differ"
_SCORED = ("gospa_m", "localisation_m", "missed", "false", "rmse_m")


class Comparison:
    """Whether what is made of a recording now is bit for bit what was recorded.

    kind: of results. equal, different: how many, where `any_recorded`; since: time (s) of the
    first different one.
    """

    def __init__(self, kind: type[Result] = Estimate) -> None:
        self._kind = kind
        self.equal = 0
        self.different = 0
        self.any_recorded = False
        self.since = math.nan
        self._recorded: list[Result] = []
        self._made: list[Result] = []

    @property
    def verdict(self) -> str:
        """In words."""
        return f"{self.equal} bit-identical, {self.different} different from the recorded"

    def take(self, message: Message | None, made: Sequence[Result]) -> None:
        """Note the recording's next message, None after the last, and what was made of it."""
        if isinstance(message, Estimate | Names) and isinstance(message, self._kind):
            self._recorded.append(message)
            self.any_recorded = True
        elif isinstance(message, Scan | Positions | Bearings | Displacement):
            # The estimates of one message are recorded before the next: these have no equal.
            self._note_differences([*self._recorded, *self._made])
            self._recorded, self._made = [], []
        self._made += [each for each in made if isinstance(each, self._kind)]
        pairs = list(zip(self._recorded, self._made, strict=False))
        different = [new for old, new in pairs if digest(old) != digest(new)]
        self.equal += len(pairs) - len(different)
        self._note_differences(different)
        self._recorded, self._made = self._recorded[len(pairs) :], self._made[len(pairs) :]
        if message is None:
            # A run that was killed lacks the estimates of its last message; that is no difference.
            self._note_differences(self._recorded)

    def _note_differences(self, results: Sequence[Result]) -> None:
        if results and not self.different:
            self.since = results[0].time
        self.different += len(results)


@dataclass(frozen=True, slots=True)
class Replayed:
    """figures: of the summary, by name. comparisons: with what was recorded, by what it is of.

    There are none of what the recording does not hold, and none at all where filter, sensors or
    configuration are not the recording's. damage: what ended it early.
    """

    figures: dict[str, Any]
    comparisons: dict[str, Comparison]
    damage: UserError | None = None

    def check(self) -> None:
        """Raise UserError where the recording is damaged, or what was made differs from it."""
        if self.damage is not None:
            raise self.damage
        for name, comparison in self.comparisons.items():
            if comparison.different:
                raise UserError(
                    f"{comparison.different} {name} differ from the recorded ones",
                    f"the first at {comparison.since:.3f} s of the recording's clock",
                    "another version of swarmloc or numpy may compute differently: use the one "
                    "that wrote it",
                )


def replay_recording(
    recording: Recording,
    robot: RobotConfig | None = None,
    sensors: str | None = None,
    watchers: Sequence[Watcher] = (),
    from_bytes: bool = False,
    used: Callable[[Measurement, Positions | Bearings], None] = unnoticed,
    with_pictures: bool = False,
    naming: Naming | None = None,
) -> Replayed:
    """Run a recording through the localizer to its end or to its damage, as fast as possible.

    robot, sensors: the recording's own where None. watchers: called with each message, None after
    the last, and the estimates made of it. from_bytes: decode the devices' bytes again. used:
    called with each measurement and what was found in it. with_pictures: watchers get these, too.
    naming: a new one, to be asked meanwhile.
    """
    header = recording.header
    robot, sensors = robot or header.config, sensors or header.sensors
    comparisons = {"estimates": Comparison(Estimate), "names": Comparison(Names)}
    watchers = [*(comparison.take for comparison in comparisons.values()), *watchers]
    readable = _Readable(recording, from_bytes, with_pictures)
    seen = Reinterpretation(header.config, robot)
    messages = map(seen.of, readable.messages())
    figures = _replay(messages, robot, sensors, watchers, used, naming or Naming())
    same = robot == header.config and sensors == header.sensors
    recorded = {name: each for name, each in comparisons.items() if each.any_recorded}
    figures["recorded_estimates"] = "none in the recording to compare with"
    for name, comparison in recorded.items():
        figures[f"recorded_{name}"] = comparison.verdict if same else _NOT_COMPARED
    damage = readable.damage
    if recording.remarks or damage:
        figures["recording"] = damage.what if damage else "; ".join(recording.remarks)
    return Replayed(figures, recorded if same else {}, damage)


class _Readable:
    """The messages of a recording up to its damage, if there is any."""

    def __init__(self, recording: Recording, from_bytes: bool, with_pictures: bool) -> None:
        self.damage: UserError | None = None
        self._recording = recording
        self._from_bytes = from_bytes
        self._with_pictures = with_pictures

    def messages(self) -> Iterator[Message]:
        """Yield them."""
        if self._from_bytes:
            yield from Redecoder(self._recording.header.config).of(self._sound())
        else:
            yield from self._sound()

    def _sound(self) -> Iterator[Message]:
        try:
            yield from self._recording.messages(self._with_pictures)
        except UserError as error:
            self.damage = error


def _replay(
    messages: Iterator[Message],
    robot: RobotConfig,
    sensors: str,
    watchers: Sequence[Watcher],
    used: Callable[[Measurement, Positions | Bearings], None],
    naming: Naming,
) -> dict[str, Any]:
    """Replay to the end; return the figures."""
    update_seconds: list[float] = []
    estimates: list[Estimate] = []
    monitored = MonitoredFilter(
        profiles.make(robot.filter.profile, robot), update_seconds, estimates
    )
    tally, truths, times = Tally(), list[Truth](), list[float]()
    begin = time.monotonic()
    localizer = Localizer(robot, monitored, used)
    for message, made in _steps(messages, localizer, sensors, naming):
        for watch in watchers:
            watch(message, made)
        if isinstance(message, Truth):
            truths.append(message)
        elif isinstance(message, Health):
            tally.take(message)
        for each in made:
            tally.take(each)
            if isinstance(each, Estimate):
                times.append(each.time)
    wall = time.monotonic() - begin
    seconds = times[-1] - times[0] if times else 0.0
    return {
        "seconds": round(seconds, 1),
        "times_real_time": round(seconds / wall, 1),
        **tally.figures(),
        **timing(update_seconds),
        **_scores(estimates, truths),
        "devices": tally.devices(),
    }


def _steps(
    messages: Iterator[Message], localizer: Localizer, sensors: str, naming: Naming
) -> Iterator[tuple[Message | None, Sequence[Result]]]:
    """Each message of the recording with what is made of it; last, None."""
    for message in messages:
        estimates = localizer.handle(message) if uses(message, sensors) else []
        # As in a run, where the recorded estimates are those that are made.
        passed_over = isinstance(message, Estimate) or fault(message) is not None
        followed = estimates if passed_over else [message, *estimates]
        names = [naming.take(each) for each in followed]
        yield message, [*estimates, *(each for each in names if each is not None)]
    yield None, localizer.finish()


def _scores(estimates: Sequence[Estimate], truths: list[Truth]) -> dict[str, Any]:
    if not truths:
        return {}
    scored = Accumulator()
    score_by_track(estimates, TruthTrack(sorted(truths, key=lambda truth: truth.time)), scored)
    row = scored.row("", "", "", "").as_json()
    return {name: rounded(row[name]) for name in _SCORED}
