"""Drivers at work, for the tests of each."""

from collections.abc import Iterator

import pytest

from host.drivers.camera import driver as camera
from host.drivers.camera import usb as camera_v4l2
from tests.drivers.camera.camera_bench import Bench


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    monkeypatch.setattr(camera, "_HEALTH_PERIOD_S", 0.1)
    monkeypatch.setattr(camera_v4l2, "SETTLE_S", 0.05)
    rig = Bench()
    yield rig
    rig.close()
