"""What the firmware keeps in EEPROM: whole, damaged, of another version, out of bounds."""

import ctypes
import random
import struct
from binascii import crc_hqx
from dataclasses import astuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.drivers.romeo.framing import BoardDecoder, encode
from host.drivers.romeo.protocol import ReadSettingsFrame, SettingsFrame
from host.simulation.devices.romeo_stand_in import DEFAULTS, RomeoStandIn

FIELDS = st.builds(
    SettingsFrame,
    *(st.integers(0, 256 ** struct.calcsize(code) - 1) for code in SettingsFrame.LAYOUT.format[2:]),
)


def packed(settings: SettingsFrame) -> bytes:
    return settings.LAYOUT.pack(settings.ID, *astuple(settings))


def unpacked(content: bytes) -> SettingsFrame:
    number, *values = SettingsFrame.LAYOUT.unpack(content)
    assert number == SettingsFrame.ID
    return SettingsFrame(*values)


def buffer(settings: SettingsFrame | None = None) -> "ctypes.Array[ctypes.c_char]":
    size = SettingsFrame.LAYOUT.size
    return ctypes.create_string_buffer(packed(settings) if settings else bytes(size), size)


def record_of(parts: ctypes.CDLL, settings: SettingsFrame) -> bytes:
    record = ctypes.create_string_buffer(parts.settings_record_size())
    parts.settings_pack(packed(settings), record)
    return record.raw


def read(parts: ctypes.CDLL, record: bytes) -> SettingsFrame | None:
    fields = buffer(DEFAULTS)
    if not parts.settings_unpack(record, fields):
        assert unpacked(fields.raw) == DEFAULTS, "changed although it was refused"
        return None
    return unpacked(fields.raw)


def test_the_defaults_are_those_of_the_stand_in(pure_parts: ctypes.CDLL) -> None:
    fields = buffer()
    pure_parts.settings_defaults(fields)
    assert unpacked(fields.raw) == DEFAULTS


@given(FIELDS)
def test_the_bounds_are_those_of_the_stand_in(
    pure_parts: ctypes.CDLL, settings: SettingsFrame
) -> None:
    fields = buffer(settings)
    pure_parts.settings_bounded(fields)
    board = RomeoStandIn(lambda now: (0, 0))
    board.receive(encode(settings) + encode(ReadSettingsFrame()), 0.0)
    answers = [f for _, data in board.transmit(0.0) for f in BoardDecoder().feed(data)]
    assert unpacked(fields.raw) == answers[0] == answers[1]


def test_a_record_is_version_fields_and_crc(pure_parts: ctypes.CDLL) -> None:
    record = record_of(pure_parts, DEFAULTS)
    body, crc = record[:-2], record[-2:]
    assert body == b"\x02" + packed(DEFAULTS)
    assert crc_hqx(body, 0) == int.from_bytes(crc, "little")
    assert read(pure_parts, record) == DEFAULTS


@given(FIELDS)
def test_what_was_written_is_read_within_bounds(
    pure_parts: ctypes.CDLL, settings: SettingsFrame
) -> None:
    fields = buffer(settings)
    pure_parts.settings_bounded(fields)
    assert read(pure_parts, record_of(pure_parts, settings)) == unpacked(fields.raw)


def test_every_flipped_bit_and_every_cut_is_noticed(pure_parts: ctypes.CDLL) -> None:
    record = record_of(pure_parts, DEFAULTS)
    for bit in range(8 * len(record)):
        damaged = bytearray(record)
        damaged[bit // 8] ^= 1 << bit % 8
        assert read(pure_parts, bytes(damaged)) is None, f"bit {bit}"
    for cut in range(len(record)):
        assert read(pure_parts, record[:cut] + b"\xff" * (len(record) - cut)) is None


@pytest.mark.parametrize("seed", range(3))
def test_other_programs_leavings_are_no_settings(pure_parts: ctypes.CDLL, seed: int) -> None:
    rng = random.Random(seed)
    size = pure_parts.settings_record_size()
    taken = sum(read(pure_parts, rng.randbytes(size)) is not None for _ in range(20_000))
    assert taken == 0, f"seed {seed}"
    assert read(pure_parts, b"\xff" * size) is None
    assert read(pure_parts, bytes(size)) is None


def test_another_version_is_refused_though_its_crc_is_right(pure_parts: ctypes.CDLL) -> None:
    body = b"\x01" + packed(DEFAULTS)
    assert read(pure_parts, body + crc_hqx(body, 0).to_bytes(2, "little")) is None
