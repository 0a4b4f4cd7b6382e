"""What the kernel says of a computer, read from a copy of its files."""

from pathlib import Path

import pytest

from host.drivers.computer import Readings, fault, read, remarks


def write(folder: Path, name: str, text: str) -> None:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


@pytest.fixture
def system(tmp_path: Path) -> Path:
    write(tmp_path, "proc/stat", "cpu  10 1 20 300 40 5 6 7 0 0\ncpu0 10 1 20 300 40 5 6 7 0 0\n")
    write(tmp_path, "class/thermal/thermal_zone0/temp", "48312\n")
    return tmp_path


def test_times_and_the_hottest_place_are_read(system: Path) -> None:
    write(system, "class/thermal/thermal_zone1/temp", "61000\n")
    assert read(system, system / "proc") == Readings(49, 389, 61.0, None, None)


@pytest.mark.parametrize("milli_celsius", ["255000", "127000", "-273150", "nan", ""])
def test_a_zone_without_a_sensor_is_no_hot_computer(system: Path, milli_celsius: str) -> None:
    write(system, "class/thermal/thermal_zone1/temp", milli_celsius)
    now = read(system, system / "proc")
    assert now.celsius == 48.312
    assert fault(now) is None
    assert remarks(now, 0.1) == []


def test_a_hot_one_with_an_empty_battery_and_a_weak_supply_says_so(system: Path) -> None:
    write(system, "class/thermal/thermal_zone0/temp", "91000")
    write(system, "devices/platform/soc/soc:firmware/get_throttled", "50005\n")
    for name, kind, charge in (("BAT0", "Battery", "4"), ("AC", "Mains", "0")):
        write(system, f"class/power_supply/{name}/type", kind)
        write(system, f"class/power_supply/{name}/capacity", charge)
    now = read(system, system / "proc")
    assert (now.throttled, now.charge) == (0x50005, 4)
    assert "91 °C hot" in str(fault(now))
    words = "; ".join(remarks(now, 0.95))
    for said in ("95 % of the processors' time", "supply is too low", "slowed down", "4 % left"):
        assert said in words


def test_a_computer_that_says_nothing_is_not_busy(tmp_path: Path) -> None:
    assert read(tmp_path, tmp_path) == Readings(0, 0, None, None, None)
