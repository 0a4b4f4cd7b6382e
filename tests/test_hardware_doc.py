"""docs/hardware.md and its drawing say what firmware, configuration and commands say."""

import ast
import math
import os
import re
import tomllib
import xml.etree.ElementTree as ET
from pathlib import Path

import click
import pytest

from host.cli.main import main
from host.config import Board, Lidar, Motors, RobotConfig, Wheels
from host.drivers import udev
from host.drivers.romeo import ports as romeo_ports
from host.drivers.x4 import device as x4

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs/hardware.md").read_text(encoding="utf-8")
DRAWING = ROOT / "docs/wiring.svg"
WIRING = (ROOT / "firmware/romeo_odometry/include/wiring.h").read_text(encoding="utf-8")
CORE = Path("/usr/share/arduino/hardware/arduino/avr/variants/leonardo/pins_arduino.h")
EDGES = (2, 4)


def wiring(edges: int) -> dict[str, str]:
    """wiring.h for one value of ENCODER_EDGES: what ("left encoder a") to pin ("D2")."""
    choices = re.search(
        r"#if ENCODER_EDGES == 2\n(.*?)#elif ENCODER_EDGES == 4\n(.*?)#else.*?#endif(.*)",
        WIRING,
        re.DOTALL,
    )
    assert choices is not None
    text = choices[1 if edges == 2 else 2] + choices[3]
    return {
        name.replace("_", " ").lower(): f"D{pin}"
        for name, pin in re.findall(r"(\w+)_PIN = (\d+);", text)
    }


def table() -> dict[str, list[str]]:
    """The pin table: pin to chip, use at 2x, use at 4x, why."""
    rows = re.findall(r"^\| ([DA]\d+) \| (.*) \|$", PAGE, re.MULTILINE)
    return {pin: [cell.strip() for cell in cells.split("|")] for pin, cells in rows}


@pytest.mark.parametrize("edges", EDGES)
def test_the_pin_table_is_the_firmwares(edges: int) -> None:
    used = {
        cells[EDGES.index(edges) + 1].lower(): pin
        for pin, cells in table().items()
        if cells[EDGES.index(edges) + 1] != "free"
    }
    assert used == wiring(edges)
    assert set(table()) >= {f"D{n}" for n in range(14)} | {"A0"}


def test_the_chips_pins_are_the_arduino_cores() -> None:
    if not CORE.exists():
        why = f"{CORE} is not installed (Debian: arduino-core-avr)"
        pytest.fail(why) if os.environ.get("CI") == "true" else pytest.skip(why)
    core = CORE.read_text(encoding="utf-8")
    for pin, (chip, *_) in table().items():
        comment = re.search(rf"^// {pin}#?\s.*$", core, re.MULTILINE)
        assert comment is not None or pin.startswith("A")
        # The arrays of ports and bits name both: `PD, // D0 - PD2`.
        assert re.search(rf"// (D\d+ - )?{pin} - {chip.split(',')[0]}\n", core), pin
        for function in chip.split(", ")[1:]:
            assert comment is not None
            assert re.search(rf"\b{function}\b", comment[0]), (pin, function)


def test_the_drawing_has_the_firmwares_pins() -> None:
    drawn = {element.get("id"): "".join(element.itertext()) for element in ET.parse(DRAWING).iter()}
    two, four = wiring(2), wiring(4)
    for what, pin in two.items():
        other = "" if four[what] == pin else f" (4x: {four[what]})"
        assert drawn[what.replace(" ", "-")] == pin + other
    free = re.findall(r"[DA]\d+", drawn["free"])
    in_table = [pin for pin, cells in table().items() if cells[1] == "free" and pin != "A1"]
    assert sorted(free) == sorted([*in_table, "A5"])


def test_the_settings_named_exist() -> None:
    known = {
        *Motors.model_fields,
        *Board.model_fields,
        *Wheels.model_fields,
        *Lidar.model_fields,
        *RobotConfig.model_fields,
    }
    tables = set(re.findall(r"`\[(\w+)\]`", PAGE))
    assert {"wheels", "motors", "board", "lidar"} == tables <= set(RobotConfig.model_fields)
    settings = set(re.findall(r"`([a-z0-9]+(?:_[a-z0-9]+)+)(?: = [^`]+)?`", PAGE))
    settings |= {name for name in Motors.model_fields if f"`{name}`" in PAGE}
    assert settings <= known, settings - known
    assert set(Motors.model_fields) <= settings
    sample = tomllib.loads((ROOT / "robots/cherokey.toml").read_text(encoding="utf-8"))
    assert set(Motors.model_fields) <= set(sample["motors"])


def test_commands_options_and_files_exist() -> None:
    for command, options in re.findall(r"`swarmloc (\w+)([^`]*)`", PAGE):
        parameters = main.get_command(click.Context(main), command).params
        known = {option for parameter in parameters for option in parameter.opts}
        assert set(re.findall(r"--\w+", options)) <= known, command
    files = re.findall(r"(?:tools|robots|firmware)/[\w./]+\w", PAGE)
    assert {"tools/try_wheels.py", "robots/cherokey.toml"} <= set(files)
    assert [name for name in files if not (ROOT / name).exists()] == []


def test_messages_quoted_are_the_programs() -> None:
    spoken = [
        node.value
        for file in (ROOT / "host").rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]
    checklist = " ".join(PAGE[PAGE.index("## First power-up") : PAGE.index("## Sources")].split())
    quoted = re.findall(r'"([^"]+)"', checklist)
    assert len(quoted) >= 4
    assert [text for text in quoted if not any(text in said for said in spoken)] == []


def test_usb_ids_and_rules_are_the_drivers() -> None:
    board = {*romeo_ports.SKETCH_IDS, *romeo_ports.BOOTLOADER_IDS}
    lidar = set(x4.USB_IDS)
    named = set(re.findall(r"\b[0-9a-f]{4}:[0-9a-f]{4}\b", PAGE))
    in_words = {f"{vendor:04x}:{product:04x}" for vendor, product in board | lidar}
    assert {"2341:8036", "2341:0036", "10c4:ea60"} == named <= in_words
    rules = re.findall(r'idVendor}=="([\w|]+)", ATTRS{idProduct}=="([\w|]+)"', udev.RULES)
    ruled = {
        (int(vendor, 16), int(product, 16))
        for vendors, products in rules
        for vendor in vendors.split("|")
        for product in products.split("|")
    }
    assert ruled == board | lidar
    assert "0666" not in udev.RULES
    for line in udev.PASTE.splitlines()[1:]:
        assert line.strip() in PAGE


def test_figures_follow_from_the_defaults() -> None:
    wheels = Wheels()
    text = " ".join(PAGE.split())
    turn_m = math.tau * wheels.left_radius_m
    for edges, rpm_6v, rpm_7v5 in ((1, "5,120", "6,400"), (2, "10,240", "12,800")):
        counts = wheels.counts_per_turn * edges
        assert f"| {counts} |" in text
        assert f"{1e3 * turn_m / counts:.3f} mm" in text
        assert (f"{160 * counts / 60:,.0f}", f"{200 * counts / 60:,.0f}") == (rpm_6v, rpm_7v5)
        assert rpm_6v in text
        assert rpm_7v5 in text
    assert f"grows by {math.degrees(turn_m / wheels.track_m):.0f} degrees" in text
    assert Motors().full_speed_mps == pytest.approx(160 / 60 * turn_m, abs=0.01)
