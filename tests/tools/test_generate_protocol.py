"""The definition of the board's frames: strict, and both languages agree on every byte."""

import importlib.util
import re
import shutil
import struct
import subprocess
from pathlib import Path

import pytest

from host.drivers.romeo import protocol as romeo_protocol
from host.errors import UserError

ROOT = Path(__file__).resolve().parents[2]
SPEC = importlib.util.spec_from_file_location(
    "generate_protocol", ROOT / "tools/generate_protocol.py"
)
assert SPEC is not None
assert SPEC.loader is not None
generator = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(generator)

DEFINITION = generator.DEFINITION.read_text(encoding="utf-8")
MINIMAL = """
[constants]
[frames.hello]
id = 1
direction = "host to board"
meaning = "hello"
fields = []
[frames.identity]
id = 2
direction = "board to host"
meaning = "answer"
fields = [{ name = "protocol_hash", type = "u32", unit = "1", meaning = "hash" }]
"""
FIELD = '{{ name = "{name}", type = "{type}", unit = "{unit}", meaning = "m" }}'


def frame(*fields: str, number: int = 3, more: str = "") -> str:
    return (
        f'[frames.probe]\nid = {number}\ndirection = "both ways"\nmeaning = "m"\n'
        f"fields = [{', '.join(fields)}]\n{more}"
    )


def field(name: str = "x", kind: str = "u8", unit: str = "1") -> str:
    return FIELD.format(name=name, type=kind, unit=unit)


