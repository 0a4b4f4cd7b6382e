"""Drivers at work, for the tests of each."""

from collections.abc import Iterator

import pytest

from host.drivers.camera import driver as camera
from tests.drivers.camera.camera_bench import Bench


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    monkeypatch.setattr(camera, "_HEALTH_PERIOD_S", 0.1)
    rig = Bench()
    yield rig
    rig.close()
