"""The simulated robot's true parameters, from which its configuration may differ."""

import math

from host.config import Camera, RobotConfig
from host.simulation.world.scenarios import Scenario

# Ordinary errors of a robot built by hand, times `Scenario.misbuilt`.
_WHEEL, _TRACK = 0.02, 0.05  # shares of the nominal
_LIDAR_M, _LIDAR_RAD = 0.01, math.radians(3.0)
_CAMERA_RAD = math.radians(2.0)
_BODY_M, _BODY_RAD = 0.02, math.radians(5.0)  # how a marker body lies on the robot


def built(config: RobotConfig, scenario: Scenario) -> RobotConfig:
    """The robot of a scenario: as `config` says or, where it is misbuilt, a Cherokey that is off.

    Its delays are the scenario's.
    """
    lidar_delay, camera_delay = scenario.lidar_delay_s, scenario.camera_delay_s
    if scenario.misbuilt:
        config = _misbuilt(RobotConfig(), scenario.misbuilt)
    lidar = config.lidar.model_copy(update={"delay_s": lidar_delay})
    camera = config.camera.model_copy(update={"delay_s": camera_delay})
    return config.model_copy(update={"lidar": lidar, "camera": camera})


def known(config: RobotConfig, scenario: Scenario) -> RobotConfig:
    """What the host knows: `config` and, unless the robot is misbuilt, the true delays."""
    return config if scenario.misbuilt else built(config, scenario)


def _misbuilt(config: RobotConfig, share: float) -> RobotConfig:
    wheels, camera = config.wheels, config.camera
    return config.model_copy(
        update={
            "wheels": wheels.model_copy(
                update={
                    "left_radius_m": wheels.left_radius_m * (1.0 + _WHEEL * share),
                    "right_radius_m": wheels.right_radius_m * (1.0 - _WHEEL * share),
                    "track_m": wheels.track_m * (1.0 + _TRACK * share),
                }
            ),
            "lidar": config.lidar.model_copy(
                update={"x_m": _LIDAR_M * share, "heading_rad": _LIDAR_RAD * share}
            ),
            "camera": camera.model_copy(
                update={
                    "front": _rotated(camera.front, _CAMERA_RAD * share),
                    "rear": _rotated(camera.rear, -_CAMERA_RAD * share),
                }
            ),
            "mocap": config.mocap.model_copy(
                update={
                    "x_m": _BODY_M * share,
                    "y_m": -_BODY_M * share,
                    "heading_rad": _BODY_RAD * share,
                }
            ),
        }
    )


def _rotated(camera: Camera, by_rad: float) -> Camera:
    """A camera rotated to the left and tilted down by an angle."""
    heading = math.remainder(camera.heading_rad + by_rad, math.tau)
    return camera.model_copy(update={"heading_rad": heading, "tilt_rad": camera.tilt_rad + by_rad})
