"""The sample packets of the YDLidar X4: layout, angle correction, and checks against noise.

    AA 55 | CT | LSN | FSA (2) | LSA (2) | CS (2) | Si (2) x LSN        little-endian

CT bit 0: first packet of a revolution, then with revolutions per second x 10 in CT bits 7:1. In
other packets CT bits 7:1 are for the vendor's debugging. LSN: samples, 1 to 40; the X4 sends 1 in
the first packet of a revolution, other firmware as many as in any.
FSA, LSA: clockwise angle of the first and last sample in 1/64 deg, shifted left by one, bit 0
set. Si: range in 1/4 mm, 0 = no return. CS makes the XOR of all 16-bit words of a packet 0.
Source: YDLidar X4 Development Manual 1.6, section 4; the vendor's SDK where devices differ.
"""

import itertools
import math
import struct
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from host.messages import FloatArray, IntArray

BAUDRATE = 128_000
BITS_PER_BYTE = 10  # 8N1
SAMPLE_RATE_HZ = 5000.0
HEADER = b"\xaa\x55"
HEADER_LENGTH = 10
MAX_SAMPLES = 40
UNITS_PER_REVOLUTION = 360 * 64
UNIT_RAD = 2.0 * math.pi / UNITS_PER_REVOLUTION
STEP_M = 0.00025  # one unit of Si
# Angles are rounded to a third of the lidar's own unit, so that a recording keeps them in 16 bits.
ANGLE_STEP_RAD = 2.0 * math.pi / 65536
# At 12 revolutions/s, the motor's fastest, a sample is 0.86 deg; beyond 2 deg the angles are wrong.
_MAX_UNITS_PER_SAMPLE = 128
# The emitter sits 21.8 mm beside the axis and its beam crosses the axis' plane at 155.3 mm.
EMITTER_OFFSET_M = 0.0218
CROSSING_M = 0.1553

_LAYOUT = struct.Struct("<HBBHHH")


def angle_correction(ranges: ArrayLike) -> FloatArray:
    """What to add to the raw clockwise angle (rad) of samples at `ranges` (m, any shape).

    atan(21.8 (155.3 - d) / (155.3 d)), d in mm: -6.76 deg at 1 m; 0 where nothing came back. The
    point lies at polar (d, raw + correction): to 0.2 mm the line that leaves 21.8 mm beside the
    axis (clockwise) and turns back towards it by atan(21.8/155.3).
    """
    d = np.asarray(ranges, dtype=float)
    hit = d > 0.0
    safe = np.where(hit, d, 1.0)
    angle = np.arctan(EMITTER_OFFSET_M * (CROSSING_M - safe) / (CROSSING_M * safe))
    return np.where(hit, angle, 0.0)


class PacketHeader(NamedTuple):
    """The fields of a packet that looks sound.

    speed_tenths: in 0.1 revolutions per second, in the first packet of one; 0 where not reported.
    size: samples; first: raw angle of the first, 1/64 deg; span: from there to the last one.
    """

    starts_revolution: bool
    speed_tenths: int
    size: int
    first: int
    span: int


def read_header(data: bytes, start: int) -> PacketHeader | None:
    """The fields of the packet at `start` (10 bytes must be there); None for what no X4 sends."""
    _, kind, size, fsa, lsa, _ = _LAYOUT.unpack_from(data, start)
    first = fsa >> 1
    last = lsa >> 1
    span = (last - first) % UNITS_PER_REVOLUTION
    if (
        not 1 <= size <= MAX_SAMPLES
        or not fsa & lsa & 1
        or first > UNITS_PER_REVOLUTION
        or last > UNITS_PER_REVOLUTION
        or span > _MAX_UNITS_PER_SAMPLE * size
    ):
        return None
    starts = kind & 1 == 1
    return PacketHeader(starts, kind >> 1 if starts else 0, size, first, span)


def xor_of_words(data: bytes) -> int:
    """XOR of the 16-bit words of up to 128 bytes, by folding them as one integer in halves."""
    x = int.from_bytes(data, "little")
    x ^= x >> 512
    x ^= x >> 256
    x ^= x >> 128
    x ^= x >> 64
    x ^= x >> 32
    return (x ^ x >> 16) & 0xFFFF


