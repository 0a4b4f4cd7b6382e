"""A replay that waits, pauses, steps and jumps as it was asked to."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.viewer.playback import Playback, SeekBackError
from tests.viewer import scenes


class Clock:
    def __init__(self) -> None:
        self.now = 50.0

    def __call__(self) -> float:
        return self.now


class Replay:
    """Messages every 0.1 s from 10 to 20 s; while it waits the clock runs on."""

    def __init__(self, speed: float = 1.0) -> None:
        self.clock = Clock()
        self.playback = Playback(10.0, 20.0, speed, self.clock)
        self.playback._news.wait = self._wait  # type: ignore[method-assign, assignment]
        self.shown = 0

    def _wait(self, timeout: float | None = None) -> bool:
        assert timeout is not None
        self.clock.now += timeout
        return True

    def _show(self) -> None:
        self.shown += 1
        if self.shown > 1000:
            raise TimeoutError

    def to(self, moment: float) -> float:
        """Go on to it; return how long that took, s."""
        begin = self.clock.now
        now = self.playback.position.now
        for k in range(1, round(10.0 * (moment - now)) + 1):
            self.playback.reach(now + 0.1 * k, self._show)
        return self.clock.now - begin


@given(st.floats(0.1, 100.0))
def test_it_takes_as_long_as_it_took_by_its_speed(speed: float) -> None:
    assert Replay(speed).to(15.0) == pytest.approx(5.0 / speed, abs=1e-6)


def test_another_speed_holds_from_now_on() -> None:
    replay = Replay()
    replay.to(12.0)
    replay.playback.command("speed", 4)
    assert replay.to(16.0) == pytest.approx(1.0)
    assert replay.playback.position.speed == 4.0


def test_paused_it_stays_and_a_pause_is_not_made_up_for() -> None:
    replay = Replay()
    replay.to(12.0)
    replay.playback.command("pause")
    with pytest.raises(TimeoutError):
        replay.to(12.1)
    assert replay.playback.position.now == pytest.approx(12.0)
    replay.shown = 0
    replay.playback.command("play")
    assert replay.to(13.0) == pytest.approx(1.0)


def test_a_step_goes_to_the_next_estimate() -> None:
    replay = Replay()
    replay.playback.command("step")
    assert replay.to(10.3) == 0.0
    replay.playback.estimated()
    with pytest.raises(TimeoutError):
        replay.to(10.4)
    assert not replay.playback.position.playing


def test_it_jumps_ahead_at_once_also_while_paused() -> None:
    replay = Replay()
    replay.playback.command("pause")
    replay.playback.command("seek", 17.0)
    assert replay.to(17.0) == 0.0
    with pytest.raises(TimeoutError):
        replay.to(17.1)
    replay.shown = 0
    replay.playback.command("play")
    assert replay.to(18.0) == pytest.approx(1.0)


def test_back_it_begins_anew_and_goes_there_at_once() -> None:
    replay = Replay()
    replay.to(15.0)
    replay.playback.command("seek", 12.04)  # between two messages
    with pytest.raises(SeekBackError):
        replay.to(15.1)
    replay.playback.restart()
    assert replay.to(12.0) == 0.0
    assert replay.to(13.0) == pytest.approx(1.0, abs=0.11)


def test_at_the_end_it_rests_until_it_is_played_again() -> None:
    replay = Replay()
    replay.to(20.0)
    with pytest.raises(TimeoutError):
        replay.playback.rest(replay._show)
    replay.shown = 0
    replay.playback.command("play")
    replay.playback._playing = True

    def play() -> None:
        replay.playback.command("play")

    with pytest.raises(SeekBackError):
        replay.playback.rest(play)
    replay.playback.restart()
    assert replay.to(11.0) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("do", "to"),
    [("dance", None), ("speed", 0), ("speed", 1e9), ("speed", "2"), ("speed", None), ("seek", True),
     ("seek", float("nan")), ("seek", [1.0]), (None, None), (["play"], None)],
)  # fmt: skip
def test_what_it_cannot_do_is_refused_and_changes_nothing(do: str, to: object) -> None:
    playback = Playback(10.0, 20.0)
    before = playback.position
    with pytest.raises(ValueError, match="cannot do"):
        playback.command(do, to)
    assert playback.position == before


def test_it_spans_the_odometry_of_a_recording() -> None:
    playback = Playback.of([scenes.a_step(3.0), scenes.health(), scenes.a_step(7.0)])
    assert (playback.position.begin, playback.position.end) == (3.0, 7.0)
    assert Playback.of([]).position.end == 0.0
