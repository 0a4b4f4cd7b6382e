"""The cameras of a running simulation: streams of rendered JPEGs in named pipes."""

import contextlib
import functools
import math
import os
import select
import threading
from collections.abc import Callable
from pathlib import Path

from host.config import Camera, Cameras
from host.simulation.devices.workers import Workers
from host.simulation.pictures.render import Renderer, Surroundings
from host.simulation.world.scenarios import Scenario

FRONT, REAR = "front", "rear"
_POLL_S = 0.05  # so often a waiting writer looks whether to stop


class PictureFeed:
    """A named pipe as a camera's stream: who opens `path` reads from the next picture on."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._handle: int | None = None
        os.mkfifo(path)

    def listening(self) -> bool:
        """Whether a host has the pipe open; else no pictures are made."""
        if self._handle is None:
            # Fails as long as nobody reads.
            with contextlib.suppress(OSError):
                self._handle = os.open(self.path, os.O_WRONLY | os.O_NONBLOCK)
        return self._handle is not None

    def write(self, data: bytes, stop: threading.Event) -> None:
        """Send the whole of `data`, however slowly it is read, unless the reader goes or `stop`."""
        rest = memoryview(data)
        while self._handle is not None and rest and not stop.is_set():
            try:
                rest = rest[os.write(self._handle, rest) :]
            except BlockingIOError:
                poll = select.poll()
                poll.register(self._handle, select.POLLOUT)
                poll.poll(1000.0 * _POLL_S)
            except BrokenPipeError:
                self.close()

    def close(self) -> None:
        """Let go of the pipe: a reader comes to the stream's end."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None


class LiveCameras(Workers):
    """Front and rear camera, each a thread that sends its pictures when they would arrive.

    surroundings(time): what is around the robot at `time`, s since the start. folder: where the
    pipes are made. known: the cameras as the host knows them, which with the pipes for sources is
    `camera`; true: as they are. start(): host time (s) of time 0, later where the simulation was
    paused. absent(time): are both unplugged then (host, s)?
    """

    def __init__(
        self,
        folder: Path,
        scenario: Scenario,
        known: Cameras,
        true: Cameras,
        surroundings: Callable[[float], Surroundings],
        clock: Callable[[], float],
        start: Callable[[], float],
        absent: Callable[[float], bool] = lambda now: False,
    ) -> None:
        self._absent = absent
        self._scenario = scenario
        self._surroundings = surroundings
        self._clock = clock
        self._start = start
        self._true = true
        self._pipes = {name: PictureFeed(folder / f"{name}.mjpeg") for name in (FRONT, REAR)}
        changes = {
            name: camera.model_copy(
                update={"source": str(self._pipes[name].path), "rate_hz": scenario.camera_hz}
            )
            for name, camera in ((FRONT, known.front), (REAR, known.rear))
        }
        self.camera = known.model_copy(update=changes)
        opened = contextlib.ExitStack()
        for pipe in self._pipes.values():
            opened.callback(pipe.close)
        works = {
            f"{name} camera": functools.partial(self._run, name, camera)
            for name, camera in ((FRONT, true.front), (REAR, true.rear))
        }
        super().__init__(works, opened)

    def _run(self, name: str, camera: Camera) -> None:
        pipe = self._pipes[name]
        renderer = Renderer(self._true, camera, seed=self._scenario.seed)
        period, delay = 1.0 / self._scenario.camera_hz, self._scenario.camera_delay_s
        number = -1
        while not self._stop.is_set():
            # Where painting or reading takes too long, pictures are left out, as cameras do.
            start = self._start()
            late = self._clock() - start - delay
            number = max(number + 1, math.ceil(late / period))
            arrival = start + number * period + delay
            if self._absent(arrival):
                pipe.close()  # whoever reads comes to its end, as of a device that is gone
                if self._stop.wait(period):
                    return
                continue
            jpeg = b""
            if pipe.listening():
                jpeg = renderer.render(self._surroundings(number * period), number)
            if self._stop.wait(max(0.0, arrival - self._clock())):
                return
            pipe.write(jpeg, self._stop)
