"""The firmware's framing against the host's, which is built on the cobs package and binascii."""

import ctypes
import random
from collections.abc import Iterator

import pytest
from cobs import cobs
from hypothesis import given
from hypothesis import strategies as st

from host.drivers.romeo import framing as romeo_framing
from host.drivers.romeo.framing import encode
from host.drivers.romeo.protocol import (
    FRAMES,
    LARGEST_ENCODED,
    LARGEST_FRAME,
    Frame,
    VelocityFrame,
)
from tests.firmware.boards import on_the_line

SEED = 20260722
LARGEST = LARGEST_FRAME


class BoardDecoder:
    """The firmware's decoder; what it makes of bytes, as (content, ...)."""

    def __init__(self, parts: ctypes.CDLL) -> None:
        self._parts = parts
        self._handle = ctypes.c_void_p(parts.decoder_new())

    def close(self) -> None:
        self._parts.decoder_delete(self._handle)

    def feed(self, data: bytes) -> list[bytes]:
        contents = []
        for byte in data:
            size = self._parts.decoder_feed(self._handle, byte)
            if size:
                contents.append(ctypes.string_at(self._parts.decoder_content(self._handle), size))
        return contents

    @property
    def bad(self) -> int:
        return self._parts.decoder_bad(self._handle)


@pytest.fixture
def decoder(pure_parts: ctypes.CDLL) -> Iterator[BoardDecoder]:
    decoder = BoardDecoder(pure_parts)
    yield decoder
    decoder.close()


def board_encode(parts: ctypes.CDLL, content: bytes) -> bytes:
    encoded = ctypes.create_string_buffer(LARGEST_ENCODED)
    size = parts.frame_encode(content, len(content), encoded)
    return encoded.raw[:size]


def random_frame(rng: random.Random) -> Frame:
    kind = rng.choice(list(FRAMES.values()))
    values = kind.LAYOUT.unpack(bytes([kind.ID]) + _bytes(rng, kind.LAYOUT.size - 1))
    return kind(*values[1:])


def _bytes(rng: random.Random, size: int) -> bytes:
    """Random bytes, rich in the zeros that COBS is about."""
    return bytes(rng.choice((0, 0, rng.randrange(256))) for _ in range(size))


@given(st.binary(min_size=1, max_size=LARGEST))
def test_both_sides_encode_to_the_same_bytes(pure_parts: ctypes.CDLL, content: bytes) -> None:
    assert board_encode(pure_parts, content) == on_the_line(content)


def test_the_board_takes_every_frame_of_the_host(decoder: BoardDecoder) -> None:
    rng = random.Random(SEED)
    for _ in range(2000):
        frame = random_frame(rng)
        (content,) = decoder.feed(encode(frame))
        assert content == encode_content(frame), f"seed {SEED}"
    assert decoder.bad == 0


def encode_content(frame: Frame) -> bytes:
    return bytes(cobs.decode(encode(frame)[:-1]))[:-2]


def test_on_damaged_lines_both_sides_take_and_refuse_the_same(decoder: BoardDecoder) -> None:
    rng = random.Random(SEED)
    host = romeo_framing.BoardDecoder()
    taken = 0
    for _ in range(20_000):
        data = bytearray(encode(random_frame(rng)))
        damage = rng.randrange(5)
        if damage == 1:
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        elif damage == 2:
            del data[rng.randrange(len(data)) :]
        elif damage == 3:
            data[rng.randrange(len(data)) :] = rng.randbytes(rng.randrange(1, 60))
        elif damage == 4:
            data = bytearray(_bytes(rng, rng.randrange(1, 40)))
        mine = decoder.feed(bytes(data))
        theirs = host.feed(bytes(data))
        # The board's decoder leaves it to its caller to know ids and lengths.
        known = [c for c in mine if c[0] in FRAMES and FRAMES[c[0]].LAYOUT.size == len(c)]
        assert known == [encode_content(frame) for frame in theirs], f"seed {SEED}: {data.hex()}"
        taken += len(known)
    assert taken > 1500
    assert decoder.bad == host.counts.broken + host.counts.bad_crc, f"seed {SEED}"


def test_a_frame_too_long_is_refused_once_and_the_next_is_taken(decoder: BoardDecoder) -> None:
    assert decoder.feed(b"\x01" * 5000 + b"\0") == []
    assert decoder.bad == 1
    assert len(decoder.feed(encode(VelocityFrame(1, 2)))) == 1


def test_the_count_of_refused_frames_stays_at_its_end(decoder: BoardDecoder) -> None:
    decoder.feed(b"\x05\0" * 70_000)
    assert decoder.bad == 65535
