"""Driving by a stick, of the live page or of a gamepad: who lets go, or is not heard, stops it."""

import math
import threading

from host.behaviour.interface import STILL, Command, Situation

# Slow enough that the robot stands 0.3 s after the last that was heard: SILENT_S, and Safety's
# reaction and braking.
FASTEST_MPS, FASTEST_RADPS = 0.2, 1.5
SILENT_S = 0.1


class Stick:
    """Any thread moves it; the driving thread asks. `end` ends the drive."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._place, self._until = (0.0, 0.0), -math.inf
        self._ended = False

    def move(self, ahead: float, left: float, time: float) -> None:
        """Where it is held at `time` (s): shares from -1 to 1. To be called again and again."""
        with self._lock:
            self._place, self._until = (_share(ahead), _share(left)), time + SILENT_S

    def release(self) -> None:
        """Nobody holds it."""
        with self._lock:
            self._until = -math.inf

    def end(self) -> None:
        """Nobody will hold it again."""
        with self._lock:
            self._ended = True

    def command(self, now: Situation) -> Command | None:
        """As it is held."""
        with self._lock:
            if self._ended:
                return None
            if now.time >= self._until:
                return STILL
            ahead, left = self._place
        return Command(ahead * FASTEST_MPS, left * FASTEST_RADPS)


def _share(value: float) -> float:
    return min(max(value, -1.0), 1.0) if math.isfinite(value) else 0.0
