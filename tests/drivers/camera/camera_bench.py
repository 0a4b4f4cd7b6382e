"""A camera driver in its thread, for tests: what it is fed with, and what it emitted."""

import threading
import time
from collections.abc import Callable

import cv2
import numpy as np

from host.config import Camera
from host.drivers.camera.driver import CameraDriver, Picture
from host.messages import Health

WIDTH, HEIGHT = 64, 64
PATIENCE_S = 20.0


def jpeg(number: int, width: int = WIDTH, height: int = HEIGHT) -> bytes:
    image = np.random.default_rng(number).integers(0, 256, (height, width, 3), dtype=np.uint8)
    return bytes(cv2.imencode(".jpg", image)[1])


class Bench:
    """A driver in its thread, and what it emitted."""

    def __init__(self) -> None:
        self.messages: list[Picture | Health] = []
        self.errors: list[BaseException] = []
        self.stop = threading.Event()
        self._thread: threading.Thread | None = None

    def run(self, source: object, delay_s: float = 0.0, **settings: object) -> None:
        camera = Camera(
            source=str(source),
            **{"width_px": WIDTH, "height_px": HEIGHT, "rate_hz": 200.0, **settings},  # type: ignore[arg-type]
        )
        driver = CameraDriver("front camera", camera, delay_s)
        self._thread = threading.Thread(target=self._drive, args=(driver,))
        self._thread.start()

    def _drive(self, driver: CameraDriver) -> None:
        try:
            driver.run(self.messages.append, self.stop)
        except BaseException as error:
            self.errors.append(error)
            raise

    def pictures(self) -> list[Picture]:
        return [message for message in self.messages if isinstance(message, Picture)]

    def health(self) -> list[Health]:
        return [message for message in self.messages if isinstance(message, Health)]

    def wait(self, condition: Callable[[], bool]) -> None:
        end = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end, self.messages[-1:]
            assert not self.errors
            time.sleep(0.005)

    def wait_reason(self, words: str, ok: bool = False) -> Health:
        found: list[Health] = []

        def seen() -> bool:
            found[:] = [h for h in self.health() if words in h.reason and h.ok == ok]
            return bool(found)

        self.wait(seen)
        assert found[-1].device == "front camera"
        return found[-1]

    def close(self) -> None:
        self.stop.set()
        if self._thread is not None:
            self._thread.join()
        assert not self.errors
