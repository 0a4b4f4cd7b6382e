"""The pipeline: order, a bounded queue, and parts that fail without taking the rest along."""

import math
import threading
import time

import numpy as np
import pytest

from host import pipeline as pipeline_module
from host.config import RobotConfig
from host.cross_checks.checks import CrossChecks
from host.drivers import pace
from host.errors import UserError
from host.estimator.last_reading import LastReading
from host.localizer import Localizer
from host.message_queue import CAPACITY, MessageQueue
from host.messages import Bearings, Displacement, Estimate, Health, Now, Positions, Truth
from host.pipeline import Pipeline

LONG_S = 20.0  # a bound on waiting, not on speed


def a_health(device="lidar", time=0.0):
    return Health(time, device, True, "", {})


def a_step(time):
    return Displacement(time, 0.1, 0.0, 0.0, 0.0)


def a_reading(time):
    return Positions(time, np.array([[1.0, 0.0]]), np.eye(2)[None])


class Emits:
    """A device that emits its messages, then waits for the end."""

    def __init__(self, *messages):
        self.messages = messages
        self.stopped = False

    def run(self, emit, stop):
        for message in self.messages:
            emit(message)
        self.stopped = stop.wait(LONG_S)


class Fails:
    def __init__(self, error):
        self.error = error

    def run(self, emit, stop):
        raise self.error


class Inbox:
    """A sink that can be waited on."""

    def __init__(self):
        self.messages = []
        self._news = threading.Condition()

    def __call__(self, message):
        with self._news:
            self.messages.append(message)
            self._news.notify_all()

    def wait_for(self, is_wanted):
        def found():
            return [m for m in self.messages if is_wanted(m)]

        with self._news:
            assert self._news.wait_for(found, LONG_S), self.messages
            return found()[0]

    def of(self, *kinds):
        return [m for m in self.messages if isinstance(m, kinds)]


@pytest.fixture
def never_paused(monkeypatch):
    """What else is wrong is said on a computer that stood still, too."""
    monkeypatch.setattr(pace, "_MOST_S", math.inf)


def a_localizer():
    return Localizer(RobotConfig(), LastReading())


def test_a_full_queue_drops_the_oldest_and_counts_it():
    queue = MessageQueue(capacity=3)
    for k in range(5):
        queue.put(a_health(time=float(k)))
    assert queue.dropped == 2
    assert [queue.take(0.0).time for _ in range(3)] == [2.0, 3.0, 4.0]
    assert queue.take(0.0) is None


def test_a_full_queue_drops_readings_before_displacements():
    queue = MessageQueue(capacity=3)
    for message in (a_step(1.0), a_reading(1.5), a_step(2.0), a_step(3.0), a_reading(3.5)):
        queue.put(message)
    queue.put(a_step(4.0))
    assert queue.dropped == 3
    # The first reading went, the second had no room; then there was nothing else to drop.
    assert [queue.take(0.0).time for _ in range(3)] == [2.0, 3.0, 4.0]


def test_a_queue_knows_how_long_what_is_taken_was_in_it():
    now = [10.0]
    queue = MessageQueue(clock=lambda: now[0])
    queue.put(a_step(1.0))
    now[0] += 0.2
    queue.put(a_step(2.0))
    now[0] += 0.4
    queue.take(0.0)
    assert queue.waited_s == pytest.approx(0.6)
    queue.take(0.0)
    assert queue.waited_s == pytest.approx(0.4)


def test_a_closed_queue_gives_what_it_holds_and_takes_no_more():
    queue = MessageQueue()
    queue.put(a_step(1.0))
    queue.close()
    queue.put(a_step(2.0))
    assert not queue.exhausted
    assert queue.take(LONG_S).time == 1.0
    assert queue.take(LONG_S) is None
    assert queue.exhausted


def test_a_computer_that_stood_still_at_the_end_still_waits_for_its_devices(monkeypatch):
    """The first wait for each is over before it ran, as after a standstill; and the next is not."""
    monkeypatch.setattr(pipeline_module, "_STOP_S", LONG_S)
    waited = set()
    join = threading.Thread.join

    def stands_still(thread, timeout=None):
        if timeout is None or thread.name in waited:
            join(thread, timeout)
        waited.add(thread.name)

    class Slow(Emits):
        def run(self, emit, stop):
            super().run(emit, stop)
            time.sleep(0.1)

    monkeypatch.setattr(threading.Thread, "join", stands_still)
    with Pipeline(a_localizer(), {"lidar": Slow(), "board": Slow()}, {}) as pipeline:
        pass
    assert "lidar" in waited
    assert not pipeline.failures


