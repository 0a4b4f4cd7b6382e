"""Drivers at work, for the tests of each."""

import math
from collections.abc import Iterator

import pytest

from host.drivers import pace
from host.drivers.camera import driver as camera
from tests.drivers.camera.camera_bench import Bench


@pytest.fixture
def device_blamed(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is wrong with a device is said on a computer that is too slow to judge it, too."""
    monkeypatch.setattr(pace, "_MOST_S", math.inf)


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch, device_blamed: None) -> Iterator[Bench]:
    monkeypatch.setattr(camera, "_HEALTH_PERIOD_S", 0.1)
    rig = Bench()
    yield rig
    rig.close()
