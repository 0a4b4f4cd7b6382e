"""Which sensors a run uses besides the wheels, and which messages are theirs."""

from typing import TypeGuard

from host.messages import Bearings, Displacement, Measurement, Message, Positions, Scan

LIDAR_ONLY, LIDAR_AND_CAMERA = SENSORS = ("lidar", "lidar+camera")


def uses(message: Message, sensors: str) -> TypeGuard[Measurement | Displacement]:
    """Whether a message is for the localizer when only these sensors are in use."""
    if isinstance(message, Bearings):
        return sensors != LIDAR_ONLY
    return isinstance(message, Scan | Positions | Displacement)
