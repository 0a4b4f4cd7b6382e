"""Frames of the board: every value survives the line, nothing broken passes, nothing raises."""

import random
import struct
from dataclasses import astuple, fields

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.drivers.romeo.framing import BoardDecoder, encode
from host.drivers.romeo.protocol import (
    FRAMES,
    LARGEST_ENCODED,
    PROTOCOL_HASH,
    DisplacementFrame,
    Frame,
    HelloFrame,
    IdentityFrame,
    VelocityFrame,
)

SAMPLE = DisplacementFrame(7, 4_000_000_000, -123_456, 654_321, 98_765, -43_210, 0, 1, 2, 0, 3)


def crc_xmodem(data: bytes) -> int:
    """CRC-16/XMODEM bit by bit, as its definition reads; the oracle."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ (0x1021 if crc & 0x8000 else 0)) & 0xFFFF
    return crc


def unstuff(encoded: bytes) -> bytes | None:
    """COBS by its definition: a count, then that many bytes less one, a zero between groups."""
    out = bytearray()
    at = 0
    while at < len(encoded):
        count = encoded[at]
        group = encoded[at + 1 : at + count]
        if count == 0 or len(group) != count - 1:
            return None
        out += group
        at += count
        if count != 0xFF and at < len(encoded):
            out.append(0)
    return bytes(out)


def is_frame(encoded: bytes) -> bool:
    """Would a reader of protocol.toml take these bytes between two zeros for a frame?"""
    raw = unstuff(encoded)
    if raw is None or len(raw) < 3:
        return False
    content, crc = raw[:-2], raw[-2:]
    kind = FRAMES.get(content[0])
    right = struct.pack("<H", crc_xmodem(content)) == crc
    return right and kind is not None and kind.LAYOUT.size == len(content)


def value(code: str) -> st.SearchStrategy[int]:
    bits = 8 * struct.calcsize("<" + code)
    if code.islower():
        return st.integers(-(1 << (bits - 1)), (1 << (bits - 1)) - 1)
    return st.integers(0, (1 << bits) - 1)


def frames() -> st.SearchStrategy[Frame]:
    return st.one_of(
        st.tuples(*(value(code) for code in kind.LAYOUT.format[2:])).map(
            lambda values, kind=kind: kind(*values)
        )
        for kind in FRAMES.values()
    )


@settings(derandomize=True, deadline=None)
@given(st.lists(frames(), max_size=8), st.integers(1, 9))
def test_frames_survive_the_line_however_it_is_cut(sent: list[Frame], size: int) -> None:
    stream = b"".join(encode(frame) for frame in sent)
    decoder = BoardDecoder()
    got = [
        frame
        for at in range(0, len(stream), size)
        for frame in decoder.feed(stream[at : at + size])
    ]
    assert got == sent
    assert decoder.counts.accepted == len(sent)
    assert decoder.counts.refused == 0


@settings(derandomize=True, deadline=None)
@given(frames())
def test_the_bytes_are_those_of_the_definition(frame: Frame) -> None:
    encoded = encode(frame)
    assert encoded[-1:] == b"\0"
    assert 0 not in encoded[:-1]
    assert len(encoded) <= LARGEST_ENCODED
    assert is_frame(encoded[:-1])
    raw = unstuff(encoded[:-1])
    assert raw is not None
    assert raw[0] == frame.ID
    at = 1
    for field, code in zip(fields(frame), frame.LAYOUT.format[2:], strict=True):
        size = struct.calcsize("<" + code)
        number = int.from_bytes(raw[at : at + size], "little", signed=code.islower())
        assert number == getattr(frame, field.name)
        at += size


def test_the_greeting_reads_the_same_in_every_version() -> None:
    """Frozen: with other bytes, old firmware and new host could not tell each other apart."""
    assert encode(HelloFrame()).hex() == "0401211000"
    raw = unstuff(encode(IdentityFrame(0x11223344, 1, 2, 3, 4, 2))[:-1])
    assert raw is not None
    assert raw[:5] == b"\x02\x44\x33\x22\x11"


def test_every_single_bit_flip_is_refused_and_the_next_frame_is_not_lost_with_it() -> None:
    # A flip into or out of a zero byte may join or split frames; one good frame after it must come.
    good = encode(SAMPLE)
    for bit in range(8 * (len(good) - 1)):
        broken = bytearray(good)
        broken[bit // 8] ^= 1 << bit % 8
        decoder = BoardDecoder()
        assert decoder.feed(bytes(broken) + good) == [SAMPLE]
        assert decoder.counts.refused >= 1


def test_a_frame_of_unknown_kind_or_wrong_length_is_counted_as_such() -> None:
    decoder = BoardDecoder()
    hello, velocity = encode(HelloFrame()), encode(VelocityFrame(1, 2))
    content = bytes([VelocityFrame.ID, 1, 0])
    short = content + struct.pack("<H", crc_xmodem(content))
    group = b"\x03" + short[:2] + b"\x03" + short[3:]
    assert unstuff(group) == short
    assert decoder.feed(group + b"\0" + hello + velocity) == [HelloFrame(), VelocityFrame(1, 2)]
    assert astuple(decoder.counts) == (2, 0, 0, 1)


def test_silence_between_frames_costs_nothing() -> None:
    decoder = BoardDecoder()
    assert decoder.feed(b"\0" * 50 + encode(SAMPLE)) == [SAMPLE]
    assert decoder.counts.refused == 0


def test_a_line_without_delimiters_takes_no_memory_and_is_one_refused_frame() -> None:
    decoder = BoardDecoder()
    for _ in range(100):
        decoder.feed(b"\x01" * 10_000)
    assert len(decoder._partial) <= LARGEST_ENCODED
    assert decoder.feed(b"\0" + encode(SAMPLE)) == [SAMPLE]
    assert decoder.counts.broken == 1


@pytest.mark.parametrize("seed", range(4))
def test_noise_never_raises_and_only_true_frames_pass(seed: int) -> None:
    print(f"seed {seed}")
    rng = random.Random(seed)
    # Many zeros, so that noise is made of frames and not of one long break.
    noise = bytes(rng.choice((0, rng.randrange(256), rng.randrange(25))) for _ in range(100_000))
    decoder = BoardDecoder()
    got, at = [], 0
    while at < len(noise):
        size = rng.randrange(1, 64)
        got += decoder.feed(noise[at : at + size])
        at += size
    pieces = [piece for piece in noise.split(b"\0")[:-1] if piece]
    assert len(got) == sum(is_frame(piece) for piece in pieces)
    assert decoder.counts.accepted + decoder.counts.refused == len(pieces)


@pytest.mark.parametrize("seed", range(4))
def test_mutated_frames_pass_only_with_a_right_crc(seed: int) -> None:
    print(f"seed {seed}")
    rng = random.Random(seed)
    decoder = BoardDecoder()
    whole = passed = 0
    for _ in range(5000):
        kind = rng.choice(list(FRAMES.values()))
        values = [rng.randrange(100) for _ in kind.LAYOUT.format[2:]]
        encoded = bytearray(encode(kind(*values)))
        for _ in range(rng.randrange(1, 4)):
            mutate = rng.randrange(3)
            at = rng.randrange(len(encoded))
            if mutate == 0:
                encoded[at] = rng.randrange(256)
            elif mutate == 1:
                encoded.insert(at, rng.randrange(256))
            elif len(encoded) > 1:
                del encoded[at]
        pieces = (bytes(encoded) + b"\0").split(b"\0")
        whole += sum(is_frame(piece) for piece in pieces if piece)
        passed += len(decoder.feed(bytes(encoded) + b"\0"))
    assert passed == whole
    assert decoder.counts.accepted == passed
    assert decoder.counts.refused > 4000


def test_a_value_that_does_not_fit_is_not_sent() -> None:
    with pytest.raises(struct.error):
        encode(VelocityFrame(40_000, 0))


def test_the_hash_is_32_bits() -> None:
    assert 0 < PROTOCOL_HASH < 1 << 32
