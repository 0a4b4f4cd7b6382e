"""The YDLidar X4 or X4 Pro on a serial port: motor, commands, scans, and its state in words."""

import errno
import threading
import time
from collections.abc import Callable
from dataclasses import asdict
from typing import TypeVar

import serial

from host.config import Lidar
from host.drivers.health import HealthReporter
from host.drivers.reconnect import keep_connected
from host.drivers.serial_port import find_port, open_port, read_available
from host.drivers.x4 import commands
from host.drivers.x4.commands import DeviceHealth, DeviceInfo
from host.drivers.x4.formats import unknown_format
from host.drivers.x4.liveness import Liveness
from host.drivers.x4.packets import BAUDRATE
from host.drivers.x4.protocol import ScanDecoder, delayed
from host.drivers.x4.state import Identity, damage, in_words, why_silent
from host.errors import UserError
from host.messages import DeviceBytes, DeviceIdentity, Message

USB_IDS = ((0x10C4, 0xEA60),)  # the CP2102 on the X4's adapter board
LIDAR = "lidar"
_REPLY_WAIT_S = 1.0
_SPIN_UP_S = 6.0  # a motor may take 3.6 s to reach its speed
_SILENCE_S = 1.0
_SCAN_AGAIN_S = 5.0
# Connecting again starts the motor again, which costs a slow one its speed.
_GIVE_UP_S = 20.0
_HEALTH_PERIOD_S = 1.0
READ_TIMEOUT_S = 0.05
_RECENT_BYTES = 4096

ReplyKind = TypeVar("ReplyKind", DeviceInfo, DeviceHealth)