def test_many_devices_that_stop_one_after_the_other_at_once_are_all_in_time(monkeypatch):
    """Each ends only while it is waited for: none has used up what the next may take."""
    waited_for = {f"device {k}": threading.Event() for k in range(20)}
    join = threading.Thread.join

    def let_go(thread, timeout=None):
        if thread.name in waited_for:
            waited_for[thread.name].set()
            timeout = LONG_S
        join(thread, timeout)

    class Stops:
        def __init__(self, event):
            self._event = event

        def run(self, emit, stop):
            self._event.wait(LONG_S)

    monkeypatch.setattr(threading.Thread, "join", let_go)
    sources = {name: Stops(event) for name, event in waited_for.items()}
    with Pipeline(a_localizer(), sources, {}) as pipeline:
        pass
    assert not pipeline.failures


def test_a_device_that_ignores_the_end_and_goes_on_does_not_hold_the_run(monkeypatch):
    monkeypatch.setattr(pipeline_module, "_STOP_S", 0.1)
    over = threading.Event()

    class Deaf:
        def run(self, emit, stop):
            while not over.wait(1e-4):
                emit(a_health())

    try:
        with Pipeline(a_localizer(), {"lidar": Deaf()}, {}) as pipeline:
            pass
    finally:
        over.set()
    assert "did not stop" in str(pipeline.failures["lidar"])


def test_a_queue_wakes_who_waits():
    queue = MessageQueue()
    threading.Timer(0.05, queue.put, [a_health()]).start()
    assert queue.take(LONG_S) == a_health()


def test_sinks_get_each_message_then_its_estimates_then_the_truth():
    fed = [a_step(0.1), a_reading(0.05), a_step(0.2), a_reading(0.3)]
    first, second = Inbox(), Inbox()
    source = Emits(*fed)

    def truth(time):
        return Truth(time, np.array([1]), np.array([[time, 0.0]]))

    sinks = {"one": first, "two": second}
    with Pipeline(a_localizer(), {"lidar": source}, sinks, truth) as pipeline:
        first.wait_for(lambda m: m is fed[-1])
    assert source.stopped
    kinds = [type(m) for m in first.messages if not isinstance(m, Health)]
    # The last reading waits for odometry that never comes: the end of the run releases it.
    assert kinds == 2 * [Displacement, Positions, Estimate, Truth]
    estimate, truth_after = first.of(Estimate)[0], first.of(Truth)[0]
    assert estimate.time == truth_after.time == 0.05
    assert [id(m) for m in second.messages] == [id(m) for m in first.messages]
    assert not pipeline.failures


def test_what_was_emitted_before_the_end_is_still_used():
    inbox = Inbox()
    source = Emits(*(a_step(0.1 * k) for k in range(1, 101)), a_reading(5.0))
    with Pipeline(a_localizer(), {"board": source}, {"inbox": inbox}):
        pass
    assert len(inbox.of(Displacement)) == 100
    assert len(inbox.of(Estimate)) == 1


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (ZeroDivisionError("boom"), "ended by a fault of swarmloc (ZeroDivisionError: boom)"),
        (UserError("no lidar", "no cable", "buy one"), "no lidar; no cable; buy one"),
    ],
)
def test_a_device_that_fails_is_told_and_the_rest_goes_on(error, words):
    inbox = Inbox()
    sources = {"lidar": Fails(error), "board": Emits(a_step(0.1), a_reading(0.1))}
    with Pipeline(a_localizer(), sources, {"inbox": inbox}) as pipeline:
        told = inbox.wait_for(lambda m: isinstance(m, Health) and m.device == "lidar")
        inbox.wait_for(lambda m: isinstance(m, Estimate))
        assert not pipeline.stop.is_set()
    assert (told.ok, told.reason) == (False, words)
    assert pipeline.failures == {"lidar": error}


def test_a_sink_that_fails_is_told_and_the_rest_goes_on():
    inbox = Inbox()

    def full(message):
        raise UserError("cannot write", "No space left on device")

    sinks = {"recording": full, "screen": inbox}
    source = Emits(a_step(0.1), a_reading(0.1))
    with Pipeline(a_localizer(), {"board": source}, sinks) as pipeline:
        told = inbox.wait_for(lambda m: isinstance(m, Health) and m.device == "recording")
        inbox.wait_for(lambda m: isinstance(m, Estimate))
    assert told.reason == "cannot write; No space left on device"
    assert list(pipeline.failures) == ["recording"]
    assert len(inbox.of(Health)) == 1


def test_a_localizer_that_fails_ends_the_run():
    class Broken(LastReading):
        def update(self, measurement):
            raise ZeroDivisionError

    source = Emits(a_step(0.1), a_reading(0.1))
    localizer = Localizer(RobotConfig(), Broken())
    with Pipeline(localizer, {"board": source}, {}) as pipeline:
        assert pipeline.stop.wait(LONG_S)
    assert source.stopped
    assert isinstance(pipeline.failures["localizer"], ZeroDivisionError)


