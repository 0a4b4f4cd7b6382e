"""A slow computer is told from a slow device."""

from host.drivers.health import HealthReporter
from host.drivers.pace import Pace
from host.messages import Health


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def step(pace: Pace, clock: Clock, seconds: float) -> None:
    with pace.within(0.05):
        clock.now += seconds


def test_steps_that_are_a_little_late_are_no_fault_however_many() -> None:
    clock = Clock()
    pace = Pace(clock)
    for _ in range(100):
        step(pace, clock, 0.19)
    assert pace.fault() is None


def test_what_stood_still_for_long_is_named_until_devices_can_be_judged_again() -> None:
    clock = Clock()
    pace = Pace(clock)
    step(pace, clock, 0.5)
    assert pace.fault() is None
    step(pace, clock, 0.4)
    assert "was paused for 0.8 s" in str(pace.fault())
    clock.now += 3.0
    assert pace.fault() is not None
    clock.now += 0.6
    assert pace.fault() is None


def test_a_device_is_silent_for_as_long_as_it_was_listened_to_in_vain() -> None:
    clock = Clock()
    pace = Pace(clock)
    for seconds in (0.05, 30.0, 0.05):
        step(pace, clock, seconds)
        clock.now += 5.0  # what is done between two steps is no listening
    assert abs(pace.silent_s - 0.15) < 1e-9
    pace.heard()
    step(pace, clock, 0.02)
    assert abs(pace.silent_s - 0.02) < 1e-9


def test_a_device_is_not_blamed_for_a_slow_computer_but_for_what_is_certain() -> None:
    clock = Clock()
    reporter = HealthReporter("lidar", clock)
    told: list[Health] = []
    step(reporter.pace, clock, 2.0)
    for ok, reason, certain in (
        (False, "the lidar stopped sending", False),
        (False, "unplugged", True),
        (True, "scanning", False),
    ):
        reporter.report(told.append, ok, reason, dict, certain)
    assert told[0].reason.startswith("this computer is too slow: ")
    assert [each.reason for each in told[1:]] == ["unplugged", "scanning"]
