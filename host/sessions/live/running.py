"""A run: a robot's devices, or simulated ones, through the localizer to any number of sinks."""

import contextlib
import gc
import math
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

from host.cross_checks.checks import CrossChecks
from host.drivers.link.device import LINK
from host.errors import UserError
from host.estimator import profiles
from host.evaluation.monitored import MonitoredFilter
from host.localizer import Localizer
from host.messages import Bearings, Measurement, Message, Now, Positions
from host.pipeline import Driver, Follower, Pipeline, Sink, Source
from host.recording.background import BackgroundRecorder
from host.recording.log import RecordingHeader
from host.sessions.figures import Delays, Tally, timing
from host.sources.recording import RECORDING, RecordingHealth
from host.sources.rig import Rig
from host.systems.id_phd.naming import Naming

# A thread that wakes waits so long for one that computes; Python's own 5 ms would add up.
_SWITCH_S = 0.0005
_TIMED_UPDATES = 100_000  # the last ones, of an hour or more: a run may go on for days


@dataclass(frozen=True, slots=True)
class RunOutcome:
    """figures: of the summary, by name; failures: by name, what ended a part before its time."""

    figures: dict[str, Any]
    failures: dict[str, Exception]


class Watcher(Protocol):
    """Who shows a run to people or programs. Both are called in the localizer's thread."""

    def take(self, message: Message) -> None:
        """Note a message, or what was found in a measurement."""

    def look(self, now: Now) -> None:
        """Show the present estimate; ten times per second."""


def never() -> bool:
    """A run that nothing stops."""
    return False


def nothing() -> None:
    """Default for `watch`: ignore it."""


def run_devices(
    rig: Rig,
    sinks: Mapping[str, Sink],
    watchers: Mapping[str, Watcher] | None = None,
    *,
    seconds: float | None = None,
    record: Path | None = None,
    stopped: Callable[[], bool] = never,
    watch: Callable[[], None] = nothing,
    watch_every_s: float = 0.2,
    driver: Driver | None = None,
) -> RunOutcome:
    """Run until `stopped()`, for `seconds` or until the localizer fails.

    sinks, watchers: by the name that Health calls them; each gets every message, in the
    localizer's thread. watch: called in this thread every `watch_every_s`, and at the end.
    driver: drives the robot meanwhile. Raises UserError where recording cannot begin.
    """
    update_seconds: deque[float] = deque(maxlen=_TIMED_UPDATES)
    filter_ = profiles.make(rig.config.filter.profile, rig.config)
    shown = _Shown(watchers or {}, None if rig.link is None else Naming())
    delays, tally = Delays(), Tally()

    def note(measurement: Measurement, readings: Positions | Bearings) -> None:
        delays.note(measurement)
        shown.take(readings)

    localizer = Localizer(rig.config, MonitoredFilter(filter_, update_seconds), note)
    with contextlib.ExitStack() as stack:
        kept, sources = _recording(stack, rig, record)
        stack.enter_context(_short_pauses())
        begin, begin_cpu = time.monotonic(), time.process_time()
        with Pipeline(
            localizer,
            {**rig.sources, **sources},
            {"summary": tally.take, **kept, **_linked(rig), **shown.sinks, **sinks},
            rig.truth,
            followers={"cross-checks": CrossChecks(rig.config), **shown.followers},
            watch=shown.look,
            driver=driver,
        ) as pipeline:
            _watch(pipeline, begin + (seconds or math.inf), stopped, watch, watch_every_s)
        wall, cpu = time.monotonic() - begin, time.process_time() - begin_cpu
        watch()
    board = {} if rig.simulated_board is None else {"simulated_board": rig.simulated_board}
    figures = {
        "seconds": round(wall, 1),
        **tally.figures(),
        "updates_per_s": round(tally.estimates / wall, 1),
        **timing(update_seconds),
        "latency_ms": delays.figures(),
        "cpu_share_of_one_core": round(cpu / wall, 2),
        "devices": tally.devices(),
        **board,
    }
    return RunOutcome(figures, pipeline.failures)


class _Shown:
    """All watchers as one; what is known now has names where the link brings them."""

    def __init__(self, watchers: Mapping[str, Watcher], naming: Naming | None) -> None:
        self._watchers, self._naming = watchers, naming
        self.sinks: dict[str, Sink] = {name: each.take for name, each in watchers.items()}
        self.followers: dict[str, Follower] = {} if naming is None else {"naming": naming}

    def take(self, readings: Positions | Bearings) -> None:
        """Show what was found in a measurement."""
        for watcher in self._watchers.values():
            watcher.take(readings)

    def look(self, now: Now) -> None:
        """Show the present estimate."""
        if self._naming is not None:
            now = replace(now, names=self._naming.at(now.estimate.time))
        for watcher in self._watchers.values():
            watcher.look(now)


def _linked(rig: Rig) -> dict[str, Sink]:
    """What sends this robot's odometry to the others."""
    return {} if rig.link is None else {LINK: rig.link.take}


def _recording(
    stack: contextlib.ExitStack, rig: Rig, path: Path | None
) -> tuple[dict[str, Sink], dict[str, Source]]:
    """What records the run until `stack` is left, and what reports how that does."""
    if path is None:
        return {}, {}
    recorder = stack.enter_context(_recorder(rig, path))
    return {RECORDING: recorder.write}, {RECORDING: RecordingHealth(recorder, path)}


def _recorder(rig: Rig, path: Path) -> BackgroundRecorder:
    """Records the run, and its pictures where that is asked. Raises UserError where it cannot."""
    if rig.record_pictures and not rig.cameras:
        raise UserError(
            "there are no pictures to record",
            "no camera is in use, or simulated ones give bearings alone",
            "name cameras in robot.toml; simulate pictures with arena4:rendered=1",
        )
    unix_s = time.time() - time.monotonic()
    header = RecordingHeader(rig.config, rig.sensors, rig.scenario, unix_s)
    recorder = BackgroundRecorder(path, header)
    if rig.record_pictures:
        for camera in rig.cameras:
            camera.watchers.append(recorder.picture)
    return recorder


@contextlib.contextmanager
def _short_pauses() -> Iterator[None]:
    """Quick switches of threads, and garbage collections that pass over what is there already.

    A full one, of all modules, stops everything for 50 ms on a desktop's core.
    """
    before = sys.getswitchinterval()
    sys.setswitchinterval(_SWITCH_S)
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
        sys.setswitchinterval(before)


def _watch(
    pipeline: Pipeline,
    end: float,
    stopped: Callable[[], bool],
    watch: Callable[[], None],
    every_s: float,
) -> None:
    """Wait for the end of a run, and call `watch` meanwhile."""
    while not (stopped() or pipeline.stop.is_set()):
        left = end - time.monotonic()
        if left <= 0.0:
            return
        watch()
        time.sleep(min(every_s, left))
