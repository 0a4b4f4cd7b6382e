"""Truth from a file of another system: the bodies that it saw, in place of a recording's own."""

import contextlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from host.calibration.truth.alignment import align_clocks
from host.calibration.truth.clock import ClockAlignment
from host.calibration.truth.files import body_of, read_truth
from host.calibration.truth.rates import path_by_wheels
from host.config import Mocap
from host.errors import UserError
from host.messages import Bodies, Displacement, Message, Truth
from host.recording.elsewhere.named_columns import BodyPath, Units


@dataclass(frozen=True, slots=True)
class TruthFile:
    """A file of true paths, which body in it is the robot's ("": the only one), and its units.

    report: gets how it was aligned in time, as text.
    """

    path: Path
    body: str = ""
    units: Units = field(default_factory=Units)
    report: Callable[[str], None] = lambda words: None

    def read(self) -> tuple[BodyPath, list[BodyPath]]:
        """The robot's path and those of all other bodies. Raises UserError."""
        paths = read_truth(self.path, self.units)
        own = body_of(paths, self.body, str(self.path))
        return own, [path for path in paths if path is not own]


def truth_file(text: str, units: Units, report: Callable[[str], None]) -> TruthFile:
    """FILE or FILE:BODY as written on the command line. Raises UserError where there is no file."""
    whole = Path(text)
    file, _, body = text.rpartition(":")
    if whole.exists() or not file:
        file, body = text, ""
    if not Path(file).exists():
        raise UserError(f"there is no file {file}", "--truth names it", "write --truth FILE:BODY")
    return TruthFile(Path(file), body, units, report)


def truth_of_scenario(source: str) -> UserError:
    """The error of a file of truth beside a scenario, which has its own."""
    return UserError(
        f"{source} needs no --truth", "a scenario knows where its robots are", "leave --truth out"
    )


def with_truth(
    messages: Iterable[Message], truth: TruthFile, mocap: Mocap
) -> tuple[list[Message], ClockAlignment]:
    """The messages in order of time, with the file's bodies in place of any truth that they held.

    The robot's body gets the number in `mocap`, the others the numbers after. Raises UserError
    where the file cannot be read or does not fit the robot's wheels.
    """
    kept = [m for m in messages if not isinstance(m, Bodies | Truth)]
    own, others = truth.read()
    steps = [message for message in kept if isinstance(message, Displacement)]
    found = _aligned(own, others, path_by_wheels(steps, mocap))
    truth.report(f"{truth.path}: {found.words()}")
    frames = list(_frames([own, *others], mocap.body, found))
    return sorted([*kept, *frames], key=lambda message: message.time), found


def _aligned(own: BodyPath, others: list[BodyPath], by_wheels: BodyPath) -> ClockAlignment:
    """The alignment of the robot's path; where another body's fits instead, the error names it."""
    try:
        return align_clocks(own, by_wheels)
    except UserError as error:
        for other in others:
            if _fits(other, by_wheels):
                raise UserError(
                    error.what, error.why, f"body {other.name} moves as these wheels do: name it"
                ) from error
        raise


def _fits(path: BodyPath, by_wheels: BodyPath) -> bool:
    with contextlib.suppress(UserError):
        align_clocks(path, by_wheels)
        return True
    return False


def _frames(paths: list[BodyPath], first: int, clock: ClockAlignment) -> Iterator[Bodies]:
    """What was seen at each time, on the robot's clock."""
    numbers = np.concatenate([np.full(len(p.times), first + k) for k, p in enumerate(paths)])
    poses = np.concatenate([path.poses for path in paths])
    times, frame = np.unique(np.concatenate([p.times for p in paths]), return_inverse=True)
    order = np.argsort(frame, kind="stable")
    ends = np.searchsorted(frame[order], np.arange(1, len(times)))
    for time, rows in zip(clock.host_times(times).tolist(), np.split(order, ends), strict=True):
        yield Bodies(time, numbers[rows].astype(np.int64), poses[rows])
