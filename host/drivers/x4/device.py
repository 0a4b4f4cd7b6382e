"""The YDLidar X4 on a serial port: motor, questions, scans, and words for why there is no data."""

import errno
import math
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import serial

from host.config import Lidar
from host.drivers.reconnect import keep_connected
from host.drivers.serial_port import find_port, open_port, read_available
from host.drivers.x4 import commands
from host.drivers.x4.commands import DeviceHealth, DeviceInfo
from host.drivers.x4.packets import BAUDRATE
from host.drivers.x4.protocol import ScanDecoder
from host.errors import UserError
from host.messages import Health, Message

USB_IDS = ((0x10C4, 0xEA60),)  # the CP2102 on the X4's adapter board
LIDAR = "lidar"
_REPLY_WAIT_S = 1.0
_SPIN_UP_S = 3.0
_SILENCE_S = 1.0
_HEALTH_PERIOD_S = 1.0
_DAMAGED_SHARE = 0.1

ReplyKind = TypeVar("ReplyKind", DeviceInfo, DeviceHealth)


class X4:
    """The lidar of one robot. config: its [lidar] section; clock: host time in s.

    `run` is meant for a thread of its own. The motor turns while it runs.
    """

    def __init__(self, config: Lidar, clock: Callable[[], float] = time.monotonic) -> None:
        self._config = config
        self._clock = clock
        self._decoder = ScanDecoder()
        self._emit: Callable[[Message], None] = lambda message: None
        self._stop = threading.Event()
        self._connections = 0
        self._motor_switch = True  # whether the port can switch the motor
        self._state: tuple[bool, str] | None = None
        self._next_health = 0.0

    def run(self, emit: Callable[[Message], None], stop: threading.Event) -> None:
        """Emit a Scan a turn and a Health a second and a change of state, until `stop` is set.

        Failures of the device are told as Health and tried again; it raises only what is the
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
            self._stop.wait(0.1)
            self._motor_switch = self._switch_motor(port, on=True)
            port.write(commands.STOP)  # what may still run from before
            self._drain(port)
            skipped = self._decoder.counts["bytes_skipped"]
            info = self._ask(port, (commands.INFO,), DeviceInfo)
            health = self._ask(port, (commands.HEALTH, commands.HEALTH_OF_SDK), DeviceHealth)
            noise = self._decoder.counts["bytes_skipped"] > skipped
            self._check_answers(info, health, noise)
            port.write(commands.SCAN)
            self._scan(port, info)
        finally:
            self._leave(port)

    def _switch_motor(self, port: serial.Serial, on: bool) -> bool:
        """Start or stop the motor by DTR. False on ports without that line (pseudo-terminals)."""
        try:
            port.dtr = on
        except OSError as error:
            if error.errno in (errno.ENOTTY, errno.EINVAL):
                return False
            raise
        return True

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
            end = self._clock() + _REPLY_WAIT_S
            while self._clock() < end and not self._stop.is_set():
                self._decoder.feed(read_available(port), self._clock())
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
                raise UserError(
                    "the lidar's bytes make no sense",
                    f"something answers, but not as a YDLidar X4 does at {BAUDRATE} baud",
                    "check that the port is the lidar's and the model an X4",
                )
            raise UserError(
                "the lidar does not answer",
                "it has no power, its cable to the adapter is loose, or the port is another's",
                "check both USB leads of the adapter board and port in [lidar] of robot.toml",
            )
        if health is not None and health.status == 2:
            raise UserError(
                "the lidar reports a fault",
                f"its error code is {health.error:#06x}",
                "unplug both USB leads for some seconds; if it stays, the lidar is broken",
            )

    def _scan(self, port: serial.Serial, info: DeviceInfo | None) -> None:
        """Emit scans until `stop` is set. Raises UserError without scans, OSError on unplugging."""
        counts = self._decoder.counts
        started = last = self._clock()
        checked = -math.inf
        before = dict(counts)
        packets = counts["packets"]
        while not self._stop.is_set():
            data = read_available(port)
            now = self._clock()
            for scan in self._decoder.feed(data, now):
                delay = self._config.delay_s
                self._emit(replace(scan, time=scan.time - delay, times=scan.times - delay))
            if counts["packets"] > packets:
                packets, last = counts["packets"], now
            elif now - last > (_SPIN_UP_S if last == started else _SILENCE_S):
                raise self._why_silent(before, samples_came=last != started)
            if last != started and now - checked >= _HEALTH_PERIOD_S:
                self._report(*self._judge(before, info))
                checked, before = now, dict(counts)

    def _why_silent(self, before: dict[str, int], samples_came: bool) -> UserError:
        counts = self._decoder.counts
        if counts["bytes_skipped"] > before["bytes_skipped"]:
            return UserError(
                "the lidar sends only damaged packets",
                "the cable is poor, the supply too weak, or another program reads the same port",
                "use a short cable and a supply of 1 A or more; sudo fuser -v PORT names programs",
            )
        if samples_came:
            return UserError(
                "the lidar stopped sending",
                "its motor stands still or its supply failed",
                "check that it turns freely and has 1 A or more at the POWER lead",
            )
        return UserError(
            "the lidar answers but sends no samples",
            "its motor does not turn: it is powered by a lead of its own",
            "connect the second USB lead (POWER, USB_PWR) to a supply of 1 A or more",
        )

    def _judge(self, before: dict[str, int], info: DeviceInfo | None) -> tuple[bool, str]:
        """Whether the last second of samples was good, and in words."""
        change = {name: count - before[name] for name, count in self._decoder.counts.items()}
        bad = change["checksum_errors"] + change["implausible_packets"]
        share = bad / max(1, bad + change["packets"])
        if share > _DAMAGED_SHARE:
            return False, (
                f"{100 * share:.0f} % of the packets are damaged: use a short cable and a supply "
                "of 1 A or more, and close other programs on the port"
            )
        rate_hz = self._decoder.speed_hz
        words = [f"scanning at {rate_hz:.1f} turns/s" if rate_hz else "scanning"]
        if info is not None:
            words.append(f"firmware {info.firmware}")
        if not self._motor_switch:
            words.append("motor stays on")
        elif info is not None:  # both would not fit on a line of the screen
            words.append(f"serial {info.serial}")
        return True, ", ".join(words)

    def _report_failure(self, error: UserError) -> None:
        self._report(False, str(error))

    def _report(self, ok: bool, reason: str) -> None:
        """Emit Health at a change of state and once a second."""
        now = self._clock()
        if self._state == (ok, reason) and now < self._next_health:
            return
        self._state, self._next_health = (ok, reason), now + 0.9 * _HEALTH_PERIOD_S
        counts = {**self._decoder.counts, "connections": self._connections}
        self._emit(Health(now, LIDAR, ok, reason, counts))
