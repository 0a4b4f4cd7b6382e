"""Controls of a camera that are set, read back, and held against what changes them."""

from typing import Protocol

from host.drivers.camera.v4l2_device import GONE, ControlRange

# Numbers of linux/v4l2-controls.h.
AUTO_EXPOSURE, EXPOSURE, DYNAMIC_RATE = 0x9A0901, 0x9A0902, 0x9A0903
AUTO_WHITE, WHITE = 0x98090C, 0x98091A
AUTO_GAIN, GAIN = 0x980912, 0x980913
AUTO_FOCUS, FOCUS = 0x9A090C, 0x9A090A
MAINS = 0x980918
MANUAL_EXPOSURE = 1  # V4L2_EXPOSURE_MANUAL
NAMES = {
    EXPOSURE: "exposure",
    WHITE: "white balance",
    GAIN: "gain",
    FOCUS: "focus",
    DYNAMIC_RATE: "dynamic frame rate",
    MAINS: "mains frequency",
}
_AUTOMATIC = {AUTO_EXPOSURE: EXPOSURE, AUTO_WHITE: WHITE, AUTO_GAIN: GAIN, AUTO_FOCUS: FOCUS}
NEEDED = (EXPOSURE, WHITE, GAIN)  # it is said where one is absent
# Brightness, contrast, saturation, hue, gamma, sharpness, backlight compensation; pan, tilt, zoom:
# at their defaults, whatever another program left there.
PLAIN = (
    0x980900, 0x980901, 0x980902, 0x980903, 0x980910, 0x98091B, 0x98091C,
    0x9A0908, 0x9A0909, 0x9A090D,
)  # fmt: skip

EXPOSURE_UNIT_S = 1e-4
TOLERANCE = 0.02  # of a value that reads back


class Adjustable(Protocol):
    """Controls by their numbers, as `VideoDevice` has them."""

    def range_of(self, control: int) -> ControlRange | None:
        """None where there is no such control."""

    def get(self, control: int) -> int:
        """Its value. Raises OSError."""

    def set(self, control: int, value: int) -> None:
        """Set it. Raises OSError."""


class HeldControls:
    """held: values by control; they outlive replugging, which resets the camera itself.

    remarks: by control or by a name, what is not as it should be.
    """

    def __init__(self) -> None:
        self.held: dict[int, int] = {}
        self.remarks: dict[int | str, str] = {}
        self._found: dict[int, int] = {}  # what the camera had before

    def check(self, camera: Adjustable) -> list[str]:
        """Read back all that is held, set again what drifted, which is returned in words.

        What an automatic chooses that cannot be switched off is left alone.
        """
        chosen = {value for automatic, value in _AUTOMATIC.items() if automatic in self.remarks}
        drifted = []
        for control, value in tuple(self.held.items()):
            if control in chosen:
                continue
            now = read(camera, control)
            if now is not None and not _near(now, value):
                self.hold(camera, control, value)
                what = f"{_name(control)} drifted from {said(control, value)}"
                drifted.append(f"{what} to {said(control, now)}: set again")
        return drifted

    def release(self, camera: Adjustable) -> None:
        """Leave all as it was found; what is refused now is tried the next time."""
        automatic_last = sorted(self._found, key=lambda control: control in _AUTOMATIC)
        for control in automatic_last:
            try:
                camera.set(control, self._found[control])
            except OSError:
                continue
            del self._found[control]

    def reset(self, camera: Adjustable, control: int) -> None:
        """Set it to its default, if the camera has it."""
        limits = camera.range_of(control)
        if limits is not None:
            self.hold(camera, control, limits.default)

    def hold(self, camera: Adjustable, control: int, value: float) -> None:
        """Set it, and see what it reads back. What differs is remarked upon."""
        limits = camera.range_of(control)
        if limits is None:
            return
        self.remarks.pop(control, None)
        wanted = min(max(round(value), limits.minimum), limits.maximum)
        reached = self.set(camera, control, wanted)
        if reached is None or (control in _AUTOMATIC and reached != wanted):
            kept, refused = "the camera keeps it automatic", "the camera refuses the setting"
            why = kept if control in _AUTOMATIC else refused
            self.remarks[control] = f"{_name(control)} not held: {why}"
            return
        self.held[control] = reached
        if not _near(reached, round(value)):
            self.remarks[control] = (
                f"{_name(control)} held at {said(control, reached)} "
                f"where {said(control, round(value))} was set"
            )

    def set(self, camera: Adjustable, control: int, value: int) -> int | None:
        """Set it; returns what it reads back, None where it is refused or absent."""
        found = read(camera, control)
        if found is not None:
            self._found.setdefault(control, found)
        try:
            camera.set(control, value)
        except OSError as error:
            if error.errno in GONE:
                raise
            return None
        return read(camera, control)


def read(camera: Adjustable, control: int) -> int | None:
    """Its value, None where it cannot be read just now. Raises OSError where the camera is gone."""
    try:
        return camera.get(control)
    except OSError as error:
        if error.errno in GONE:
            raise
        return None


def _near(value: int, other: int) -> bool:
    return abs(value - other) <= TOLERANCE * abs(other)


def _name(control: int) -> str:
    """Of an automatic: the name of what it chooses."""
    return NAMES.get(_AUTOMATIC.get(control, control), "a setting")


def said(control: int, value: int) -> str:
    return f"{value * EXPOSURE_UNIT_S * 1e3:g} ms" if control == EXPOSURE else str(value)
