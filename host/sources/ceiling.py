"""A camera under the ceiling as motion capture: its driver's pictures, searched for tags."""

import dataclasses
import math
import threading
from collections import Counter
from collections.abc import Callable

import numpy as np
import simplejpeg

from host.config import Ceiling
from host.drivers.camera.driver import CameraDriver, Picture
from host.drivers.natnet.client import MOCAP
from host.messages import Health, Message
from host.perception.aruco import TagFinder


class CeilingCamera:
    """Where tags are on the floor: `run` it in a thread.

    Its truth is as late as `delay_s` in [mocap.ceiling] is wrong, and every delay that is fitted
    against it with it. Wheel ticks are hardly late: a lag of the odometry that `calibrate wheels`
    finds is the camera's delay, with the opposite sign. Raises UserError where OpenCV cannot find
    tags.
    """

    def __init__(self, config: Ceiling) -> None:
        self._config = config
        self._driver = CameraDriver(MOCAP, config.eye, config.delay_s, config.mains_hz)
        self._finder = TagFinder(config)
        self._undecoded = 0

    def run(self, emit: Callable[[Message], None], stop: threading.Event) -> None:
        """Emit Bodies of each picture, also empty ones, and the driver's Health with the tags.

        Health is not ok where squares are seen, but none has the size of a tag.
        """
        before: Counter[str] = Counter()

        def take(message: Picture | Health) -> None:
            nonlocal before
            if isinstance(message, Health):
                emit(self._judged(message, self._finder.counts - before))
                before = self._finder.counts.copy()
                return
            try:
                grey = simplejpeg.decode_jpeg(message.jpeg, "GRAY")[:, :, 0]
            except ValueError:  # damaged
                self._undecoded += 1
                return
            emit(self._finder.find(np.ascontiguousarray(grey, dtype=np.uint8), message.time))

        self._driver.run(take, stop)

    def _judged(self, health: Health, news: "Counter[str]") -> Health:
        """The driver's Health with the tags counted. news: those since the last one."""
        counts = {**health.counts, **self._finder.counts, "undecoded": self._undecoded}
        ok, reason = health.ok, health.reason
        if ok and news["misread"] > news["tags"]:
            ok, side = False, self._finder.side_m
            size = f"{1e3 * side:.0f} mm wide on the floor, not {1e3 * self._config.tag_m:.0f} mm"
            seen = "are seen where none can be" if math.isnan(side) else f"look {size}"
            reason = (
                f"tags {seen}\n"
                "check tag_m and tag_height_m in [mocap.ceiling], and z_m and focal_px in "
                "[mocap.ceiling.eye]"
            )
        elif ok and news["doubled"]:
            reason += "; one number is on two tags, which are left out: give each its own"
        elif ok and not news["tags"]:
            reason += "; no tag in view"
        return dataclasses.replace(health, ok=ok, reason=reason, counts=counts)