def test_the_generated_files_are_those_of_the_definition(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert generator.main(["--check"]) == 0, capsys.readouterr().out


def test_stale_files_are_told_and_rewritten(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(generator, "ROOT", tmp_path)
    monkeypatch.setattr(generator, "C_HEADER", tmp_path / "include/protocol.h")
    monkeypatch.setattr(generator, "PYTHON_MODULE", tmp_path / "protocol.py")
    assert generator.main(["--check"]) == 1
    assert "protocol.h is stale" in capsys.readouterr().out
    assert not (tmp_path / "protocol.py").exists()
    assert generator.main([]) == 0
    assert generator.main(["--check"]) == 0


@pytest.mark.parametrize(
    ("addition", "complaint"),
    [
        ("[frames.hello\n", "not valid TOML"),
        ("[extra]\n", "extra: extra inputs"),
        (frame(field(kind="f64")), "frames.probe.fields.0.type"),
        (frame(field(unit="furlong")), "frames.probe.fields.0.unit"),
        (frame(field(name="Not a name")), "frames.probe.fields.0.name"),
        (frame(field(name="class")), "class is reserved"),
        (frame(field(name="id")), "id is reserved"),
        (frame(field(), field()), "two are called x"),
        (frame(number=0), "frames.probe.id"),
        (frame(number=256), "frames.probe.id"),
        (frame(number=2), "0x02 is taken by identity"),
        (frame(more="colour = 1\n"), "frames.probe.colour"),
        (frame(*(field(f"x{k}", "u32") for k in range(15))), "61 bytes"),
        (frame(field(unit="bits")), "x needs both unit bits and its table"),
        (frame(field(), more='bits.x.a = "m"\n'), "x needs both unit bits and its table"),
        (frame(field(unit="bits", kind="i8"), more='bits.x.a = "m"\n'), "unsigned"),
        (frame(more='bits.x.a = "m"\n'), "bits.x: no such field"),
        (
            frame(field(unit="bits"), more="".join(f'bits.x.b{k} = "m"\n' for k in range(9))),
            "9 bits in a u8",
        ),
        ('[constants.y]\nvalue = 1\nunit = "1"\nmeaning = "ends */ here"\n', "constants.y.meaning"),
        ('[constants.y]\nvalue = 1.5\nunit = "1"\nmeaning = "m"\n', "constants.y.value"),
    ],
)
def test_a_mistake_in_the_definition_is_named(addition: str, complaint: str) -> None:
    with pytest.raises(UserError) as caught:
        generator.parse(MINIMAL + addition)
    assert complaint in str(caught.value)


def test_the_frames_of_the_greeting_cannot_be_left_out_or_changed() -> None:
    with pytest.raises(UserError, match="first field must be protocol_hash"):
        generator.parse(MINIMAL.replace('"u32"', '"u16"'))
    with pytest.raises(UserError, match=r"frames\.hello: missing"):
        generator.parse(MINIMAL.replace("[frames.hello]", "[frames.halloo]"))


@pytest.mark.parametrize(
    ("before", "after", "same"),
    [
        ("Who are you?", "Who is there?", True),
        ("id = 0x10", "id = 0x12", False),
        ('"report_rate_hz", type = "u8"', '"report_rate_hz", type = "u16"', False),
        ('type = "u32", unit = "us"', 'type = "u32", unit = "ms"', False),
        ("value = 300", "value = 301", False),
        ('\nfresh = "', '\nnew = "', False),
    ],
)
def test_the_hash_follows_the_meaning_of_bytes_and_not_the_prose(
    before: str, after: str, same: bool
) -> None:
    assert before in DEFINITION
    changed = generator.parse(DEFINITION.replace(before, after)).hash
    assert (changed == romeo_protocol.PROTOCOL_HASH) == same


def edge_values(layout: struct.Struct, which: int) -> list[int]:
    """The smallest, the largest, or a value with all bytes different, for every field."""
    values = []
    for code in layout.format[2:]:
        size = struct.calcsize("<" + code)
        signed = code.islower()
        low = -(1 << (8 * size - 1)) + 1 if signed else 0
        high = (1 << (8 * size - 1)) - 1 if signed else (1 << (8 * size)) - 1
        values.append((low, high, int.from_bytes(b"\x12\x34\x56\x78"[:size], "big"))[which])
    return values


@pytest.mark.parametrize(
    ("compiler", "language"),
    [("gcc", ["-x", "c", "-std=c11"]), ("g++", ["-x", "c++", "-std=gnu++14"])],
)
def test_c_structs_hold_the_bytes_that_python_packs(
    compiler: str, language: list[str], tmp_path: Path
) -> None:
    if shutil.which(compiler) is None:
        pytest.skip(f"no {compiler} on this machine")
    expected, statements = [], []
    for kind in romeo_protocol.FRAMES.values():
        name = re.sub(r"(?<!^)([A-Z])", r"_\1", kind.__name__).lower()
        for which in range(3):
            values = edge_values(kind.LAYOUT, which)
            expected.append(kind.LAYOUT.pack(kind.ID, *values).hex())
            macro = name.removesuffix("_frame").upper() + "_ID"
            initial = ", ".join([macro, *(str(value) for value in values)])
            statements.append(f"{{ struct {name} f = {{{initial}}}; show(&f, sizeof f); }}")
    expected.append(
        f"{romeo_protocol.PROTOCOL_HASH} {romeo_protocol.LARGEST_ENCODED} "
        f"{romeo_protocol.COMMAND_TIMEOUT_MS} {romeo_protocol.DisplacementStatus.FRESH.value}"
    )
    source = tmp_path / "show.c"
    source.write_text(
        '#include "protocol.h"\n#include <stdio.h>\n'
        "static void show(const void *data, unsigned long size) {\n"
        "    const unsigned char *bytes = (const unsigned char *)data;\n"
        '    for (unsigned long i = 0; i < size; i++) printf("%02x", bytes[i]);\n'
        '    printf("\\n");\n}\n'
        "int main(void) {\n    " + "\n    ".join(statements) + "\n"
        '    printf("%lu %d %d %d\\n", (unsigned long)PROTOCOL_HASH, PROTOCOL_LARGEST_ENCODED,\n'
        "        PROTOCOL_COMMAND_TIMEOUT_MS, DISPLACEMENT_STATUS_FRESH);\n    return 0;\n}\n"
    )
    program = tmp_path / "show"
    include = generator.C_HEADER.parent
    subprocess.run(
        [compiler, *language, "-Wall", "-Wextra", "-Werror", f"-I{include}", source, "-o", program],
        check=True,
    )
    shown = subprocess.run([program], check=True, capture_output=True, text=True).stdout.split("\n")
    assert shown[:-1] == expected
