"""Which sensors a run uses besides the wheels, and which messages are theirs."""

from typing import TypeGuard

from host.messages import (
    Bearings,
    DeviceBytes,
    Displacement,
    Measurement,
    Message,
    Positions,
    Scan,
)

LIDAR_ONLY, LIDAR_AND_CAMERA, CAMERA_ONLY = SENSORS = ("lidar", "lidar+camera", "camera")


def uses(message: Message, sensors: str) -> TypeGuard[Measurement | Displacement]:
    """Whether a message is for the localizer when only these sensors are in use."""
    if isinstance(message, Bearings):
        return sensors != LIDAR_ONLY
    if isinstance(message, Scan | Positions):
        return sensors != CAMERA_ONLY
    return isinstance(message, Displacement)


def has(message: Message, sensors: str) -> bool:
    """Whether a robot with only these sensors has such a message."""
    if isinstance(message, DeviceBytes):
        return message.device != "lidar" or sensors != CAMERA_ONLY
    return uses(message, sensors) or not isinstance(message, Scan | Positions | Bearings)
