"""A board that switched its motors off: which wheel, why, and when it may try again. Pure.

It does so where a wheel does not follow its motor for a set time (settings.runaway). It cannot know
the cause; the host knows what it asked for and what was counted, and names those that fit.
"""

from collections import deque

from host.drivers.romeo.protocol import DisplacementFrame, DisplacementStatus

WHEELS = ("left", "right")
_BITS = (DisplacementStatus.LEFT_RUNAWAY, DisplacementStatus.RIGHT_RUNAWAY)
FIRST_PAUSE_S, LONGEST_PAUSE_S = 2.0, 16.0
RECOVERED_TICKS = 100  # counted since: the wheel moves again
TREMBLE_TICKS = 4  # fewer are no movement
SHOWN_S = 1.0  # so long it stays a fault after the board was allowed to try again
Speeds = tuple[int, int]


class RunawayWatch:
    """Follows one board's runaway state through its displacement frames.

    After a pause that doubles each time, from FIRST_PAUSE_S to LONGEST_PAUSE_S, `retry` is due: a
    blocked wheel and a dip of the supply end by themselves, an encoder that is dead does not.
    """

    def __init__(self, window_s: float) -> None:
        """window_s: settings.runaway, s."""
        self._window_s = window_s
        self._history: deque[tuple[float, DisplacementFrame, Speeds]] = deque()
        self._reason = ""
        self._at: DisplacementFrame | None = None  # the last frame in the runaway state
        self._last_s = 0.0
        self._pause_s = FIRST_PAUSE_S
        self._retry_s = 0.0
        self.active = False
        self.count = 0  # how often the board switched off

    def connected(self) -> None:
        """A new connection: what the board reports at first is of before."""
        self._history.clear()
        self.active = False

    def take(self, frame: DisplacementFrame, asked: Speeds, now: float) -> None:
        """The board's next frame, and the speeds (left, right; ticks/s) it was sent before."""
        wheels = [wheel for wheel in (0, 1) if frame.status & _BITS[wheel]]
        if wheels and not self.active:
            self._switched_off(wheels, frame, now)
        self.active = bool(wheels)
        if self.active:
            self._at, self._last_s = frame, now
        elif self._at is not None and self._recovered(self._at, frame):
            self._at, self._reason, self._pause_s = None, "", FIRST_PAUSE_S
        self._history.append((now, frame, asked))
        while self._history[0][0] < now - self._window_s:
            self._history.popleft()

    def _switched_off(self, wheels: list[int], frame: DisplacementFrame, now: float) -> None:
        if not self._history:
            # From before this connection, and over with the first stop command.
            self._retry_s = now
            self._reason = f"{_named(wheels)} did not follow the motor before this connection"
            return
        self.count += 1
        self._retry_s, self._pause_s = now + self._pause_s, min(2 * self._pause_s, LONGEST_PAUSE_S)
        _, first, asked = self._history[0]
        backward = [wheel for wheel in wheels if _went(first, frame, wheel) * asked[wheel] < 0]
        self._reason = _backward(backward) if backward else _still(wheels)

    def _recovered(self, before: DisplacementFrame, frame: DisplacementFrame) -> bool:
        return all(
            abs(_ticks(before, frame, wheel)) >= RECOVERED_TICKS
            for wheel in (0, 1)
            if before.status & _BITS[wheel]
        )

    def retry(self, now: float) -> bool:
        """Is it time for the stop command that lets the board drive again?"""
        return self.active and now >= self._retry_s

    def stopped(self, now: float) -> None:
        """A stop command was sent: the board's answer takes a report or two."""
        self._retry_s = max(self._retry_s, now + SHOWN_S)

    def fault(self, now: float) -> str:
        """Why the motors are off, or "" where they are not."""
        if self._reason and (self.active or now < self._last_s + SHOWN_S):
            return f"{self._reason}; both motors are off until a stop command or a new try"
        return ""

    def remark(self, now: float) -> str:
        """What was found in the last drive, until the wheel moves again."""
        return f"when last driven: {self._reason}" if self._reason and not self.fault(now) else ""


def _still(wheels: list[int]) -> str:
    if len(wheels) == 2:
        causes = "the motor supply is off or dipped, the encoders have no 5 V, or it is blocked"
    else:
        causes = "the encoder's lead is off, the wheel is blocked, or its motor has no supply"
    return f"{_named(wheels)} was driven hard and its encoder hardly counted: {causes}"


def _backward(wheels: list[int]) -> str:
    side = WHEELS[wheels[0]]
    return (
        f"{_named(wheels)} was driven one way and its encoder counted the other: the encoder is "
        f"the wrong way round ({side}_encoder_reversed), or the motor is ({side}_reversed), or "
        "the wheel was pushed"
    )


def _named(wheels: list[int]) -> str:
    return "each wheel" if len(wheels) == 2 else f"the {WHEELS[wheels[0]]} wheel"


def _ticks(before: DisplacementFrame, after: DisplacementFrame, wheel: int) -> int:
    if wheel == 0:
        return difference(after.left_ticks, before.left_ticks)
    return difference(after.right_ticks, before.right_ticks)


def _went(before: DisplacementFrame, after: DisplacementFrame, wheel: int) -> int:
    """Which way: 1 forward, -1 backward, 0 next to nothing."""
    ticks = _ticks(before, after, wheel)
    return 0 if abs(ticks) < TREMBLE_TICKS else 1 if ticks > 0 else -1


def difference(now: int, before: int, bits: int = 32) -> int:
    """How far a counter of so many bits has gone, the shorter way round."""
    half = 1 << (bits - 1)
    return (now - before + half) % (1 << bits) - half
