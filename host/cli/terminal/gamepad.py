"""A gamepad, by the kernel's input events: the left stick drives while L1 or R1 is held.

The kernel tells of changes alone, so what is held is said again and again while the pad is there.
"""

import contextlib
import select
import threading
import time
from collections.abc import Iterator
from typing import Any

from host.behaviour.stick import Stick
from host.errors import UserError

HOLD = "hold L1 or R1 and move the left stick; Ctrl-C ends"
_EVERY_S = 0.03
_FLAT = 0.1  # of the stick's half way: the middle, where it comes to rest


def find(path: str | None) -> Any:
    """The gamepad at a path, None: the first one, as an `evdev.InputDevice`.

    Raises UserError where there is none.
    """
    try:
        import evdev
    except ImportError as error:
        raise UserError(
            "gamepads are read by evdev, which is not installed",
            str(error),
            "pip install 'swarmloc[gamepad]' (on ARM it needs gcc and linux-libc-dev), or apt-get "
            "install python3-evdev",
        ) from error
    try:
        paths = [path] if path else evdev.list_devices()
        devices = [evdev.InputDevice(each) for each in paths]
    except OSError as error:
        raise UserError(
            f"cannot read {path or 'the gamepads'}",
            error.strerror or str(error),
            "check that it is there and that this user is in the group input: ls -l /dev/input",
        ) from error
    for device in devices:
        if _is_gamepad(device.capabilities()):
            return device
    raise UserError(
        "there is no gamepad" if path is None else f"{path} is no gamepad",
        "no input device that this user may read has a stick and a shoulder button",
        "plug one in, join the group input (sudo usermod -aG input $USER, then log in again), or "
        "drive by keys: swarmloc drive",
    )


@contextlib.contextmanager
def gamepad_read(device: Any, stick: Stick) -> Iterator[None]:
    """Move the stick as the gamepad says, in a thread, while it lasts; unplugged, it ends it."""
    pad, stop = Gamepad(device), threading.Event()

    def read() -> None:
        try:
            while not stop.is_set():
                if select.select([device.fd], [], [], _EVERY_S)[0]:
                    pad.take(device.read())
                if pad.held:
                    stick.move(*pad.place, time.monotonic())
                else:
                    stick.release()
        except OSError:  # it was unplugged
            stick.end()

    thread = threading.Thread(target=read, name="gamepad", daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


class Gamepad:
    """How a gamepad is held, by its events."""

    def __init__(self, device: Any) -> None:
        from evdev import ecodes

        self._codes = ecodes
        self._axes = {code: device.absinfo(code) for code in (ecodes.ABS_X, ecodes.ABS_Y)}
        self._shares = dict.fromkeys(self._axes, 0.0)
        self._pressed: set[int] = set()

    @property
    def held(self) -> bool:
        """Is a dead man's button held?"""
        return bool(self._pressed)

    @property
    def place(self) -> tuple[float, float]:
        """Where the stick is: ahead and left, from -1 to 1."""
        return -self._shares[self._codes.ABS_Y], -self._shares[self._codes.ABS_X]

    def take(self, events: Any) -> None:
        """Note what changed."""
        codes = self._codes
        for event in events:
            if event.type == codes.EV_SYN and event.code == codes.SYN_DROPPED:
                self._pressed.clear()  # perhaps it was let go
            elif event.type == codes.EV_KEY and event.code in (codes.BTN_TL, codes.BTN_TR):
                (self._pressed.add if event.value else self._pressed.discard)(event.code)
            elif event.type == codes.EV_ABS and event.code in self._axes:
                self._shares[event.code] = _share(self._axes[event.code], event.value)


def _share(axis: Any, value: int) -> float:
    middle, half = 0.5 * (axis.max + axis.min), 0.5 * (axis.max - axis.min)
    share = (value - middle) / half if half > 0 else 0.0
    return 0.0 if abs(share) < max(_FLAT, axis.flat / half if half > 0 else 0.0) else share


def _is_gamepad(capabilities: Any) -> bool:
    from evdev import ecodes

    axes = {axis for axis, _ in capabilities.get(ecodes.EV_ABS, ())}
    buttons = capabilities.get(ecodes.EV_KEY, ())
    return {ecodes.ABS_X, ecodes.ABS_Y} <= axes and ecodes.BTN_TL in buttons
