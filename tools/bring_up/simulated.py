"""Without a robot and without root: a simulated one, run as systemd would run the service."""

import os
import signal
import socket
import subprocess
import tempfile
import time
from pathlib import Path

from tools.bring_up.layout import SOURCE
from tools.bring_up.machine import Machine, StepError

_START_S, _SILENCE_S, _STOP_S = 120.0, 15.0, 10.0


def run_simulated(scenario: str, seconds: float | None, dry: bool) -> int:
    """Set up .venv, then run the localizer until Ctrl-C, or for so long once it is healthy."""
    machine = Machine(dry)
    machine.run([str(SOURCE / "tools/setup"), str(SOURCE / ".venv")], quiet=False)
    program = SOURCE / ".venv/bin/swarmloc"
    command = [str(program), "run", "--simulate", scenario]
    if dry:
        machine.run(command)
        return 0
    with tempfile.TemporaryDirectory() as folder:
        address = Path(folder) / "notify"
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
            manager.bind(str(address))
            environment = {**os.environ, "NOTIFY_SOCKET": str(address)}
            with subprocess.Popen(command, env=environment, cwd=SOURCE) as service:
                try:
                    return _supervise(service, manager, seconds)
                finally:
                    _stop(service)


def _supervise(
    service: "subprocess.Popen[bytes]", manager: socket.socket, seconds: float | None
) -> int:
    """Wait until it is ready, then watch its watchdog; 0 once it was healthy."""
    begin = heard = time.monotonic()
    ready: float | None = None
    manager.settimeout(0.5)
    try:
        while ready is None or seconds is None or time.monotonic() < ready + seconds:
            if service.poll() is not None:
                raise StepError(f"the service ended with {service.returncode}")
            try:
                lines = manager.recv(4096).decode("utf-8", "replace").split("\n")
            except TimeoutError:
                lines = []
            now = time.monotonic()
            heard = now if lines else heard
            if "READY=1" in lines:
                ready = now
                status = next((line for line in lines if line.startswith("STATUS=")), "")
                print(f"bringup: the service is {status.removeprefix('STATUS=')}", flush=True)
            if ready is None and now > begin + _START_S:
                raise StepError("the service did not become healthy: see what it said above")
            if ready is not None and now > heard + _SILENCE_S:
                raise StepError(f"the service said nothing for {_SILENCE_S:.0f} s")
    except KeyboardInterrupt:
        return 0 if ready is not None else 1
    return 0


def _stop(service: "subprocess.Popen[bytes]") -> None:
    if service.poll() is None:
        service.send_signal(signal.SIGTERM)
        try:
            service.wait(_STOP_S)
        except subprocess.TimeoutExpired:
            service.kill()
