"""The splitter of JPEG streams against pictures of two encoders, and against what is none."""

import io
import itertools
import random

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from host.drivers.camera.mjpeg import MAX_BYTES, Splitter, size_of

SEED = 20260


def noise(width: int, height: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


def by_opencv(width: int, height: int, seed: int, *settings: int) -> bytes:
    return bytes(cv2.imencode(".jpg", noise(width, height, seed), list(settings))[1])


def by_pillow(width: int, height: int, seed: int, **settings: object) -> bytes:
    file = io.BytesIO()
    Image.fromarray(noise(width, height, seed)).save(file, "JPEG", **settings)
    return file.getvalue()


def by_pillow_in_cmyk() -> bytes:
    file = io.BytesIO()
    Image.fromarray(noise(64, 48, 9)).convert("CMYK").save(file, "JPEG")
    return file.getvalue()


def with_segment(jpeg: bytes, code: int, content: bytes) -> bytes:
    """The picture with one more segment, right after its start."""
    length = (len(content) + 2).to_bytes(2, "big")
    return jpeg[:2] + bytes([0xFF, code]) + length + content + jpeg[2:]


PLAIN = by_opencv(64, 48, 1)
THUMBNAIL = by_pillow(16, 16, 2)
PICTURES = [
    PLAIN,
    by_opencv(160, 120, 3, cv2.IMWRITE_JPEG_QUALITY, 92),
    by_opencv(65, 33, 4, cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
    by_opencv(128, 96, 5, cv2.IMWRITE_JPEG_RST_INTERVAL, 1),
    by_pillow(80, 40, 6, optimize=True, comment=b"a \xff\xd9 b \xff\xd8\xff c"),
    with_segment(by_pillow(100, 60, 7), 0xE1, b"Exif\0\0" + THUMBNAIL),
    with_segment(by_opencv(100, 60, 8), 0xFE, b"\xff\xd9" * 9),
    PLAIN[:2] + b"\xff\xff\xff" + PLAIN[2:-2] + b"\xff\xff" + PLAIN[-2:],  # filling
    by_pillow_in_cmyk(),  # four components
    PLAIN[:-2] + b"\xff\xdc\x00\x04\x00\x30" + PLAIN[-2:],  # the number of lines comes last
]


FRAME = PLAIN.index(b"\xff\xc0")  # marker, length (2), bits, height (2), width (2), components
SCAN = PLAIN.index(b"\xff\xda")  # marker, length (2), components
FRAME_END = FRAME + 2 + int.from_bytes(PLAIN[FRAME + 2 : FRAME + 4], "big")


def changed(at: int, *values: int) -> bytes:
    return PLAIN[:at] + bytes(values) + PLAIN[at + len(values) :]


SENSELESS = {
    "no height": changed(FRAME + 5, 0, 0),
    "no width": changed(FRAME + 7, 0, 0),
    "no components in the frame": changed(FRAME + 9, 0),
    "too many components in the frame": changed(FRAME + 9, 4),
    "two frames": PLAIN[:FRAME_END] + PLAIN[FRAME:],
    "no frame before the scan": PLAIN[:FRAME] + PLAIN[FRAME_END:],
    "no components in the scan": PLAIN[:SCAN] + b"\xff\xda\0\x06\0\0\x3f\0" + PLAIN[SCAN + 14 :],
    "five components in the scan": PLAIN[:SCAN]
    + b"\xff\xda\0\x10\x05"
    + bytes(13)
    + PLAIN[SCAN + 14 :],
    "too few components in the scan": changed(SCAN + 4, 2),
}


def split(*pieces: bytes) -> tuple[list[bytes], dict[str, int]]:
    splitter = Splitter()
    found = [picture for piece in pieces for picture in splitter.feed(piece)]
    return found + splitter.finish(), splitter.counts


def test_pictures_in_a_row_come_out_as_they_went_in() -> None:
    found, counts = split(b"".join(PICTURES))
    assert found == PICTURES
    expected = {"pictures": len(PICTURES), "without_end": 0, "torn": 0, "bytes_skipped": 0}
    assert counts == expected


@pytest.mark.parametrize("picture", PICTURES)
def test_a_picture_comes_out_with_its_last_byte(picture: bytes) -> None:
    splitter = Splitter()
    assert splitter.feed(picture[:-1]) == []
    assert splitter.feed(picture[-1:]) == [picture]


@pytest.mark.parametrize("case", SENSELESS)
def test_a_header_that_makes_no_sense_is_no_picture_and_costs_no_other(case: str) -> None:
    found, counts = split(SENSELESS[case] + PLAIN)
    assert found == [PLAIN]
    assert counts["torn"] >= 1


@pytest.mark.parametrize("picture", PICTURES)
def test_the_size_is_what_decoders_say(picture: bytes) -> None:
    assert size_of(picture) == Image.open(io.BytesIO(picture)).size


@given(
    sizes=st.lists(st.integers(1, 4000), min_size=1, max_size=40),
    between=st.lists(st.binary(max_size=30), min_size=len(PICTURES), max_size=len(PICTURES)),
)
@settings(derandomize=True, max_examples=60, deadline=None)
def test_how_the_bytes_are_cut_up_does_not_matter(sizes: list[int], between: list[bytes]) -> None:
    junk = [piece.replace(b"\xff", b"") for piece in between]
    stream = b"".join(a + b for a, b in zip(PICTURES, junk, strict=True))
    ends = [0, *itertools.accumulate(itertools.islice(itertools.cycle(sizes), len(stream)))]
    pieces = [stream[a:b] for a, b in itertools.pairwise(ends) if a < len(stream)]
    found, counts = split(*pieces)
    assert found == PICTURES
    assert counts["torn"] == 0
    assert counts["bytes_skipped"] == sum(map(len, junk))


def test_a_torn_picture_costs_no_other_one() -> None:
    """Cut anywhere: what follows is whole again, and a thumbnail is no picture.

    Unless the cut leaves the thumbnail without its end mark at the end: such a picture is one.
    """
    torn, last = PICTURES[5], PICTURES[2]
    thumbnail_end = torn.index(THUMBNAIL) + len(THUMBNAIL)
    unclear = []
    for end in range(3, len(torn) - 2):  # up to its end mark
        found, _ = split(torn[:end] + PLAIN + last)
        assert found[-1] == last, end
        assert THUMBNAIL not in found or thumbnail_end - 4 <= end < thumbnail_end
        if found != [PLAIN, last]:
            unclear.append(end)
    # At few places the torn segment's length leads by chance to a marker of the next picture.
    assert len(unclear) < 16, unclear
    assert max(unclear) < torn.rindex(b"\xff\xda") + 20  # within the header


def test_a_picture_that_ends_early_is_torn() -> None:
    for picture in PICTURES:
        found, counts = split(picture[: len(picture) // 2])
        assert found == []
        assert (counts["pictures"], counts["torn"]) == (0, 1)
        assert counts["bytes_skipped"] == len(picture) // 2


def test_tables_alone_are_no_picture() -> None:
    scan = PLAIN.index(b"\xff\xda")
    found, counts = split(PLAIN[:scan] + b"\xff\xd9" + PLAIN)
    assert found == [PLAIN]
    assert counts["torn"] == 1


def test_a_picture_without_end_is_given_up() -> None:
    splitter = Splitter()
    head = PLAIN[:-2]
    assert splitter.feed(head + bytes(MAX_BYTES)) == []
    assert splitter.feed(PLAIN) == [PLAIN]
    assert splitter.counts["torn"] == 1


def test_damage_of_all_kinds_is_counted_and_survived() -> None:
    print(f"seed {SEED}")
    rng = random.Random(SEED)
    alphabet = bytes([0xFF, 0xD8, 0xD9, 0xDA, 0xC0, 0xE1, 0x00, 0x08])
    for _ in range(1500):
        base = bytearray(rng.choice(PICTURES[:1] + PICTURES[2:]))
        for _ in range(rng.randrange(1, 8)):
            kind, at = rng.randrange(4), rng.randrange(len(base) + 1)
            if kind == 0 and at < len(base):
                base[at] ^= 1 << rng.randrange(8)
            elif kind == 1:
                del base[at : at + rng.randrange(200)]
            elif kind == 2:
                base[at:at] = bytes(rng.choices(alphabet, k=rng.randrange(20)))
            else:
                base[at:at] = rng.randbytes(rng.randrange(50))
        stream = bytes(base) + bytes(70_000) + PLAIN
        found, counts = split(stream)
        # After so many zeros no damaged segment reaches into the last picture.
        assert found[-1] == PLAIN
        assert counts["pictures"] == len(found)
        added = 2 * counts["without_end"]
        assert counts["bytes_skipped"] + sum(map(len, found)) == len(stream) + added
        for picture in found:
            assert picture in stream or picture[:-2] in stream
            assert picture.startswith(b"\xff\xd8\xff")
            assert picture.endswith(b"\xff\xd9")
            assert min(size_of(picture)) > 0


ENDLESS = PICTURES[:8]  # those that end with their data, and are not CMYK


@given(
    numbers=st.lists(st.integers(0, len(ENDLESS) - 1), min_size=1, max_size=8),
    without_end=st.lists(st.booleans(), min_size=8, max_size=8),
    padding=st.lists(st.sampled_from([b"", b"\0", bytes(900), b"\xff"]), min_size=8, max_size=8),
    size=st.integers(40, 5000),
)
@settings(derandomize=True, max_examples=50, deadline=None)
def test_end_marks_may_be_missing_and_buffers_filled_up(
    numbers: list[int], without_end: list[bool], padding: list[bytes], size: int
) -> None:
    """Among others: a buffer with two pictures in it, and the last one without a successor."""
    order = [ENDLESS[number] for number in numbers]
    pieces = [
        (picture[:-2] if bare else picture) + filling
        for picture, bare, filling in zip(order, without_end, padding, strict=False)
    ]
    stream = b"".join(pieces)
    found, counts = split(*(stream[at : at + size] for at in range(0, len(stream), size)))
    assert counts["pictures"] == len(order)
    assert counts["torn"] == 0
    assert counts["without_end"] == sum(without_end[: len(order)])
    for ours, picture in zip(found, order, strict=True):
        assert ours.endswith(b"\xff\xd9")
        np.testing.assert_array_equal(decoded(ours), decoded(picture))


def decoded(jpeg: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(jpeg)).convert("RGB"))


@pytest.mark.parametrize("lost", [3, 40, 500])
def test_without_an_end_mark_a_picture_that_lost_its_end_is_torn(lost: int) -> None:
    for picture in ENDLESS:
        for rest in (b"", PLAIN):
            found, counts = split(picture[: -2 - lost] + rest)
            assert found == ([rest] if rest else [])
            assert counts["torn"] >= 1


def test_a_header_of_a_huge_picture_without_end_costs_no_time() -> None:
    huge = changed(FRAME + 5, 0xFF, 0x00, 0xFF, 0x00)[:-2]
    found, counts = split(huge + PLAIN)
    assert found == [PLAIN]
    assert counts["torn"] == 1


def test_long_garbage_takes_time_in_proportion_only() -> None:
    """Every false start is looked at once: the work is counted, not timed."""
    steps = 0

    class Counting(Splitter):
        def _advance(self, pictures: list[bytes]) -> bool:
            nonlocal steps
            steps += 1
            return super()._advance(pictures)

    garbage = b"\xff\xd8\xff\xe1\x7f\xff" * 20_000
    splitter = Counting()
    for start in range(0, len(garbage), 4096):
        splitter.feed(garbage[start : start + 4096])
    assert steps < 4 * 20_000 + 100
