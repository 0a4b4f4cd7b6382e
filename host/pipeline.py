"""Sources → localizer → sinks: a thread per device, one for the localizer, a bounded queue between.

A device or sink that fails is reported as Health, and the others continue. Every message that the
localizer consumed, in its order, and every estimate goes to every sink.
"""

import itertools
import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol, Self, TypeVar

from host.drivers.pace import Pace
from host.errors import UserError
from host.estimator.interface import Judge
from host.localizer import Localizer
from host.message_checks import fault
from host.message_queue import MessageQueue
from host.messages import (
    Bearings,
    DeviceBytes,
    Displacement,
    Estimate,
    Health,
    Message,
    Now,
    Positions,
    Scan,
    Truth,
)

_HEALTH_S = 1.0
_NOW_S = 0.1  # between two looks at what is known now
LOCALIZER = "localizer"
DRIVER = "driver"
NOISE = "noise settings"
GAINS = "odometry gains"
DETECTION = "lidar detection"
_POLL_S = 0.1
_BEHIND_S = 0.5  # a message that waited longer for the localizer makes estimates of the past
_STOP_S = 1.2  # for all devices together to stop their motors and close their ports
_DRAIN_S = 0.3  # for what is queued by then
_SLOW = "this computer is too slow"
_LESS = "close other programs, or use fewer sensors (--sensors lidar)"

Sink = Callable[[Message], None]
_Part = TypeVar("_Part")
_Made = TypeVar("_Made")


class Source(Protocol):
    """A device that delivers messages."""

    def run(self, emit: Callable[[Message], None], stop: threading.Event) -> None:
        """Emit messages until `stop` is set."""


class Driver(Source, Protocol):
    """Drives the robot (`host.behaviour.driving`): a source that also receives messages."""

    def take(self, message: Message, /) -> None:
        """Receive a device's message, in that device's thread."""

    def know(self, estimate: Estimate, /) -> None:
        """Receive the present estimate, ten times per second, in the localizer's thread."""


class Follower(Protocol):
    """Derives messages from those of the run (`CrossChecks`, `Naming`)."""

    def take(self, message: Message, /) -> Message | None:
        """Receive a message or estimate, in the localizer's thread; may return a new message."""


def unwatched(now: Now) -> None:
    """Default for `watch`: ignore it."""


