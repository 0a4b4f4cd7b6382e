"""Driving by keys, with a dead-man switch: releasing the key stops the robot."""

import threading

from host.behaviour.interface import STILL, Command, Situation

# A terminal reports presses and repeats, but no releases, and repeats after up to half a second. So
# a first press drives slowly for that long, a held key at full speed.
FIRST_S, HELD_S = 0.6, 0.12
CREEP = 0.3  # share of the full speed
TURN_RATE_RADPS = 1.5
FASTEST_MPS = 0.3

# Shares of full speed and of the turn rate.
KEYS = {
    "w": (1.0, 0.0),
    "s": (-1.0, 0.0),
    "a": (0.0, 1.0),
    "d": (0.0, -1.0),
    "q": (1.0, 0.6),
    "e": (1.0, -0.6),
    "z": (-1.0, -0.6),
    "c": (-1.0, 0.6),
}
HELP = "hold w/s to drive forward/back, a/d to rotate, q/e/z/c for curves; x ends"


class Keys:
    """Any thread presses keys; the driving thread asks. `end` ends it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._key, self._until, self._held = "", 0.0, False
        self._ended = False

    def press(self, key: str, time: float) -> None:
        """A key came at `time` (s); one without a meaning stops the robot."""
        with self._lock:
            self._held = key == self._key and time < self._until
            self._key = key if key in KEYS else ""
            self._until = time + (HELD_S if self._held else FIRST_S)

    def end(self) -> None:
        """No more keys will come."""
        with self._lock:
            self._ended = True

    def command(self, now: Situation) -> Command | None:
        """The command of the key that is held now."""
        with self._lock:
            if self._ended:
                return None
            if not self._key or now.time >= self._until:
                return STILL
            share = 1.0 if self._held else CREEP
            speed, turn_rate = KEYS[self._key]
        return Command(share * speed * FASTEST_MPS, share * turn_rate * TURN_RATE_RADPS)
