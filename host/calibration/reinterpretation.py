"""Messages taken under one configuration, as another would have had them from the same devices.

What was measured stays: ticks, samples, pixels. What the configuration made of it is made again:
odometry from the wheels, times from the delays, bearings from lens and mounting. So a recording
shows what a calibration is worth, and one recording serves every calibration. Pictures are not
searched again: what was no strip stays none, and ranges by size are those of the old lens.
"""

import dataclasses

import numpy as np

from host.config import Camera, RobotConfig
from host.drivers.romeo.differential_drive import displacement
from host.messages import Bearings, BoolArray, Displacement, Message, Scan
from host.perception.lens import Lens, View
from host.perception.strips.geometry import StripGeometry


class Reinterpretation:
    """From configuration `old` to `new`. What neither changes comes out as it went in."""

    def __init__(self, old: RobotConfig, new: RobotConfig) -> None:
        self._old, self._new = old, new
        self._later_lidar = old.lidar.delay_s - new.lidar.delay_s
        self._later_camera = old.camera.delay_s - new.camera.delay_s
        self._noise = new.camera.bearing_noise_rad**2 - old.camera.bearing_noise_rad**2
        self._views = {}
        for name in ("front", "rear"):
            before, after = getattr(old.camera, name), getattr(new.camera, name)
            if _placed(before) != _placed(after):
                self._views[name] = Lens(before), View(after), StripGeometry(new.camera, after).view

    def of(self, message: Message) -> Message:
        """The message as the new configuration has it."""
        if isinstance(message, Displacement):
            return self._displacement(message)
        if isinstance(message, Scan) and self._later_lidar:
            later = self._later_lidar
            return dataclasses.replace(
                message, time=message.time + later, times=message.times + later
            )
        if isinstance(message, Bearings):
            return self._bearings(message)
        return message

    def _displacement(self, message: Displacement) -> Displacement:
        if message.ticks is None or self._new.wheels == self._old.wheels:
            return message
        return displacement(self._new.wheels, message.time, message.interval, *message.ticks)

    def _bearings(self, message: Bearings) -> Bearings:
        if self._later_camera or self._noise:
            message = dataclasses.replace(
                message,
                time=message.time + self._later_camera,
                variances=np.maximum(message.variances + self._noise, 1e-8),
            )
        if message.camera not in self._views or message.pixels is None:
            return message
        old, view, shown = self._views[message.camera]
        directions = view.directions_of(message.pixels)
        drawn = np.isfinite(directions[:, 0])  # the new lens may end before the old one
        farther = view.lens.extrapolation_variances(message.pixels)
        variances = message.variances + farther - old.extrapolation_variances(message.pixels)
        return dataclasses.replace(
            _part(message, drawn),
            variances=np.maximum(variances[drawn], 1e-8),
            bearings=np.arctan2(directions[drawn, 1], directions[drawn, 0]),
            origin=(float(view.origin[0]), float(view.origin[1])),
            view=shown,
        )


def _part(message: Bearings, chosen: BoolArray) -> Bearings:
    """The message with those of its strips that are chosen (n,)."""
    columns = ("bearings", "variances", "identities", "ranges", "range_variances", "pixels")
    rows = {name: getattr(message, name) for name in columns}
    kept = {name: row[chosen] for name, row in rows.items() if row is not None}
    return dataclasses.replace(message, **kept)


def _placed(camera: Camera) -> Camera:
    """What of a camera matters to bearings."""
    return camera.model_copy(update={"source": "none", "rate_hz": 30.0})
