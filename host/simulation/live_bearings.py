"""Cameras of a running simulation whose pictures are not rendered: bearings as they arrive."""

import threading
from collections.abc import Callable
from typing import Protocol

from host.messages import Bearings, Health, Message

CAMERA = "camera"
_HEALTH_S = 1.0


class Observed(Protocol):
    """What such a camera needs of the simulation; times of the host, s."""

    clock: Callable[[], float]

    def arrival(self, frame: int) -> float:
        """When the bearings of a frame arrive."""

    def bearings(self, frame: int) -> Bearings:
        """What is seen in it."""

    def absent(self, name: str, time: float) -> bool:
        """Whether a device is unplugged."""


class LiveCamera:
    """The cameras of a running simulation, as a device: `run` it in its own thread."""

    def __init__(self, simulation: Observed) -> None:
        self._simulation = simulation

    def run(self, emit: Callable[[Message], None], stop: threading.Event) -> None:
        """Emit Bearings when they arrive, and Health once per second, until `stop` is set."""
        frame = 0
        next_health = 0.0
        while not stop.is_set():
            arrival = self._simulation.arrival(frame)
            if stop.wait(max(0.0, arrival - self._simulation.clock())):
                return
            there = not self._simulation.absent(CAMERA, arrival)
            if there:
                emit(self._simulation.bearings(frame))
            frame += 1
            if arrival >= next_health:
                next_health = arrival + _HEALTH_S
                words = "simulated" if there else "unplugged (simulated)\nplug it in again"
                emit(Health(arrival, CAMERA, there, words, {"frames": frame}))