def read_packet(data: bytes, start: int) -> PacketHeader | str | None:
    """The packet that begins at `start` with AA 55, where it is sound.

    Else what is wrong with it, by the name of its counter; None where it takes more bytes to tell.
    """
    if len(data) < start + HEADER_LENGTH:
        return None
    header = read_header(data, start)
    if header is None:
        return "implausible_packets"
    end = start + HEADER_LENGTH + 2 * header.size
    if len(data) < end:
        return None
    if xor_of_words(data[start:end]):
        return "checksum_errors"
    # One sample cannot hide another packet or a wrong length.
    single = header.starts_revolution and header.size == 1
    wrong = False if single else _is_wrong_inside(data, start, header.size)
    if wrong is None:
        return None
    return "implausible_packets" if wrong else header


def _is_wrong_inside(data: bytes, start: int, size: int) -> bool | None:
    """Whether a packet with the right checksum is damaged all the same; None: not yet known.

    An XOR of words does not notice words that cancel, and where most samples are 0 a damaged LSN
    or a loss of bytes can leave it right.
    """
    end = start + HEADER_LENGTH + 2 * size
    if len(data) < end + len(HEADER):
        return None
    wrong = _holds_packet(data, start, end)
    if wrong is False and not data.startswith(HEADER, end):
        wrong = _samples_cancel(data, start, end) or _should_be_longer(data, start, size)
    return wrong


def _holds_packet(data: bytes, start: int, end: int) -> bool | None:
    """Whether another packet begins inside this one, so that it swallowed it; None: not yet known.

    A whole packet cancels in the XOR. AA 55 alone proves nothing: angles and checksums hold it.
    """
    inner = data.find(HEADER, start + len(HEADER), end)
    while inner >= 0:
        if len(data) < inner + HEADER_LENGTH:
            return None
        header = read_header(data, inner)
        if header is not None:
            inner_end = inner + HEADER_LENGTH + 2 * header.size
            if len(data) < inner_end:
                return None
            if not xor_of_words(data[inner:inner_end]):
                return True
        inner = data.find(HEADER, inner + len(HEADER), end)
    return False


def _samples_cancel(data: bytes, start: int, end: int) -> bool:
    """Whether the last samples cancel in the XOR, as the angles of a packet's remains do."""
    x = 0
    for place in range(end - 2, start + HEADER_LENGTH - 2, -2):
        word = data[place] | data[place + 1] << 8
        x ^= word
        if word and not x:
            return True
    return False


def _should_be_longer(data: bytes, start: int, size: int) -> bool | None:
    """Whether the packet is sound with one more bit set in LSN; None: not yet known."""
    for bit in range(6):
        longer = size | 1 << bit
        if longer == size or longer > MAX_SAMPLES:
            continue
        end = start + HEADER_LENGTH + 2 * longer
        if len(data) < end + len(HEADER):
            return None
        if data.startswith(HEADER, end) and xor_of_words(data[start:end]) == 1 << (8 + bit):
            return True
    return False


def encode_packet(
    samples: IntArray, first: int, last: int, starts_revolution: bool = False, speed_hz: float = 0.0
) -> bytes:
    """One packet. samples (n,) in 1/4 mm, 1 <= n <= 40; first, last raw angle in 1/64 deg."""
    kind = 1 | round(speed_hz * 10.0) << 1 if starts_revolution else 0
    fsa, lsa = (angle % UNITS_PER_REVOLUTION << 1 | 1 for angle in (first, last))
    content = np.asarray(samples).astype("<u2").tobytes()
    marker = int.from_bytes(HEADER, "little")
    unchecked = _LAYOUT.pack(marker, kind, len(samples), fsa, lsa, 0)
    check = xor_of_words(unchecked + content)
    return _LAYOUT.pack(marker, kind, len(samples), fsa, lsa, check) + content


def encode_revolution(angles: IntArray, samples: IntArray, speed_hz: float = 0.0) -> list[bytes]:
    """The packets of one revolution: 1 sample, then 40 each, the last one short.

    angles (n,): raw, in 1/64 deg, of which a packet keeps its first and last. samples (n,): 1/4 mm.
    """
    bounds = [0, *range(1, len(angles), MAX_SAMPLES), len(angles)]
    return [
        encode_packet(
            samples[begin:end], int(angles[begin]), int(angles[end - 1]), begin == 0, speed_hz
        )
        for begin, end in itertools.pairwise(bounds)
    ]
