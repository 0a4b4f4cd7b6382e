"""sd_notify and the watchdog, at a socket as systemd opens it."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from host.messages import Health
from host.pipeline import LOCALIZER
from host.sessions.live.systemd import Service, of_environment

PATIENCE_S = 40.0


@pytest.fixture
def manager(tmp_path: Path) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as made:
        made.bind(str(tmp_path / "notify"))
        made.settimeout(PATIENCE_S)
        yield made


def said(manager: socket.socket) -> list[str]:
    return manager.recv(4096).decode().split("\n")


def health(device: str, ok: bool = True, reason: str = "well") -> Health:
    return Health(0.0, device, ok, reason, {})


def test_it_is_ready_once_when_every_device_is_healthy(manager: socket.socket) -> None:
    service = of_environment(("lidar", "board"), {"NOTIFY_SOCKET": manager.getsockname()})
    assert isinstance(service, Service)
    service.take(health("lidar"))
    service.take(health(LOCALIZER))
    assert said(manager) == ["WATCHDOG=1", "STATUS=board: starting"]
    service.take(health("board", False, "no such device\nplug it in"))
    service.take(health(LOCALIZER))
    assert said(manager) == ["WATCHDOG=1", "STATUS=board: no such device; plug it in"]
    for first in (True, False):
        service.take(health("board"))
        service.take(health(LOCALIZER, reason="7 updates/s"))
        lines = said(manager)
        assert lines[:2] == ["WATCHDOG=1", "STATUS=healthy: 7 updates/s"]
        assert lines[2:] == ["READY=1"] * first
    service.close()
    assert said(manager) == ["STOPPING=1"]


def test_without_systemd_there_is_no_service_and_without_a_listener_no_failure() -> None:
    assert of_environment((), {}) is None
    assert of_environment((), {"NOTIFY_SOCKET": "nonsense"}) is None
    service = of_environment((), {"NOTIFY_SOCKET": "/nowhere/at/all"})
    assert service is not None
    service.take(health(LOCALIZER))
    service.close()


def test_an_abstract_address_is_understood() -> None:
    name = f"swarmloc-test-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as made:
        made.bind(f"\0{name}")
        made.settimeout(PATIENCE_S)
        service = of_environment((), {"NOTIFY_SOCKET": f"@{name}"})
        assert service is not None
        service.close()
        assert said(made) == ["STOPPING=1"]


def test_a_run_reports_itself_and_ends_by_sigterm(manager: socket.socket) -> None:
    command = "from host.cli.main import main; main()"
    run = subprocess.Popen(
        [sys.executable, "-c", command, "run", "--simulate", "arena4", "--view", "none"],
        env={**os.environ, "NOTIFY_SOCKET": manager.getsockname()},
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        end = time.monotonic() + PATIENCE_S
        while "READY=1" not in said(manager):
            assert time.monotonic() < end
        assert said(manager)[0] == "WATCHDOG=1"
        os.kill(run.pid, signal.SIGTERM)
        while said(manager) != ["STOPPING=1"]:
            assert time.monotonic() < end
        written, _ = run.communicate(timeout=PATIENCE_S)
    finally:
        run.kill()
    assert run.returncode == 0
    assert "lidar ok" in written
    assert "Summary" in written
