"""A board's clock in host time: bounds under jitter, drift, stalls, roll-over and reset."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.drivers.clock import ClockSync

PERIOD_S = 0.02
MINUTES_71 = (1 << 32) * 1e-6


class Device:
    """A board that sends its counter every PERIOD_S: what is true, and what arrives when."""

    def __init__(self, seed: int, drift: float = 0.0, first: int = 0, jitter_s: float = 0.002):
        self.rng = random.Random(seed)
        self.drift, self.first, self.jitter_s = drift, first, jitter_s
        self.boot = 1000.0
        self.last_arrival = 0.0

    def counter(self, sent: float) -> int:
        return (self.first + round((sent - self.boot) * (1 + self.drift) * 1e6)) % (1 << 32)

    def arrival(self, sent: float) -> float:
        """Some 0.3 ms at least, usually a few ms later, never before the frame ahead of it."""
        late = sent + 3e-4 + self.rng.expovariate(1 / self.jitter_s)
        self.last_arrival = max(late, self.last_arrival)
        return self.last_arrival


def errors(device: Device, sync: ClockSync, start: float, seconds: float) -> list[float]:
    """Told minus true host time of each frame, s."""
    found = []
    for k in range(int(seconds / PERIOD_S)):
        sent = start + k * PERIOD_S
        arrival = device.arrival(sent)
        told = sync.update(device.counter(sent), arrival)
        assert told <= arrival
        found.append(told - sent)
    return found


@settings(derandomize=True, deadline=None, max_examples=25)
@given(
    st.integers(0, 2**16),
    st.floats(-0.005, 0.005),
    st.sampled_from([0, 2**32 - 12_000_000, 123_456]),
)
def test_settled_error_stays_below_a_fraction_of_the_jitter(
    seed: int, drift: float, first: int
) -> None:
    device, sync = Device(seed, drift, first), ClockSync()
    found = errors(device, sync, 1000.0, 40.0)
    settled = found[int(5.0 / PERIOD_S) :]
    # The least latency, 0.3 ms, cannot be seen; beyond it, half a millisecond at 2 ms of jitter.
    assert max(settled) < 3e-4 + 5e-4
    assert min(settled) > -5e-4
    # From the start it is no worse than the first frame's own lateness and the unknown drift.
    assert max(abs(e) for e in found) < 0.02
    assert sync.restarts == 0


def test_an_ideal_line_is_told_exactly() -> None:
    sync = ClockSync()
    for k in range(2000):
        sent = 5.0 + k * PERIOD_S
        told = sync.update(round(k * PERIOD_S * 1.004 * 1e6), sent)
        assert told == pytest.approx(sent, abs=2e-4)
    assert sync.late == 0


def test_ordinary_jitter_of_tens_of_milliseconds_is_not_late() -> None:
    sync, rng = ClockSync(), random.Random(4)
    for k in range(2000):
        sync.update(round(k * PERIOD_S * 1e6), 5.0 + k * PERIOD_S + rng.uniform(0.0, 0.04))
    assert sync.late == 0


@pytest.mark.parametrize("seed", range(3))
def test_a_host_stall_moves_nothing_and_is_counted(seed: int) -> None:
    """For 3 s the host reads nothing, then all at once; the kernel had kept it."""
    print(f"seed {seed}")
    device, sync = Device(seed, drift=0.003), ClockSync()
    errors(device, sync, 1000.0, 15.0)
    late_before = sync.late
    stalled = []
    for k in range(150):
        sent = 1015.0 + k * PERIOD_S
        stalled.append(sync.update(device.counter(sent), 1018.001) - sent)
    device.last_arrival = 1018.001
    assert max(abs(e) for e in stalled) < 2e-3
    assert sync.late - late_before > 140
    after = errors(device, sync, 1018.0, 10.0)
    assert max(abs(e) for e in after) < 1e-3
    assert sync.restarts == 0


def test_a_stall_longer_than_the_window_is_survived() -> None:
    device, sync = Device(3, drift=-0.004), ClockSync()
    errors(device, sync, 1000.0, 10.0)
    for k in range(1500):
        sync.update(device.counter(1010.0 + k * PERIOD_S), 1040.0)
    device.last_arrival = 1040.0
    after = errors(device, sync, 1040.0, 30.0)
    assert max(abs(e) for e in after[int(10 / PERIOD_S) :]) < 1e-3
    assert sync.restarts == 0


def test_roll_over_passes_without_a_jump() -> None:
    first = 2**32 - 10_000_000
    with_wrap, without = Device(1, 0.002, first), Device(1, 0.002)
    told = errors(with_wrap, sync := ClockSync(), 1000.0, 20.0)
    plain = errors(without, ClockSync(), 1000.0, 20.0)
    assert with_wrap.counter(1019.9) < first
    assert told == pytest.approx(plain, abs=1e-9)
    assert sync.restarts == 0


def test_silence_of_several_roll_overs_is_bridged() -> None:
    device, sync = Device(2), ClockSync()
    errors(device, sync, 1000.0, 30.0)
    after = errors(device, sync, 1000.0 + 2.5 * MINUTES_71, 5.0)
    assert sync.restarts == 0
    assert max(abs(e) for e in after[int(3 / PERIOD_S) :]) < 5e-3


@settings(derandomize=True, deadline=None, max_examples=25)
@given(st.integers(0, 2**16), st.floats(10.0, 4000.0), st.floats(0.0, 20.0))
def test_a_reset_starts_anew_and_is_counted_once(seed: int, age: float, away: float) -> None:
    """Wherever the counter stood, unless it was within seconds of its roll-over anyway."""
    device, sync = Device(seed, first=round(age * 1e6)), ClockSync()
    errors(device, sync, 1000.0, 10.0)
    device.boot, device.first = 1010.0 + away, 0
    after = errors(device, sync, device.boot, 10.0)
    assert sync.restarts == 1
    assert max(abs(e) for e in after[int(5 / PERIOD_S) :]) < 1e-3


@pytest.mark.parametrize(("seed", "seconds"), [(0, 3.0), (1, 25.0), (2, 600.0)])
def test_a_counter_that_stood_still_starts_anew_within_two_seconds(
    seed: int, seconds: float
) -> None:
    """As that of a device which was suspended while the host's clock ran on."""
    print(f"seed {seed}")
    device, sync = Device(seed, drift=0.002), ClockSync()
    errors(device, sync, 1000.0, 15.0)
    device.boot += seconds
    after = errors(device, sync, 1015.0 + seconds, 12.0)
    assert sync.restarts == 1
    assert max(abs(e) for e in after[int(5.0 / PERIOD_S) :]) < 1e-3
    assert max(abs(e) for e in after[int(2.0 / PERIOD_S) :]) < PERIOD_S


def test_the_same_pairs_give_the_same_times() -> None:
    runs = [errors(Device(9, 0.001), ClockSync(), 1000.0, 10.0) for _ in range(2)]
    assert runs[0] == runs[1]
