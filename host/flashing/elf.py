"""What an AVR's ELF holds: section sizes, symbols, what goes into flash. Reads the file alone."""

import struct
from pathlib import Path
from typing import NamedTuple

from host.errors import UserError

# ELF32, little-endian. Of the header: the offset of the section table; entry size, count and the
# section of names. Of a section: name, type, address, offset, size, link. Of a symbol: name, value,
# size, info, section. Of a segment: type, offset, virtual and physical address, size.
_HEADER = struct.Struct("<32xI10xHHH")
_SECTION = struct.Struct("<II4xIIII12x")
_SYMBOL = struct.Struct("<IIIBxH")
_SEGMENT = struct.Struct("<5I")
_AVR, _LOAD = 83, 1  # machine, and the type of a segment to load
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
    """Bytes by section (".text", ".data", ...). Raises UserError if the file is no such ELF."""
    data, sections, names = _read(elf)
    return {_text(data, names.offset + one.name): one.size for one in sections}


def symbols(elf: Path) -> dict[str, int]:
    """Addresses in bytes by symbol: in flash of code, in RAM of data; EEPROM's are left out.

    Names are the linker's: those of C++ are mangled. Raises UserError if the file is no ELF of
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


def flash_image(elf: Path) -> bytes:
    """What an AVR's ELF puts into flash, from address 0; gaps are erased (0xFF).

    Raises UserError if it is no such file.
    """
    try:
        data = elf.read_bytes()
        if not data.startswith(_MAGIC) or struct.unpack_from("<H", data, 18)[0] != _AVR:
            raise UserError(f"cannot simulate {elf}", "it is not an ELF file for an AVR", "")
        return _loaded(data)
    except (OSError, struct.error) as error:
        raise UserError(f"cannot simulate {elf}", str(error), "build the firmware") from error


def _loaded(data: bytes) -> bytes:
    """The segments to load, but for those with addresses in RAM."""
    (table,) = struct.unpack_from("<I", data, 28)
    entry_size, entries = struct.unpack_from("<HH", data, 42)
    image = bytearray()
    for entry in range(entries):
        kind, offset, _, address, size = _SEGMENT.unpack_from(data, table + entry * entry_size)
        if kind != _LOAD or address >= _DATA:
            continue
        image.extend(b"\xff" * (address + size - len(image)))
        image[address : address + size] = data[offset : offset + size]
    return bytes(image)


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
    raise UserError(f"cannot read {elf}", "it is not a 32-bit ELF", "build the firmware again")


def _text(data: bytes, start: int) -> str:
    return data[start : data.index(b"\0", start)].decode()
