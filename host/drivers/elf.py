"""What an AVR's ELF holds: the sizes of its sections and its symbols. Reads the file alone."""

import struct
from pathlib import Path
from typing import NamedTuple

from host.errors import UserError

# ELF32, little-endian. Of the header: the offset of the section table; entry size, count and the
# section of names. Of a section: name, type, address, offset, size, link. Of a symbol: name, value,
# size, info, section.
_HEADER = struct.Struct("<32xI10xHHH")
_SECTION = struct.Struct("<II4xIIII12x")
_SYMBOL = struct.Struct("<IIIBxH")
_MAGIC = b"\x7fELF\x01\x01"
_SYMBOL_TABLE = 2
_FILE, _SECTION_ITSELF = 4, 3  # kinds of symbols that name no address
_DATA, _DATA_END = 0x800000, 0x810000  # where the linker has RAM; above it the EEPROM


class _Section(NamedTuple):
    name: int
    type: int
    address: int
    offset: int
    size: int
    link: int


def section_sizes(elf: Path) -> dict[str, int]:
    """Bytes by section (".text", ".data", ...). Raises UserError where the file is no such ELF."""
    data, sections, names = _read(elf)
    return {_text(data, names.offset + one.name): one.size for one in sections}


def symbols(elf: Path) -> dict[str, int]:
    """Addresses in bytes by symbol: in flash of code, in RAM of data; EEPROM's are left out.

    Names are the linker's: those of C++ are mangled. Raises UserError where the file is no ELF of
    an AVR.
    """
    data, sections, _ = _read(elf)
    found = {}
    for table in (one for one in sections if one.type == _SYMBOL_TABLE):
        names = sections[table.link].offset
        entries = data[table.offset : table.offset + table.size]
        for name, value, _, info, section in _SYMBOL.iter_unpack(entries):
            kind = info & 0xF
            if section and kind not in (_FILE, _SECTION_ITSELF) and value < _DATA_END:
                found[_text(data, names + name)] = value % _DATA
    return found


def _read(elf: Path) -> tuple[bytes, list[_Section], _Section]:
    """The file, its sections, and the one that holds their names."""
    try:
        data = elf.read_bytes()
        table, size, count, names = _HEADER.unpack_from(data)
        sections = [
            _Section(*_SECTION.unpack_from(data, table + size * number)) for number in range(count)
        ]
        if data.startswith(_MAGIC):
            return data, sections, sections[names]
    except (OSError, struct.error, IndexError) as error:
        raise UserError(f"cannot read {elf}", str(error), "build the firmware again") from error
    raise UserError(f"cannot read {elf}", "it is no 32-bit ELF", "build the firmware again")


def _text(data: bytes, start: int) -> str:
    return data[start : data.index(b"\0", start)].decode()
