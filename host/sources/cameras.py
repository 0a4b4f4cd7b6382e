"""A camera as a source of bearings: its driver's pictures, searched for strips as they come."""

import dataclasses
import threading
from collections import Counter
from collections.abc import Callable

from host.config import Camera, Cameras
from host.drivers.camera.driver import TORN_SHARE, CameraDriver, Picture, many_torn
from host.errors import UserError
from host.messages import Bearings, Health, Message
from host.perception.strips.finder import StripFinder
from host.sources.strip_colour import StripColour


class StripCamera:
    """One camera, "front" or "rear": `run` it in a thread.

    remark: what Health says beside, while all is well. watchers: each is called with every picture
    and what was found in it, in the camera's thread.
    """

    def __init__(self, name: str, cameras: Cameras, camera: Camera, remark: str = "") -> None:
        self._driver = CameraDriver(
            f"{name} camera", camera, cameras.delay_s, cameras.mains_hz, cameras.search_rate_hz
        )
        self.name = name
        self.watchers: list[Callable[[bytes, Bearings], None]] = []
        self._remark = remark
        self._finder = StripFinder(cameras, camera, name=name)
        self._colour = StripColour(cameras.strip, camera)

    def run(self, emit: Callable[[Message], None], stop: threading.Event) -> None:
        """Emit Bearings of each picture, and the driver's Health with the search's counts.

        Health is not ok where the decoder finds many pictures damaged, or none has colour; it has
        a remark where the strips' colour is nearly another.
        """
        before = Counter(self._finder.counts)

        def take(message: Picture | Health) -> None:
            nonlocal before
            if isinstance(message, Health):
                counts = Counter(self._finder.counts)
                emit(self._judged(message, counts, counts - before))
                before = counts
                return
            bearings = self._finder.find(message.jpeg, message.time)
            if bearings is not None:
                emit(bearings)
                self._colour.take(message.jpeg, bearings)
                for show in self.watchers:
                    show(message.jpeg, bearings)

        self._driver.run(take, stop)

    def _judged(self, health: Health, counts: "Counter[str]", news: "Counter[str]") -> Health:
        """The driver's Health with the search's counts. news: those since the last one."""
        torn, searched = news["pictures_torn"], news["pictures"]
        ok, reason = health.ok, health.reason
        if ok and torn > TORN_SHARE * searched:
            ok, reason = False, str(many_torn(torn / searched))
        elif ok and searched and news["pictures_colourless"] == searched:
            ok, reason = False, str(_colourless())
        elif ok:
            how, *remarks = reason.split("; ")
            how += f", {self._remark}" if self._remark else ""
            reason = "; ".join([how, *remarks, *self._colour.remarks()])
        return dataclasses.replace(health, ok=ok, reason=reason, counts={**health.counts, **counts})


def _colourless() -> UserError:
    return UserError(
        "the pictures are black and white: no strip can be found in them",
        "the camera is in its night mode, or made without colour",
        "switch on the light, switch its night mode off, or take another camera",
    )


def camera_sources(config: Cameras) -> dict[str, StripCamera]:
    """The cameras that have a source, by the name that Health calls them."""
    by_name = {"front": config.front, "rear": config.rear}
    named = {name: camera for name, camera in by_name.items() if camera.source != "none"}
    absent = [f"the {name} camera has no source" for name in by_name if name not in named]
    return {
        f"{name} camera": StripCamera(name, config, camera, "; ".join(absent))
        for name, camera in named.items()
    }
