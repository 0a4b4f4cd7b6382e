"""protocol.toml → include/protocol.h and host/drivers/romeo/protocol.py.

`python tools/generate_protocol.py` writes both; with --check it writes nothing and fails when
they are not what it would write. The host's module gets the firmware's version, from
include/version.h: it is not part of the hash, so an older version may speak the same protocol.
"""

import argparse
import hashlib
import json
import keyword
import re
import sys
import textwrap
import tomllib
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError

from host.errors import UserError

ROOT = Path(__file__).resolve().parent.parent
DEFINITION = ROOT / "firmware/romeo_odometry/protocol.toml"
VERSION_HEADER = ROOT / "firmware/romeo_odometry/include/version.h"
C_HEADER = ROOT / "firmware/romeo_odometry/include/protocol.h"
PYTHON_MODULE = ROOT / "host/drivers/romeo/protocol.py"

NOTICE = "Written by tools/generate_protocol.py from firmware/romeo_odometry/protocol.toml."
# One USB packet of the ATmega32U4 holds 64 bytes: id, fields, CRC, one COBS byte, the delimiter.
LARGEST_FRAME = 60


class Scalar(NamedTuple):
    """A number type: its name in C, its code in Python's struct, its size in bytes."""

    c: str
    code: str
    size: int


SCALARS = {
    "u8": Scalar("uint8_t", "B", 1),
    "u16": Scalar("uint16_t", "H", 2),
    "u32": Scalar("uint32_t", "I", 4),
    "i8": Scalar("int8_t", "b", 1),
    "i16": Scalar("int16_t", "h", 2),
    "i32": Scalar("int32_t", "i", 4),
}
UNSIGNED = ("u8", "u16", "u32")

Name = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9]*(_[a-z0-9]+)*$")]
# Prose ends up inside C comments and Python docstrings: printable ASCII that can end neither.
Prose = Annotated[str, StringConstraints(min_length=1, pattern=r"^[ !#-)+-\[\]-~]+$")]
Unit = Literal[
    "1",
    "1/16",
    "1/16 s",
    "bits",
    "edges",
    "frames",
    "Hz",
    "ms",
    "nm",
    "ticks",
    "ticks/s",
    "ticks/s2",
    "um",
    "urad",
    "us",
]
Direction = Literal["host to board", "board to host", "both ways"]
# Beside Python's own keywords: the member that every frame has already. A keyword of C alone shows
# when the header is compiled.
RESERVED = {*keyword.kwlist, "id"}


