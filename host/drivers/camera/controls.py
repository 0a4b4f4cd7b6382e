"""Exposure, white balance and gain of a camera: held still, so that a colour stays a colour."""

from dataclasses import dataclass
from typing import Protocol

import cv2

MANUAL_EXPOSURE = 1  # V4L2_EXPOSURE_MANUAL
_TOLERANCE = 0.02


class Adjustable(Protocol):
    """Controls by OpenCV's numbers; a control that a camera does not have reads -1."""

    def get(self, control: int) -> float:
        """Its present value."""

    def set(self, control: int, value: float) -> bool:
        """Set it; False where the camera refuses."""


@dataclass(frozen=True, slots=True)
class _Control:
    name: str
    value: int
    automatic: int | None  # the control that lets the camera choose the value
    manual: int = 0  # its setting at which the camera does not


_CONTROLS = (
    _Control("exposure", cv2.CAP_PROP_EXPOSURE, cv2.CAP_PROP_AUTO_EXPOSURE, MANUAL_EXPOSURE),
    _Control("white balance", cv2.CAP_PROP_WB_TEMPERATURE, cv2.CAP_PROP_AUTO_WB),
    _Control("gain", cv2.CAP_PROP_GAIN, None),
)


class Controls:
    """Holds the values at which a camera's automatics stood when it was locked first.

    They are kept over replugging, which sets the camera itself back to automatic.
    """

    def __init__(self) -> None:
        self._held: dict[int, float] = {}
        self._before: dict[int, float] = {}

    @property
    def known(self) -> bool:
        """Were values found already?"""
        return bool(self._held)

    def lock(self, camera: Adjustable) -> list[str]:
        """Switch the automatics off, set the values, read them back.

        Returns what is not held, and why.
        """
        remarks = (self._hold(camera, control) for control in _CONTROLS)
        return [remark for remark in remarks if remark]

    def _hold(self, camera: Adjustable, control: _Control) -> str:
        found = camera.get(control.value)
        if found < 0.0:
            return f"{control.name} not held: the camera has no such control"
        setting = self._held.setdefault(control.value, found)
        if control.automatic is not None:
            before = camera.get(control.automatic)
            if before not in (-1.0, control.manual):
                self._before.setdefault(control.automatic, before)
                camera.set(control.automatic, control.manual)
                if camera.get(control.automatic) != control.manual:
                    return f"{control.name} not held: the camera keeps it automatic"
        accepted = camera.set(control.value, setting)
        reached = camera.get(control.value)
        if abs(reached - setting) > max(1.0, _TOLERANCE * abs(setting)):
            return f"{control.name} held at {reached:g} where {setting:g} was set"
        return "" if accepted else f"{control.name} not held: the camera refuses the setting"

    def release(self, camera: Adjustable) -> None:
        """Leave the automatics as they were found; what is refused now is tried the next time.

        A camera that hung and was opened anew has them off already.
        """
        self._before = {
            control: before
            for control, before in self._before.items()
            if not camera.set(control, before)
        }