class Pipeline:
    """Runs from entry to exit of its `with` block.

    sources, sinks, followers: by their name in Health; followers' messages go to the sinks. truth:
    true positions at a time (s), if known; sent to the sinks after every estimate. stop: set it to
    end the run; also set if the localizer fails. failures: by name, what ended a part early. watch:
    called with the present knowledge ten times per second, in the localizer's thread. driver:
    drives the robot meanwhile.
    """

    def __init__(
        self,
        localizer: Localizer,
        sources: Mapping[str, Source],
        sinks: Mapping[str, Sink],
        truth: Callable[[float], Truth] | None = None,
        clock: Callable[[], float] = time.monotonic,
        followers: Mapping[str, Follower] | None = None,
        watch: Callable[[Now], None] = unwatched,
        driver: Driver | None = None,
    ) -> None:
        self.stop = threading.Event()
        self.failures: dict[str, Exception] = {}
        self._localizer = localizer
        self._sinks = dict(sinks)
        self._truth = truth
        self._clock = clock
        self._followers = dict(followers or {})
        self._watch = watch
        self._driver = driver
        self._next_look = -math.inf
        self._queue = MessageQueue(clock=clock)
        self._sources = [
            threading.Thread(target=self._serve, args=(name, source), name=name, daemon=True)
            for name, source in {**sources, **({DRIVER: driver} if driver else {})}.items()
        ]
        self._thread = threading.Thread(target=self._localize, name=LOCALIZER, daemon=True)
        counts = ("messages", "estimates", "dropped", "late", "malformed", "busy_ms")
        self._counts = dict.fromkeys(counts, 0)
        self._pace = Pace(clock)
        self._end = math.inf  # of taking messages
        self._busy_s = 0.0
        self._reported = dict(self._counts)
        self._last_health = 0.0

    def __enter__(self) -> Self:
        self._last_health = self._clock()
        self._thread.start()
        for thread in self._sources:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop.set()
        # Counted, not timed: a computer that stands still meanwhile makes no device hang.
        waits = round(_STOP_S / _POLL_S)
        for thread in self._sources:
            while thread.is_alive() and waits > 0:
                thread.join(_POLL_S)
                waits -= thread.is_alive()  # one that ended took less than a wait
            if thread.is_alive():
                self.failures[thread.name] = UserError(
                    f"the {thread.name} did not stop within {_STOP_S:.1f} s",
                    "the device or its driver in the kernel hangs",
                    "unplug it and plug it in again",
                )
        # A device that ignores `stop` must not keep the localizer running.
        self._queue.close()
        self._end = self._clock() + _DRAIN_S
        self._thread.join()

    def _serve(self, name: str, source: Source) -> None:
        try:
            source.run(self._take, self.stop)
        except Exception as error:
            # Whatever it is, the other devices and the localizer continue.
            self._report_failure(name, error, self._queue.put)

    def _take(self, message: Message) -> None:
        """Queue a device's message; the driver gets it at once, even if the localizer is busy."""
        if self._driver is not None and fault(message) is None:
            self._driver.take(message)
        self._queue.put(message)

    def _report_failure(self, name: str, error: Exception, report: Sink) -> None:
        self.failures[name] = error
        if isinstance(error, UserError):
            reason = "; ".join(str(error).splitlines())
        else:
            reason = f"ended by a fault of swarmloc ({type(error).__name__}: {error})"
        report(Health(self._clock(), name, False, reason, {}))

    def _localize(self) -> None:
        try:
            while not (self._queue.exhausted or self._clock() > self._end):
                with self._pace.within(_POLL_S):
                    self._step()
                self._report()
            self._publish(self._localizer.finish())
        except Exception as error:
            # Raised again by whoever reads `failures`, in a thread that can report it to the user.
            self.failures[LOCALIZER] = error
            self.stop.set()

    def _step(self) -> None:
        message = self._queue.take(_POLL_S)
        if message is not None:
            self._handle(message)
        self._look()

    def _handle(self, message: Message) -> None:
        self._counts["messages"] += not isinstance(message, DeviceBytes)
        # Malformed messages are counted by the localizer, and neither recorded nor compared.
        sound = fault(message) is None
        if sound:
            self._deliver(message)
        estimates: list[Estimate] = []
        if isinstance(message, Scan | Positions | Bearings | Displacement):
            start = time.perf_counter()
            estimates = self._localizer.handle(message)
            self._busy_s += time.perf_counter() - start
            self._publish(estimates)
        # After the estimate: followers sometimes take milliseconds.
        if sound:
            self._follow([message, *estimates])

    def _publish(self, estimates: Sequence[Estimate]) -> None:
        self._counts["estimates"] += len(estimates)
        for estimate in estimates:
            self._deliver(estimate)
            if self._truth is not None:
                self._deliver(self._truth(estimate.time))

    def _deliver(self, message: Message) -> None:
        self._each(self._sinks, lambda sink: sink(message))

    def _follow(self, messages: Sequence[Message]) -> None:
        made = self._each(self._followers, lambda each: [each.take(m) for m in messages])
        for message in itertools.chain.from_iterable(made):
            if message is not None:
                self._deliver(message)

    def _each(self, parts: dict[str, _Part], use: Callable[[_Part], _Made]) -> list[_Made]:
        """What `use` makes of each part. One that fails is left out from then on: a full disk ends
        the recording, not the run."""
        made = []
        for name, part in list(parts.items()):
            try:
                made.append(use(part))
            except Exception as error:
                del parts[name]
                self._report_failure(name, error, self._deliver)
        return made

    def _look(self) -> None:
        """Call the watcher and the driver with the present estimate, when it is due."""
        now = self._clock()
        unwatched_now = self._watch is unwatched and self._driver is None
        if unwatched_now or now < self._next_look:
            return
        estimate = self._localizer.ahead(now)
        if estimate is None:
            return
        self._next_look = now + _NOW_S
        if self._driver is not None:
            self._driver.know(estimate)
        truth = None if self._truth is None else self._truth(now)
        try:
            self._watch(Now(estimate, self._localizer.measured, truth))
        except Exception as error:
            # As with a sink: a failed watcher does not end the run.
            self._watch = unwatched
            self._report_failure("watcher", error, self._deliver)

    def _report(self) -> None:
        """Report the localizer's own health, once per second or as soon as it can."""
        now = self._clock()
        seconds = now - self._last_health
        if seconds < _HEALTH_S:
            return
        self._last_health = now
        self._counts["dropped"] = self._queue.dropped
        self._counts["late"] = self._localizer.dropped
        self._counts["malformed"] = self._localizer.malformed
        self._counts["busy_ms"] = round(1000.0 * self._busy_s)
        change = {name: count - self._reported[name] for name, count in self._counts.items()}
        self._reported = dict(self._counts)
        updates, each_ms = change["estimates"], change["busy_ms"] / max(1, change["estimates"])
        usual = f"{updates / seconds:.0f} updates/s, {each_ms:.1f} ms each"
        wrong = self._wrong(change["dropped"], change["malformed"])
        self._deliver(Health(now, LOCALIZER, not wrong, wrong or usual, dict(self._counts)))
        judges: dict[str, Judge] = {
            NOISE: self._localizer.consistency,
            GAINS: self._localizer.odometry,
        }
        if self._localizer.learnt is not None:
            judges[DETECTION] = self._localizer.learnt
        for name, judge in judges.items():
            if judge.known:
                found = judge.fault()
                self._deliver(Health(now, name, found is None, found or judge.summary(), {}))

    def _wrong(self, dropped: int, malformed: int) -> str:
        """What keeps the localizer from its work, "" for nothing; both counts are new ones."""
        slow, behind_s = self._pace.fault(), self._queue.waited_s
        if dropped:
            return f"{_SLOW}: {dropped} messages dropped; {_LESS}"
        if slow is not None:
            return str(slow)
        if behind_s > _BEHIND_S:
            return f"{_SLOW}: estimates are {behind_s:.1f} s late; {_LESS}"
        if malformed:
            return (
                f"malformed messages dropped: {malformed}, the last of them "
                f"{self._localizer.fault}; check what sends it"
            )
        return ""
