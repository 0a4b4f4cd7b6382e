"""JPEG → reduced pictures: as OpenCV makes them, and only of whole pictures."""

import contextlib
import random
import struct
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from host.perception.jpeg_decoder import (
    SCALE,
    Image,
    UnusableError,
    decode,
)

WIDTH, HEIGHT = 320, 208
SIZE = (WIDTH, HEIGHT)


def data_of(jpeg: bytes) -> int:
    """Where the data of the last scan begin."""
    scan = jpeg.rindex(b"\xff\xda")
    return scan + 2 + int.from_bytes(jpeg[scan + 2 : scan + 4], "big")


def scene(seed: int = 0, size: tuple[int, int] = SIZE) -> Image:
    random = np.random.default_rng(seed)
    cells = random.integers(0, 255, (size[1] // 16 + 1, size[0] // 16 + 1, 3)).astype(np.uint8)
    return np.asarray(cv2.resize(cells, size, interpolation=cv2.INTER_LINEAR), np.uint8)


def encode(picture: Image, *settings: int) -> bytes:
    return bytes(cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 85, *settings])[1])


KINDS: dict[str, Callable[[Image], bytes]] = {
    "plain": encode,
    "restart markers": lambda p: encode(p, cv2.IMWRITE_JPEG_RST_INTERVAL, 7),
    "a restart marker each row": lambda p: encode(p, cv2.IMWRITE_JPEG_RST_INTERVAL, WIDTH // 16),
    "progressive": lambda p: encode(p, cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
    "grey": lambda p: encode(cv2.cvtColor(p, cv2.COLOR_BGR2GRAY)),
    "zeros behind it": lambda p: encode(p) + bytes(500),
}
if hasattr(cv2, "IMWRITE_JPEG_SAMPLING_FACTOR"):  # OpenCV 4.7
    for name in ("411", "422", "440", "444"):
        factor = getattr(cv2, f"IMWRITE_JPEG_SAMPLING_FACTOR_{name}")
        KINDS[name] = lambda p, f=factor: encode(p, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, f)


def by_opencv(jpeg: bytes) -> Image:
    flags = cv2.IMREAD_REDUCED_COLOR_4 | cv2.IMREAD_IGNORE_ORIENTATION
    return np.asarray(cv2.imdecode(np.frombuffer(jpeg, np.uint8), flags), np.uint8)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("rows", [16, 100, 207, HEIGHT])
def test_the_rows_are_those_of_opencv(kind: str, rows: int) -> None:
    jpeg = KINDS[kind](scene())
    picture = decode(jpeg, SIZE, rows)
    assert picture.shape == (-(-rows // SCALE), WIDTH // SCALE, 3)
    np.testing.assert_array_equal(picture, by_opencv(jpeg)[: len(picture)])


def test_a_reduced_pixel_is_the_mean_of_those_it_stands_for() -> None:
    picture = scene(1)
    reduced = decode(encode(picture), SIZE, HEIGHT).astype(float)
    means = picture.reshape(HEIGHT // SCALE, SCALE, WIDTH // SCALE, SCALE, 3).mean(axis=(1, 3))
    assert np.abs(reduced - means).mean() < 4.0


def test_sizes_that_are_no_multiple_of_anything() -> None:
    size = (331, 203)
    assert decode(encode(scene(2, size)), size, 203).shape == (51, 83, 3)
    assert decode(encode(scene(2, size)), size, 64).shape == (16, 83, 3)


def reason(jpeg: bytes, rows: int = 100) -> str:
    with pytest.raises(UnusableError) as caught:
        decode(jpeg, SIZE, rows)
    return str(caught.value)


@pytest.mark.parametrize("kind", KINDS)
def test_a_picture_cut_anywhere_is_torn(kind: str) -> None:
    jpeg = KINDS[kind](scene()).rstrip(b"\0")
    for length in range(2, len(jpeg), 97):
        assert reason(jpeg[:length]) == "torn"
    for length in (0, 1):
        assert reason(jpeg[:length]) == "not_jpeg"


def test_a_picture_of_another_size_or_another_kind_is_told() -> None:
    assert reason(encode(scene(0, (336, 208)))) == "wrong_size"
    assert reason(bytes(cv2.imencode(".png", scene())[1])) == "not_jpeg"


def test_rows_that_are_not_there_are_missed_although_an_end_follows() -> None:
    jpeg = encode(scene())
    data = len(jpeg) - data_of(jpeg)
    cut = jpeg[: -data * 3 // 4] + b"\xff\xd9"
    assert reason(cut) == "torn"
    # Of the rows below the wanted ones, so many bytes are missed as so many rows must have.
    assert reason(jpeg[: -data * 46 // 100] + b"\xff\xd9") == "torn"


def test_pictures_with_restart_markers_miss_a_part_cut_out() -> None:
    jpeg = KINDS["restart markers"](scene())
    middle = len(jpeg) * 2 // 3
    assert reason(jpeg[:middle] + jpeg[middle + 200 :]) == "torn"


def test_an_end_within_the_last_header_is_torn() -> None:
    head = encode(scene())
    head = head[: head.rindex(b"\xff\xda")]
    for zeros in (0, 4):
        body = bytes((3, 0, 0, 0, 0, 0, 0, 0, 0xFF, 0xD9)) + bytes(zeros)
        jpeg = head + b"\xff\xda" + struct.pack(">H", len(body) + 2) + body
        assert reason(jpeg) == "torn"


def test_the_start_of_the_next_picture_inside_is_torn() -> None:
    jpeg = encode(scene())
    assert reason(jpeg[: len(jpeg) * 3 // 4] + jpeg) == "torn"


def with_filling(jpeg: bytes) -> bytes:
    """0xFF before each marker of the header and before the end, as T.81 B.1.1.2 allows it."""
    scan = data_of(jpeg)
    filled, at = jpeg[:2], 2
    while at < scan:
        size = 2 + int.from_bytes(jpeg[at + 2 : at + 4], "big")
        filled += b"\xff\xff" + jpeg[at : at + size]
        at += size
    return filled + jpeg[scan:-2] + b"\xff" + jpeg[-2:]


def test_filling_before_markers_changes_nothing() -> None:
    jpeg = KINDS["restart markers"](scene())
    filled = with_filling(jpeg)
    assert len(filled) > len(jpeg) + 10
    np.testing.assert_array_equal(decode(filled, SIZE, HEIGHT), decode(jpeg, SIZE, HEIGHT))


def cut(jpeg: bytes, numbers: random.Random, length: int) -> bytes:
    """Without `length` bytes of its data; one time in three the cut begins at a stuffed 0xFF."""
    begin = numbers.randrange(data_of(jpeg), len(jpeg) - 2 - length)
    if numbers.randrange(3) == 0:
        begin = max(begin, jpeg.find(b"\xff\x00", begin, len(jpeg) - 3 - length))
        begin += numbers.randrange(2)
    return jpeg[:begin] + jpeg[begin + length :]


@pytest.fixture(params=["made here", "taken by a fisheye camera"])
def pictures(request: pytest.FixtureRequest) -> list[bytes]:
    """Of 640 x 480."""
    if request.param == "made here":
        return [encode(scene(k, (640, 480))) for k in range(4)]
    recorded: Callable[[str], Path] = request.getfixturevalue("recorded")
    paths = sorted(recorded("fisheye").glob("*.jpg"))[:4]
    return [encode(np.asarray(cv2.imread(str(path))[:480, :640], np.uint8)) for path in paths]


def test_a_gap_that_changes_the_picture_is_noticed_wherever_it_is(pictures: list[bytes]) -> None:
    seed = 20261128
    print(f"seed {seed}")
    numbers = random.Random(seed)
    size, passed, tried = (640, 480), 0, 600
    whole = {jpeg: decode(jpeg, size, 480) for jpeg in pictures}
    for _ in range(tried):
        jpeg = numbers.choice(pictures)
        torn = cut(jpeg, numbers, round(4.0 * 2.0 ** numbers.uniform(4.0, 10.0)))
        with contextlib.suppress(UnusableError):
            passed += not np.array_equal(decode(torn, size, 100), whole[jpeg][:25])
    assert passed <= 0.01 * tried


def test_nothing_is_printed_of_damaged_pictures(capfd: pytest.CaptureFixture[str]) -> None:
    jpeg = encode(scene())
    for torn in (jpeg[:2000] + jpeg[2200:], jpeg[:2000] + b"\xff\xd9", jpeg[:200] + jpeg[400:]):
        assert reason(torn) == "torn"
    assert capfd.readouterr() == ("", "")
