"""The Romeo board on its USB port: wheel displacements come, wheel speeds go."""

import contextlib
import threading
import time
from collections.abc import Callable

import serial

from host.config import RobotConfig
from host.drivers.health import HealthReporter
from host.drivers.reconnect import keep_connected
from host.drivers.romeo.differential_drive import ticks_for
from host.drivers.romeo.ports import BOARD, SKETCH_IDS
from host.drivers.romeo.session import BoardSession
from host.drivers.serial_port import find_port, open_port, read_available
from host.errors import UserError
from host.messages import DeviceBytes, DeviceIdentity, Message

BAUDRATE = 115200  # of no effect on native USB, but 1200 would start the bootloader
COMMAND_LIFE_S = 0.12  # whoever commands sends again well before
READ_TIMEOUT_S = 0.02


class Romeo:
    """One board: `run` it in a thread, `command` it from any other."""

    def __init__(self, robot: RobotConfig, clock: Callable[[], float] = time.monotonic) -> None:
        """clock: the host's monotonic time, s."""
        self._wheels = robot.wheels
        self._port = robot.board.port
        self._clock = clock
        self._session = BoardSession(robot)
        self._lock = threading.Lock()
        self._wanted: tuple[tuple[int, int], float] | None = None
        self._emit: Callable[[Message], None] = lambda message: None
        self._stop = threading.Event()
        self._health = HealthReporter(BOARD, clock)
        self._identity: dict[str, str] = {}

    def command(self, speed_mps: float, turn_rate_radps: float) -> None:
        """Drive so fast and turn so fast (counter-clockwise positive) for COMMAND_LIFE_S.

        Both are clipped to the limits of robot.toml's [wheels]; call again to go on. Raises
        ValueError where one is not a finite number.
        """
        wanted = ticks_for(self._wheels, speed_mps, turn_rate_radps)
        with self._lock:
            self._wanted = wanted, self._clock()

    def run(self, emit: Callable[[Message], None], stop: threading.Event) -> None:
        """Emit Displacement, and Health once per second and at a change of state, until `stop`.

        Failures of the device are reported as Health, and it is tried again; it raises only what
        is the program's own fault.
        """
        self._emit, self._stop = emit, stop
        keep_connected(self._serve, self._report_failure, stop)

    def _serve(self) -> None:
        """One connection, until `stop` is set or the port fails."""
        with open_port(find_port(BOARD, SKETCH_IDS, self._port), BAUDRATE, dtr=True) as port:
            now = self._clock()
            self._emit(DeviceBytes(now, BOARD, b""))
            self._session.connect(now)
            try:
                while not self._stop.is_set():
                    self._talk(port)
            finally:
                # Where the port is gone, the board's own command timeout stops the wheels.
                with contextlib.suppress(OSError):
                    port.write(self._session.stop())

    def _talk(self, port: serial.Serial) -> None:
        """Take in what has come, and send what is due."""
        with self._health.pace.within(READ_TIMEOUT_S):
            data = read_available(port, READ_TIMEOUT_S)
        now = self._clock()
        if data:
            self._emit(DeviceBytes(now, BOARD, data))
        for step in self._session.receive(data, now):
            self._emit(step)
        identity = self._session.identity()
        if identity and identity != self._identity:
            self._identity = identity
            self._emit(DeviceIdentity(now, BOARD, identity))
        port.write(self._session.transmit(now, self._command_at(now)))
        self._health.report(self._emit, *self._session.state(now), self._session.counts)

    def _command_at(self, now: float) -> tuple[int, int] | None:
        """The last command in ticks/s (left, right), while it is in force."""
        with self._lock:
            if self._wanted is None or now > self._wanted[1] + COMMAND_LIFE_S:
                return None
            return self._wanted[0]

    def _report_failure(self, error: UserError) -> None:
        self._health.report(self._emit, False, str(error), self._session.counts, certain=True)