def test_the_localizer_tells_how_it_does_and_what_was_dropped(never_paused):
    inbox = Inbox()
    blocked, go = threading.Event(), threading.Event()

    def slow(message):
        if isinstance(message, Displacement) and not blocked.is_set():
            blocked.set()
            assert go.wait(LONG_S)

    class Floods:
        def run(self, emit, stop):
            emit(a_step(0.1))
            assert blocked.wait(LONG_S)
            for k in range(CAPACITY + 44):  # more than the queue holds
                emit(a_health("camera", float(k)))
            emit(Bearings(0.1, np.zeros(1), np.ones(1)))
            go.set()
            stop.wait(LONG_S)

    with Pipeline(a_localizer(), {"camera": Floods()}, {"slow": slow, "inbox": inbox}):
        told = inbox.wait_for(lambda m: isinstance(m, Health) and m.device == "localizer")
    assert not told.ok
    assert told.reason.startswith("this computer is too slow: 45 messages dropped")
    assert told.counts["dropped"] == 45
    assert told.counts["messages"] == 1 + CAPACITY
    assert told.counts["estimates"] == 1


def test_after_a_standstill_the_localizer_tells_once_what_it_did_a_second():
    """A suspended computer or a stopped process does not make up for the reports it missed."""
    inbox, now, standstill = Inbox(), [0.0], 100.0

    class Wakes:
        def run(self, emit, stop):
            for k in range(10):
                emit(a_step(0.1 * (k + 1)))
                emit(a_reading(0.1 * (k + 1)))
            inbox.wait_for(lambda m: isinstance(m, Estimate) and m.time > 0.95)
            now[0] = standstill
            inbox.wait_for(lambda m: isinstance(m, Health))
            emit(a_step(1.1))
            emit(a_step(1.2))
            inbox.wait_for(lambda m: isinstance(m, Displacement) and m.time > 1.15)
            stop.wait(LONG_S)

    sources, sinks = {"board": Wakes()}, {"inbox": inbox}
    with Pipeline(a_localizer(), sources, sinks, clock=lambda: now[0]):
        inbox.wait_for(lambda m: isinstance(m, Displacement) and m.time > 1.15)
    (told,) = inbox.of(Health)
    assert told.reason.startswith("this computer is too slow: swarmloc was paused for 99.9 s")
    assert told.counts["estimates"] == 10


def test_malformed_messages_are_counted_reported_and_kept_from_the_sinks(never_paused):
    inbox = Inbox()
    bad = Positions(1.05, np.array([[np.nan, 0.0]]), np.eye(2)[None])
    device = Emits(a_step(1.0), a_reading(1.0), bad, a_step(1.2), a_reading(1.2))
    with Pipeline(a_localizer(), {"lidar": device}, {"inbox": inbox}):
        health = inbox.wait_for(lambda m: isinstance(m, Health) and m.device == "localizer")
    assert not health.ok
    assert health.counts["malformed"] == 1
    assert health.reason == (
        "malformed messages dropped: 1, the last of them Positions: positions holds nan, "
        "not within -1000 to 1000; check what sends it"
    )
    assert [m.time for m in inbox.of(Positions)] == [1.0, 1.2]
    assert len(inbox.of(Estimate)) == 2


def test_what_the_cross_checks_report_reaches_the_sinks():
    class Contradicts(CrossChecks):
        def take(self, message):
            return Health(message.time, "cross-check", False, "contradiction", {})

    inbox = Inbox()
    with Pipeline(
        a_localizer(),
        {"lidar": Emits(a_reading(1.0))},
        {"inbox": inbox},
        followers={"cross-checks": Contradicts(RobotConfig())},
    ):
        inbox.wait_for(lambda m: isinstance(m, Health) and m.reason == "contradiction")
    assert len([m for m in inbox.of(Health) if m.device == "cross-check"]) == 1


def test_what_is_known_now_grows_older_when_nothing_more_is_measured():
    looks, clock = Inbox(), [1.0]

    def truth(time):
        return Truth(time, np.array([1]), np.array([[time, 0.0]]))

    source = Emits(a_step(1.0), a_reading(1.0))
    with Pipeline(a_localizer(), {"board": source}, {}, truth, lambda: clock[0], watch=looks):
        first = looks.wait_for(lambda now: len(now.estimate.positions) == 1)
        clock[0] = 2.5
        later = looks.wait_for(lambda now: now.estimate.time == 2.5)
    assert (first.measured, later.measured) == (1.0, 1.0)
    assert later.truth.time == 2.5
    assert later.estimate.ages - first.estimate.ages == pytest.approx([2.5 - first.estimate.time])
    assert (later.estimate.covariances[0] >= first.estimate.covariances[0]).all()


def test_a_watcher_that_fails_is_told_and_the_rest_goes_on():
    inbox = Inbox()

    def broken(now: Now):
        raise OSError("the terminal is gone")

    source = Emits(a_step(0.1), a_reading(0.1))
    with Pipeline(a_localizer(), {"board": source}, {"inbox": inbox}, watch=broken) as pipeline:
        told = inbox.wait_for(lambda m: isinstance(m, Health) and m.device == "watcher")
        assert not pipeline.stop.is_set()
    assert "the terminal is gone" in told.reason
