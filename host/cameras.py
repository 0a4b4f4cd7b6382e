"""A camera as a source of bearings: its driver's pictures, searched for strips as they come."""

import dataclasses
import threading
from collections.abc import Callable

from host.config import Camera, Eye
from host.drivers.camera import CameraDriver, Picture
from host.messages import Health, Message
from host.perception.red_strip import StripFinder


class StripCamera:
    """One camera: `run` it in a thread. name: what Health calls it, "front camera" say."""

    def __init__(self, name: str, camera: Camera, eye: Eye) -> None:
        self._driver = CameraDriver(name, eye, camera.delay_s)
        self._finder = StripFinder(camera, eye)

    def run(self, emit: Callable[[Message], None], stop: threading.Event) -> None:
        """Emit Bearings of each picture, and the driver's Health with the search's counts."""

        def take(message: Picture | Health) -> None:
            if isinstance(message, Health):
                counts = {**message.counts, **self._finder.counts}
                emit(dataclasses.replace(message, counts=counts))
                return
            bearings = self._finder.find(message.jpeg, message.time)
            if bearings is not None:
                emit(bearings)

        self._driver.run(take, stop)


def cameras(config: Camera) -> dict[str, StripCamera]:
    """The cameras that have a source, by name."""
    eyes = {"front camera": config.front, "rear camera": config.rear}
    return {
        name: StripCamera(name, config, eye) for name, eye in eyes.items() if eye.source != "none"
    }