class Table(BaseModel):
    """A table of protocol.toml: unknown keys refused, no conversion between types."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Constant(Table):
    """A number both sides must agree on."""

    value: int = Field(ge=0, lt=2**32)
    unit: Unit
    meaning: Prose


class FrameField(Table):
    """One number of a frame."""

    name: Name
    type: Literal["u8", "u16", "u32", "i8", "i16", "i32"]
    unit: Unit
    meaning: Prose


class Frame(Table):
    """One kind of frame."""

    id: int = Field(ge=1, le=255)
    direction: Direction
    meaning: Prose
    fields: list[FrameField]
    bits: dict[Name, dict[Name, Prose]] = {}

    @property
    def size(self) -> int:
        """Bytes of id and fields."""
        return 1 + sum(SCALARS[field.type].size for field in self.fields)


class Protocol(Table):
    """All of protocol.toml."""

    constants: dict[Name, Constant]
    frames: dict[Name, Frame]

    @property
    def hash(self) -> int:
        """32 bits of SHA-256 over all that both sides must agree on: not the prose."""
        essence = {
            "constants": {name: [c.value, c.unit] for name, c in self.constants.items()},
            "frames": {
                name: [
                    frame.id,
                    frame.direction,
                    [[field.name, field.type, field.unit] for field in frame.fields],
                    {field: list(names) for field, names in frame.bits.items()},
                ]
                for name, frame in self.frames.items()
            },
        }
        text = json.dumps(essence, sort_keys=True, separators=(",", ":"))
        return int.from_bytes(hashlib.sha256(text.encode()).digest()[:4], "big")


def parse(text: str, name: str = "protocol.toml") -> Protocol:
    """Check the text of a protocol.toml. Raises UserError that names each wrong key and why."""
    try:
        protocol = Protocol.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise UserError(f"{name} is not valid TOML", str(error)) from error
    except ValidationError as error:
        problems = [
            ".".join(str(part) for part in detail["loc"]) + f": {detail['msg'].lower()}"
            for detail in error.errors()
        ]
    else:
        problems = _contradictions(protocol)
    if problems:
        raise UserError(f"{name}: {len(problems)} mistake(s)", "\n".join(problems))
    return protocol


def _contradictions(protocol: Protocol) -> list[str]:
    """What each key by itself cannot show."""
    problems = []
    owners: dict[int, str] = {}
    for name, frame in protocol.frames.items():
        where = f"frames.{name}"
        if frame.id in owners:
            problems.append(f"{where}.id: 0x{frame.id:02x} is taken by {owners[frame.id]}")
        owners.setdefault(frame.id, name)
        if frame.size > LARGEST_FRAME:
            problems.append(f"{where}: {frame.size} bytes; at most {LARGEST_FRAME} fit a packet")
        problems += _field_contradictions(where, frame)
    for name in ("hello", "identity"):
        if name not in protocol.frames:
            problems.append(f"frames.{name}: missing, and no host could greet the board without")
    identity = protocol.frames.get("identity")
    if identity and [(f.name, f.type) for f in identity.fields[:1]] != [("protocol_hash", "u32")]:
        problems.append("frames.identity: its first field must be protocol_hash, u32")
    return problems


def _field_contradictions(where: str, frame: Frame) -> list[str]:
    problems = []
    types: dict[str, str] = {}
    for field in frame.fields:
        if field.name in types:
            problems.append(f"{where}.fields: two are called {field.name}")
        if field.name in RESERVED:
            problems.append(f"{where}.fields: {field.name} is reserved")
        if (field.unit == "bits") != (field.name in frame.bits):
            problems.append(f"{where}.fields: {field.name} needs both unit bits and its table")
        types[field.name] = field.type
    for field_name, names in frame.bits.items():
        kind = types.get(field_name)
        if "all" in names:
            problems.append(f"{where}.bits.{field_name}: all is reserved for their sum")
        if kind is None:
            problems.append(f"{where}.bits.{field_name}: no such field")
        elif kind not in UNSIGNED:
            problems.append(f"{where}.bits.{field_name}: bits need an unsigned field")
        elif len(names) > 8 * SCALARS[kind].size:
            problems.append(f"{where}.bits.{field_name}: {len(names)} bits in a {kind}")
    return problems


def to_c(protocol: Protocol) -> str:
    """The header for the board: valid C11 and C++11."""
    frames = protocol.frames.items()
    largest = max(frame.size for _, frame in frames)
    lines = [
        f"/* {NOTICE} Do not edit. */",
        "#ifndef ROMEO_PROTOCOL_H",
        "#define ROMEO_PROTOCOL_H",
        "",
        "#include <assert.h>",
        "#include <stdint.h>",
        "",
        "#if __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__",
        '#error "frames are little-endian"',
        "#endif",
        "",
        f"#define PROTOCOL_HASH 0x{protocol.hash:08x}UL",
        "#define PROTOCOL_DELIMITER 0x00",
        "/* Largest id + fields, and the same with CRC, COBS byte and delimiter, in bytes. */",
        f"#define PROTOCOL_LARGEST_FRAME {largest}",
        f"#define PROTOCOL_LARGEST_ENCODED {largest + 4}",
        "",
    ]
    for name, constant in protocol.constants.items():
        suffix = "UL" if constant.value > 0x7FFF else ""
        lines += _c_comment(f"[{constant.unit}] {constant.meaning}")
        lines.append(f"#define PROTOCOL_{name.upper()} {constant.value}{suffix}")
    for name, frame in frames:
        lines += ["", *_c_frame(name, frame)]
    lines += ["", "#endif", ""]
    return "\n".join(lines)


def _c_frame(name: str, frame: Frame) -> list[str]:
    lines = _c_comment(f"{frame.direction.capitalize()}. {frame.meaning}")
    lines.append(f"#define {name.upper()}_ID 0x{frame.id:02x}")
    for field, names in frame.bits.items():
        for position, (bit, meaning) in enumerate(names.items()):
            lines += _c_comment(meaning)
            lines.append(f"#define {f'{name}_{field}_{bit}'.upper()} 0x{1 << position:02x}")
        lines.append(f"#define {f'{name}_{field}_all'.upper()} 0x{(1 << len(names)) - 1:02x}")
    lines.append(f"struct __attribute__((packed)) {name}_frame {{")
    lines.append(f"    uint8_t id; /* {name.upper()}_ID */")
    for member in frame.fields:
        lines += _c_comment(f"[{member.unit}] {member.meaning}", "    ")
        lines.append(f"    {SCALARS[member.type].c} {member.name};")
    lines.append("};")
    lines.append(
        f'static_assert(sizeof(struct {name}_frame) == {frame.size}, "{name}_frame is not packed");'
    )
    return lines


def _c_comment(text: str, indent: str = "") -> list[str]:
    lines = textwrap.wrap(text, 94, initial_indent=f"{indent}/* ", subsequent_indent=f"{indent} * ")
    lines[-1] += " */"
    return lines


def version(text: str) -> tuple[int, int, int]:
    """The firmware's version that a version.h defines. Raises UserError where it does not."""
    parts = dict(re.findall(r"^#define FIRMWARE_VERSION_(\w+) (\d+)$", text, re.MULTILINE))
    try:
        return int(parts["MAJOR"]), int(parts["MINOR"]), int(parts["PATCH"])
    except KeyError as missing:
        raise UserError(
            "version.h does not tell the firmware's version",
            f"it lacks FIRMWARE_VERSION_{missing.args[0]}",
            "define MAJOR, MINOR and PATCH in it",
        ) from missing


