"""The robot's computer as a device: does it have time, power and coolness to go on?"""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from host.drivers.health import HealthReporter
from host.errors import UserError
from host.messages import Message

COMPUTER = "computer"
_PERIOD_S = 1.0
_BUSY = 0.9  # share of all processors; the localizer then waits for its turn
_WINDOW = 5  # periods over which they are judged
_WARM_C, _HOT_C = 75.0, 90.0  # boards throttle from 80 to 95 deg C
_COLDEST_C, _HOTTEST_C = -40.0, 125.0  # zones without a sensor say -273, 127 or 255 deg C
_LOW_CHARGE, _EMPTY_CHARGE = 20, 5  # per cent
# Bits of the Raspberry Pi's firmware: what is wrong now, and has been since it started.
_UNDERVOLTED, _THROTTLED = 0x1, 0xE
_THROTTLING = Path("devices/platform/soc/soc:firmware/get_throttled")
_COLDER = "give it air, a heat sink or a fan"


@dataclass(frozen=True, slots=True)
class Readings:
    """What the kernel says of a computer at a time; None where it does not say.

    busy, total: processor time since it started, in ticks. celsius: of the hottest place.
    throttled: the Raspberry Pi's bits. charge: of a battery, per cent.
    """

    busy: int
    total: int
    celsius: float | None
    throttled: int | None
    charge: int | None


def read(system: Path = Path("/sys"), processes: Path = Path("/proc")) -> Readings:
    """Read them."""
    ticks = [int(word) for word in _text(processes / "stat").split("\n")[0].split()[1:9]] or [0] * 8
    idle = ticks[3] + ticks[4]  # idle and waiting for a disk
    zones = (_number(path) for path in system.glob("class/thermal/thermal_zone*/temp"))
    known = [number / 1000.0 for number in zones if number is not None]
    possible = [celsius for celsius in known if _COLDEST_C < celsius < _HOTTEST_C]
    return Readings(
        busy=sum(ticks) - idle,
        total=sum(ticks),
        celsius=max(possible, default=None),
        throttled=_number(system / _THROTTLING, 16),
        charge=_charge(system),
    )


def _charge(system: Path) -> int | None:
    """Of the emptiest battery that supplies this computer."""
    batteries = [
        supply
        for supply in system.glob("class/power_supply/*")
        if _text(supply / "type") == "Battery" and _text(supply / "scope") != "Device"
    ]
    charges = (_number(battery / "capacity") for battery in batteries)
    return min((charge for charge in charges if charge is not None), default=None)


def _text(path: Path) -> str:
    try:
        return path.read_text("utf-8", "replace").strip()
    except OSError:
        return ""


def _number(path: Path, base: int = 10) -> int | None:
    try:
        return int(_text(path), base)
    except ValueError:
        return None


def fault(now: Readings) -> UserError | None:
    """What ends a run soon, None where nothing does."""
    if now.celsius is not None and now.celsius >= _HOT_C:
        return UserError(f"it is {now.celsius:.0f} °C hot", "it slows down, or stops", _COLDER)
    if now.charge is not None and now.charge <= _EMPTY_CHARGE:
        return UserError(f"its battery has {now.charge} % left", "", "charge it")
    return None


def remarks(now: Readings, busy: float) -> list[str]:
    """What is not good, each with what to do. busy: share of the processors in the last seconds."""
    found = []
    if busy > _BUSY:
        found.append(
            f"{100 * busy:.0f} % of the processors' time is used: close other programs, or use "
            "fewer or smaller pictures (rate_hz, width_px)"
        )
    if now.throttled and now.throttled & _UNDERVOLTED:
        found.append("its supply is too low: give it 5.1 V by a short, thick cable")
    if now.throttled and now.throttled & _THROTTLED:
        found.append(f"its processors are slowed down: {_COLDER}")
    elif now.celsius is not None and now.celsius >= _WARM_C:
        found.append(f"it is {now.celsius:.0f} °C warm and slows down soon: {_COLDER}")
    if now.charge is not None and now.charge <= _LOW_CHARGE:
        found.append(f"its battery has {now.charge} % left: charge it")
    return found


class Computer:
    """`run` it in a thread. look: reads it, `read` by default."""

    def __init__(
        self,
        clock: Callable[[], float] = time.monotonic,
        look: Callable[[], Readings] = read,
    ) -> None:
        self._look = look
        self._health = HealthReporter(COMPUTER, clock, _PERIOD_S)

    def run(self, emit: Callable[[Message], None], stop: threading.Event) -> None:
        """Emit Health once per second until `stop` is set."""
        past: list[Readings] = []
        while not stop.is_set():
            now = self._look()
            past = [*past, now][-_WINDOW - 1 :]
            busy = (now.busy - past[0].busy) / max(1, now.total - past[0].total)
            wrong = fault(now)
            words = "; ".join([_in_words(now, busy), *remarks(now, busy)])
            self._health.report(emit, wrong is None, str(wrong or words), dict)
            stop.wait(_PERIOD_S)


def _in_words(now: Readings, busy: float) -> str:
    words = [f"processors {100 * busy:.0f} % busy"]
    if now.celsius is not None:
        words.append(f"{now.celsius:.0f} °C")
    if now.charge is not None:
        words.append(f"battery {now.charge} %")
    return ", ".join(words)
