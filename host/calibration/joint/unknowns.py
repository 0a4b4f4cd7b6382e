"""The unknowns of the joint fit in one vector, and what each of them changes at a teammate."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from host.calibration.camera.model import NAMES
from host.calibration.camera.pairs import CAMERAS
from host.calibration.chain import by_base
from host.calibration.gathered import Tracks
from host.calibration.wheels.model import BODY
from host.geometry import rotation
from host.messages import FloatArray, IntArray

BODY_VALUES, LIDAR_VALUES, CAMERA_VALUES = 3, 5, len(NAMES) * len(CAMERAS) + 1


@dataclass(frozen=True, slots=True)
class Unknowns:
    """Where values are in the joint vector (p,).

    First those of the wheels (with the tracked body's, `wheels.model.BODY`), then of the lidar, of
    the cameras, and x, y (m) of each teammate's turret in the frame of its body. wheel_values: how
    many the wheels have. teammates: numbers of the bodies.
    """

    wheel_values: int
    teammates: Sequence[int]

    @property
    def wheels(self) -> slice:
        """As in `wheels.model`."""
        return slice(0, self.wheel_values)

    @property
    def lidar(self) -> slice:
        """As in `robust.time_offset.JointFit`."""
        return slice(self.wheel_values, self.wheel_values + LIDAR_VALUES)

    @property
    def cameras(self) -> slice:
        """As in `camera.fit.CameraFit`."""
        return slice(self.lidar.stop, self.lidar.stop + CAMERA_VALUES)

    @property
    def turrets(self) -> slice:
        """Two for each teammate."""
        return slice(self.cameras.stop, len(self))

    def __len__(self) -> int:
        return int(self.cameras.stop) + 2 * len(self.teammates)

    def tracks(self, tracks: Tracks, values: FloatArray) -> Tracks:
        """True paths as values (p,) have the tracked body and the turrets."""
        places = values[self.turrets].reshape(-1, 2)
        return tracks.mounted(values[BODY], dict(zip(self.teammates, places, strict=True)))

    def slopes_of_places(
        self, tracks: Tracks, values: FloatArray, who: IntArray, times: FloatArray, at: FloatArray
    ) -> FloatArray:
        """Derivatives (n, 2, p) of where turrets actually are, `at` (n, 2) m in the robot frame.

        who (n,): the teammates' numbers; times (n,) s.
        """
        slopes = np.zeros((len(who), 2, len(self)))
        body = values[BODY]
        slopes[:, :, BODY] = [by_base(place, body[:2])[:2] for place in at]
        for k, number in enumerate(self.teammates):
            own = np.flatnonzero(who == number)
            angles = tracks.rotated(number, times[own])
            first = self.turrets.start + 2 * k
            slopes[own, :, first : first + 2] = [rotation(angle) for angle in angles]
        return slopes
