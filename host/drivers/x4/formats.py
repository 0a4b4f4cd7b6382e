"""Bytes that the X4's decoder refuses: another format, or a damaged line?"""

from collections import Counter

from host.drivers.x4.packets import HEADER, HEADER_LENGTH, MAX_SAMPLES, read_header, xor_of_words

_ENOUGH_BYTES = 1000  # of a stream in which no packet begins
_ENOUGH_PACKETS = 3


def unknown_format(data: bytes) -> str | None:
    """What is different about the packets in `data` (some 4 kB), as text; None: nothing is known.

    A checksum that is right by chance is rare, so packets whose checksum is right although no X4
    sends them belong to another device. Where none is right the line may be damaged.
    """
    heads = _heads(data)
    if not heads and len(data) >= _ENOUGH_BYTES:
        return f"no packet header (AA 55) in {len(data)} bytes"
    found = Counter(_kind(data, head) for head in heads)
    good = found.pop("", 0)
    found.pop("damaged", 0)
    if not found:
        return None
    kind, count = found.most_common(1)[0]
    return kind if count >= _ENOUGH_PACKETS and count > good else None


def _heads(data: bytes) -> list[int]:
    heads = []
    place = data.find(HEADER)
    while place >= 0:
        heads.append(place)
        place = data.find(HEADER, place + 1)
    return heads


def _kind(data: bytes, start: int) -> str:
    """What the packet at `start` is: "" one of the X4, "damaged", or another one in words."""
    if len(data) < start + HEADER_LENGTH:
        return "damaged"
    size = data[start + 3]
    if size and _has_checksum(data, start, 2, size):
        if size > MAX_SAMPLES:
            return f"packets of {size} samples, more than {MAX_SAMPLES}"
        return "" if read_header(data, start) else "packets with angles as no X4 sends them"
    if size and _has_checksum(data, start, 3, size):
        return "packets with an intensity for each sample"
    return "damaged"


def _has_checksum(data: bytes, start: int, width: int, size: int) -> bool:
    """Is the checksum right for `size` samples of `width` bytes? 2: ranges, 3: with intensity."""
    begin = start + HEADER_LENGTH
    content = data[begin : begin + width * size]
    if len(content) < width * size:
        return False
    if width == 3:
        content = b"".join(
            bytes((content[k], 0)) + content[k + 1 : k + 3] for k in range(0, len(content), 3)
        )
    words = data[start:begin] + content
    check = 0
    for k in range(0, len(words), 128):
        check ^= xor_of_words(words[k : k + 128])
    return check == 0