def to_python(protocol: Protocol, firmware: tuple[int, int, int]) -> str:
    """The module for the host. firmware: the version it belongs to."""
    largest = max(frame.size for frame in protocol.frames.values())
    lines = [
        '"""The board\'s frames as values: one frozen dataclass a frame.',
        "",
        f"{NOTICE}",
        "Do not edit; `framing` packs and unpacks them.",
        '"""',
        "",
        "from dataclasses import dataclass",
        *(["from enum import IntFlag"] if any(f.bits for f in protocol.frames.values()) else []),
        "from struct import Struct",
        "from typing import ClassVar",
        "",
        f"PROTOCOL_HASH = 0x{protocol.hash:08X}",
        "# Major, minor, patch of the firmware in this repository.",
        f"FIRMWARE_VERSION = {firmware}",
        "# Largest id + fields, and the same with CRC, COBS byte and delimiter, in bytes.",
        f"LARGEST_FRAME = {largest}",
        f"LARGEST_ENCODED = {largest + 4}",
        "",
    ]
    for name, constant in protocol.constants.items():
        lines += _wrap(f"[{constant.unit}] {constant.meaning}", "# ")
        lines.append(f"{name.upper()} = {constant.value}")
    for name, frame in protocol.frames.items():
        lines += _python_frame(name, frame)
    classes = [_class(name) for name in protocol.frames]
    union = f"Frame = {' | '.join(classes)}"
    if len(union) > 100:
        union = "Frame = (\n    " + "\n    | ".join(classes) + "\n)"
    lines += ["", "", union]
    lines.append("FRAMES: dict[int, type[Frame]] = {")
    lines += [f"    {name}.ID: {name}," for name in classes]
    lines += ["}", ""]
    return "\n".join(lines)


def _python_frame(name: str, frame: Frame) -> list[str]:
    lines = []
    for field, names in frame.bits.items():
        lines += ["", "", f"class {_class(name, field)}(IntFlag):"]
        lines += [f'    """Bits of `{_class(name)}.{field}`."""', ""]
        for position, (bit, meaning) in enumerate(names.items()):
            lines += _wrap(meaning, "    # ")
            lines.append(f"    {bit.upper()} = 0x{1 << position:02X}")
    lines += ["", "", "@dataclass(frozen=True, slots=True)", f"class {_class(name)}:"]
    lines += _wrap(f'"""{frame.direction.capitalize()}. {frame.meaning}', "    ")
    if frame.fields:
        lines.append("")
        for member in frame.fields:
            lines += _wrap(f"{member.name} [{member.unit}]: {member.meaning}.", "    ")
        lines.append('    """')
    else:
        lines[-1] += '"""'
    code = "<B" + "".join(SCALARS[member.type].code for member in frame.fields)
    lines += ["", f"    ID: ClassVar[int] = 0x{frame.id:02X}"]
    lines.append(f'    LAYOUT: ClassVar[Struct] = Struct("{code}")')
    if frame.fields:
        lines += ["", *(f"    {member.name}: int" for member in frame.fields)]
    return lines


def _class(*names: str) -> str:
    """displacement → DisplacementFrame; displacement, status → DisplacementStatus."""
    words = [word.capitalize() for name in names for word in name.split("_")]
    return "".join(words) + ("Frame" if len(names) == 1 else "")


def _wrap(text: str, indent: str) -> list[str]:
    return textwrap.wrap(text, 97, initial_indent=indent, subsequent_indent=indent)


def main(arguments: list[str] | None = None) -> int:
    """Write or check both files; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing; fail when stale")
    check = parser.parse_args(arguments).check
    try:
        protocol = parse(DEFINITION.read_text(encoding="utf-8"), DEFINITION.name)
        firmware = version(VERSION_HEADER.read_text(encoding="utf-8"))
    except UserError as error:
        print(error, file=sys.stderr)
        return 1
    stale = False
    for path, text in ((C_HEADER, to_c(protocol)), (PYTHON_MODULE, to_python(protocol, firmware))):
        if path.exists() and path.read_text(encoding="utf-8") == text:
            continue
        stale = True
        if check:
            print(f"{path.relative_to(ROOT)} is stale: run python tools/generate_protocol.py")
        else:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
            print(f"wrote {path.relative_to(ROOT)}")
    return 1 if stale and check else 0


if __name__ == "__main__":
    sys.exit(main())
