"""A camera as a source of bearings: its driver's pictures, searched for strips as they come."""

import dataclasses
import threading
from collections import Counter
from collections.abc import Callable

from host.config import Camera, Cameras
from host.drivers.camera.driver import TORN_SHARE, CameraDriver, Picture, many_torn
from host.messages import Health, Message
from host.perception.strips import StripFinder


class StripCamera:
    """One camera, "front" or "rear": `run` it in a thread."""

    def __init__(self, name: str, cameras: Cameras, camera: Camera) -> None:
        self._driver = CameraDriver(f"{name} camera", camera, cameras.delay_s)
        self._finder = StripFinder(cameras, camera, name=name)

    def run(self, emit: Callable[[Message], None], stop: threading.Event) -> None:
        """Emit Bearings of each picture, and the driver's Health with the search's counts.

        Health is not ok where the decoder finds many pictures damaged.
        """
        before = Counter(self._finder.counts)

        def take(message: Picture | Health) -> None:
            nonlocal before
            if isinstance(message, Health):
                counts = Counter(self._finder.counts)
                emit(_judged(message, counts, counts - before))
                before = counts
                return
            bearings = self._finder.find(message.jpeg, message.time)
            if bearings is not None:
                emit(bearings)

        self._driver.run(take, stop)


def _judged(health: Health, counts: "Counter[str]", news: "Counter[str]") -> Health:
    """The driver's Health with the search's counts. news: those since the last one."""
    torn, searched = news["pictures_torn"], news["pictures"]
    counted = {**health.counts, **counts}
    if health.ok and torn > TORN_SHARE * searched:
        reason = str(many_torn(torn / searched))
        return dataclasses.replace(health, ok=False, reason=reason, counts=counted)
    return dataclasses.replace(health, counts=counted)


def camera_sources(config: Cameras) -> dict[str, StripCamera]:
    """The cameras that have a source, by the name that Health calls them."""
    by_name = {"front": config.front, "rear": config.rear}
    return {
        f"{name} camera": StripCamera(name, config, camera)
        for name, camera in by_name.items()
        if camera.source != "none"
    }