class X4:
    """The lidar of one robot. config: its [lidar] section; clock: host time in s.

    An X4 Pro, which answers no command, is recognized by its packets. `run` is meant for a thread
    of its own. The motor runs as long.
    """

    def __init__(self, config: Lidar, clock: Callable[[], float] = time.monotonic) -> None:
        self._config = config
        self._clock = clock
        self._decoder = ScanDecoder()
        self._emit: Callable[[Message], None] = lambda message: None
        self._stop = threading.Event()
        self._connections = 0
        self._motor_switch = True  # whether the port can switch the motor
        self._health = HealthReporter(LIDAR, clock, _HEALTH_PERIOD_S)
        self._recent = b""  # the last bytes, to find out about an unknown format

    @property
    def last_return(self) -> float:
        """When anything last came back to it, host time, s; whole revolutions are older."""
        return self._decoder.last_return

    def run(self, emit: Callable[[Message], None], stop: threading.Event) -> None:
        """Emit Scan per revolution, Health once per second and at a change of state, until `stop`.

        Failures of the device are reported as Health and tried again; it raises only what is the
        program's own fault. Scan times are `delay_s` before what the sample clock says.
        """
        self._emit, self._stop = emit, stop
        keep_connected(self._serve, self._report_failure, stop)

    def _serve(self) -> None:
        """One connection: from opening the port to its loss or to the end."""
        path = find_port(LIDAR, USB_IDS, self._config.port)
        # The motor starts on a rising edge of DTR, which opening a port may already have raised.
        port = open_port(path, BAUDRATE, dtr=False)
        try:
            self._connections += 1
            self._decoder.reset()
            self._emit(DeviceBytes(self._clock(), LIDAR, b""))
            self._stop.wait(0.1)
            self._motor_switch = self._switch_motor(port, on=True)
            identity = self._identify(port)
            if not self._stop.is_set():
                self._scan(port, identity)
        finally:
            self._leave(port)

    def _identify(self, port: serial.Serial) -> Identity:
        """Ask the lidar which one it is. Raises UserError where it is none that is known."""
        port.write(commands.STOP)  # what may still run from before
        self._drain(port)
        before = dict(self._decoder.counts)
        info = self._ask(port, (commands.INFO,), DeviceInfo)
        health = self._ask(port, (commands.HEALTH, commands.HEALTH_OF_SDK), DeviceHealth)
        counts = self._decoder.counts
        if info is None and health is None and counts["packets"] > before["packets"]:
            return Identity(one_way=True, info=None)
        self._check_answers(info, health, counts["bytes_skipped"] > before["bytes_skipped"])
        if info is not None:
            values = {name: str(value) for name, value in asdict(info).items()}
            self._emit(DeviceIdentity(self._clock(), LIDAR, values))
        return Identity(one_way=False, info=info)

    def _switch_motor(self, port: serial.Serial, on: bool) -> bool:
        """Start or stop the motor by DTR. False on ports without that line (pseudo-terminals)."""
        try:
            port.dtr = on
        except OSError as error:
            if error.errno in (errno.ENOTTY, errno.EINVAL):
                return False
            raise
        return True

    def _read(self, port: serial.Serial) -> tuple[bytes, float]:
        """What has arrived, and when, s."""
        with self._health.pace.within(READ_TIMEOUT_S):
            data = read_available(port, READ_TIMEOUT_S)
        now = self._clock()
        if data:
            self._emit(DeviceBytes(now, LIDAR, data))
            self._recent = (self._recent + data)[-_RECENT_BYTES:]
        return data, now

    def _drain(self, port: serial.Serial) -> None:
        """Throw away what was sent before the stop command took effect."""
        end = self._clock() + 0.2
        while self._clock() < end:
            read_available(port)

    def _leave(self, port: serial.Serial) -> None:
        """Stop the lidar and its motor as far as it is still there, and close."""
        try:
            port.write(commands.STOP)
            self._switch_motor(port, on=False)
        except OSError:
            pass  # it is gone: nothing is left to stop
        port.close()

    def _ask(
        self, port: serial.Serial, questions: tuple[bytes, ...], kind: type[ReplyKind]
    ) -> ReplyKind | None:
        """The reply to the first of the `questions` that is answered, None without one."""
        for question in questions:
            port.write(question)
            end, over = self._clock() + _REPLY_WAIT_S, False
            while not over and not self._stop.is_set():
                over = self._clock() > end  # then it reads once more: it may have stood still
                self._decoder.feed(*self._read(port))
                for reply in self._decoder.take_replies():
                    if isinstance(reply, kind):
                        return reply
        return None

    def _check_answers(
        self, info: DeviceInfo | None, health: DeviceHealth | None, noise: bool
    ) -> None:
        """Raise UserError where the lidar does not answer or calls itself faulty.

        noise: other bytes came instead.
        """
        if self._stop.is_set():
            return
        if info is None and health is None:
            if noise:
                found = unknown_format(self._recent)
                raise UserError(
                    "the lidar's bytes make no sense",
                    f"something answers, but not as a YDLidar X4 does at {BAUDRATE} baud"
                    + (f" ({found})" if found else ""),
                    "check that the port is the lidar's and the model an X4",
                )
            raise UserError(
                "the lidar does not answer",
                "it has no power, its cable to the adapter is loose, or the port is another's",
                "check both USB leads of the adapter board and port in [lidar] of robot.toml",
            )
        if info is not None and info.model in commands.OTHER_MODELS:
            raise UserError(
                f"the lidar is a YDLidar {commands.OTHER_MODELS[info.model]}, not an X4",
                f"its info reply has model code {info.model}",
                "connect an X4 or X4 Pro; another model needs its own driver",
            )
        if health is not None and health.status == 2:
            raise UserError(
                "the lidar reports a fault",
                f"its error code is {health.error:#06x}",
                "unplug both USB leads for some seconds; if it stays, the lidar is broken",
            )

    def _scan(self, port: serial.Serial, identity: Identity) -> None:
        """Emit scans until `stop` is set. Raises UserError without scans, OSError on unplugging."""
        decoder, delay = self._decoder, self._config.delay_s
        port.write(commands.SCAN)
        pace = self._health.pace
        pace.heard()
        asked = checked = self._clock()
        before = dict(decoder.counts)
        began = packets = before["packets"]
        liveness = Liveness(self._config)
        while not self._stop.is_set():
            data, now = self._read(port)
            for scan in decoder.feed(data, now):
                liveness.add(scan, decoder.motor_hz)
                self._emit(delayed(scan, delay))
            came = packets > began
            if decoder.counts["packets"] > packets:
                packets = decoder.counts["packets"]
                pace.heard()
            elif pace.silent_s > (_SILENCE_S if came else _SPIN_UP_S):
                skipped = decoder.counts["bytes_skipped"] > before["bytes_skipped"]
                reason = why_silent(self._recent if skipped else b"", came, identity)
                if pace.silent_s > _GIVE_UP_S:
                    raise reason
                self._report(False, str(reason))
                if now - asked > _SCAN_AGAIN_S:  # a dip of its supply makes a lidar forget it
                    port.write(commands.SCAN)
                    asked = now
                continue
            if came and now - checked >= _HEALTH_PERIOD_S:
                self._report(*self._judge(before, identity, liveness, now))
                checked, before = now, dict(decoder.counts)

    def _judge(
        self, before: dict[str, int], identity: Identity, liveness: Liveness, now: float
    ) -> tuple[bool, str]:
        """Whether the last second of samples was good, and in words."""
        counts = self._decoder.counts
        change = {name: count - before[name] for name, count in counts.items()}
        fault = liveness.fault(now, counts["points"])
        fault = damage(change, self._recent) or fault
        if fault is not None:
            return False, str(fault)
        rate_hz = self._decoder.speed_hz or self._decoder.motor_hz
        return True, in_words(change, rate_hz, identity, self._motor_switch)

    def _report_failure(self, error: UserError) -> None:
        self._report(False, str(error), certain=True)

    def _report(self, ok: bool, reason: str, certain: bool = False) -> None:
        """Emit Health at a change of state and once per second."""
        counts = self._decoder.counts
        self._health.report(
            self._emit,
            ok,
            reason,
            lambda: {**counts, "connections": self._connections},
            certain,
        )


class X4Pro(X4):
    """The X4 Pro: the same packets, but it answers no command and sends as soon as it has power."""

    def _identify(self, port: serial.Serial) -> Identity:
        """It cannot be asked."""
        return Identity(one_way=True, info=None)
