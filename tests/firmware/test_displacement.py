"""When the firmware reports, and what: on the beat, over the roll-over of its clock."""

import ctypes
from collections.abc import Iterator

import pytest

from host.drivers.romeo.protocol import DisplacementFrame


class Reports:
    def __init__(self, parts: ctypes.CDLL) -> None:
        self._parts = parts
        self._handle = ctypes.c_void_p(parts.reports_new())

    def close(self) -> None:
        self._parts.reports_delete(self._handle)

    def due(self, now_us: int, rate_hz: int) -> bool:
        return self._parts.reports_due(self._handle, ctypes.c_uint32(now_us), rate_hz)

    def make(self, time_us: int, left: int, right: int) -> DisplacementFrame:
        content = ctypes.create_string_buffer(DisplacementFrame.LAYOUT.size)
        self._parts.reports_make(self._handle, ctypes.c_uint32(time_us), left, right, content)
        number, *values = DisplacementFrame.LAYOUT.unpack(content.raw)
        assert number == DisplacementFrame.ID
        return DisplacementFrame(*values)


@pytest.fixture
def reports(pure_parts: ctypes.CDLL) -> Iterator[Reports]:
    reports = Reports(pure_parts)
    yield reports
    reports.close()


@pytest.mark.parametrize("rate_hz", [10, 50, 75, 100])
@pytest.mark.parametrize("start", [0, 2**32 - 3_000_000])
def test_the_beat_is_kept_over_the_roll_over(reports: Reports, rate_hz: int, start: int) -> None:
    reports.due(start % 2**32, rate_hz)
    # The loop comes round every 130 us, never just in time.
    told = [t for t in range(130, 10_000_000, 130) if reports.due((start + t) % 2**32, rate_hz)]
    assert len(told) == pytest.approx(10 * rate_hz, abs=1.5)
    period = 1_000_000 // rate_hz
    assert all(0 <= t - (k + 1) * period < 260 for k, t in enumerate(told[: len(told) // 2]))


def test_a_long_delay_is_not_made_up_for(reports: Reports) -> None:
    assert reports.due(1_000_000, 50)
    told = [t for t in range(1_500_000, 1_600_000, 100) if reports.due(t, 50)]
    assert told == [1_500_000 + 20_000 * k for k in range(5)]


def test_frames_are_numbered_modulo_two_to_the_sixteenth(reports: Reports) -> None:
    frames = [reports.make(5, -7, 2**31 - 1) for _ in range(2**16 + 2)]
    assert [frame.sequence for frame in frames[-3:]] == [65535, 0, 1]
    first = frames[0]
    assert (first.board_time_us, first.left_ticks, first.right_ticks) == (5, -7, 2**31 - 1)
    assert (first.status, first.dropped_frames, first.bad_frames) == (0, 0, 0)
