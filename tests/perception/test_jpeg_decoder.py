"""JPEG → reduced pictures: the same by both decoders, and only of whole pictures."""

import os
import struct
from collections.abc import Callable

import cv2
import numpy as np
import pytest

from host.perception.jpeg_decoder import (
    SCALE,
    Image,
    JpegDecoder,
    OpenCvDecoder,
    TurboDecoder,
    UnusableError,
    check_whole,
    fastest_decoder,
    read_header,
)

WIDTH, HEIGHT = 320, 208
SIZE = (WIDTH, HEIGHT)


@pytest.fixture(scope="module")
def turbo() -> TurboDecoder:
    try:
        return TurboDecoder()
    except OSError:
        if os.environ.get("CI") == "true":
            raise
        pytest.skip("libturbojpeg is not installed")


@pytest.fixture(params=["turbo", "opencv"])
def decoder(request: pytest.FixtureRequest) -> JpegDecoder:
    return OpenCvDecoder() if request.param == "opencv" else request.getfixturevalue("turbo")


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


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("rows", [16, 100, 207, HEIGHT])
def test_both_decoders_give_the_same_rows(turbo: TurboDecoder, kind: str, rows: int) -> None:
    jpeg = KINDS[kind](scene())
    fast, plain = turbo.decode(jpeg, SIZE, rows), OpenCvDecoder().decode(jpeg, SIZE, rows)
    assert fast.shape == (-(-rows // SCALE), WIDTH // SCALE, 3)
    # Colour stored at half height only is spread down from the row above; the last has no next.
    whole = -1 if kind == "440" else None
    np.testing.assert_array_equal(fast[:whole], plain[:whole])


def test_a_reduced_pixel_is_the_mean_of_those_it_stands_for(decoder: JpegDecoder) -> None:
    picture = scene(1)
    reduced = decoder.decode(encode(picture), SIZE, HEIGHT).astype(float)
    means = picture.reshape(HEIGHT // SCALE, SCALE, WIDTH // SCALE, SCALE, 3).mean(axis=(1, 3))
    assert np.abs(reduced - means).mean() < 4.0


def test_sizes_that_are_no_multiple_of_anything(decoder: JpegDecoder) -> None:
    size = (331, 203)
    assert decoder.decode(encode(scene(2, size)), size, 203).shape == (51, 83, 3)
    assert decoder.decode(encode(scene(2, size)), size, 64).shape == (16, 83, 3)


def reason(decoder: JpegDecoder, jpeg: bytes, rows: int = 100) -> str:
    with pytest.raises(UnusableError) as caught:
        decoder.decode(jpeg, SIZE, rows)
    return str(caught.value)


@pytest.mark.parametrize("kind", KINDS)
def test_a_picture_cut_anywhere_is_torn(decoder: JpegDecoder, kind: str) -> None:
    jpeg = KINDS[kind](scene()).rstrip(b"\0")
    for length in range(2, len(jpeg), 97):
        assert reason(decoder, jpeg[:length]) == "torn"
    for length in (0, 1):
        assert reason(decoder, jpeg[:length]) == "not_jpeg"


def test_a_picture_of_another_size_or_another_kind_is_told(decoder: JpegDecoder) -> None:
    assert reason(decoder, encode(scene(0, (336, 208)))) == "wrong_size"
    assert reason(decoder, bytes(cv2.imencode(".png", scene())[1])) == "not_jpeg"


def test_rows_that_are_not_there_are_missed_although_an_end_follows(turbo: TurboDecoder) -> None:
    jpeg = encode(scene())
    data = len(jpeg) - read_header(jpeg).scan
    cut = jpeg[: -data * 3 // 4] + b"\xff\xd9"
    assert reason(turbo, cut) == "torn"
    # Of the rows below the wanted ones, so many bytes are missed as so many rows must have.
    assert reason(turbo, jpeg[: -data * 46 // 100] + b"\xff\xd9") == "torn"


def test_pictures_with_restart_markers_miss_a_part_cut_out(decoder: JpegDecoder) -> None:
    jpeg = KINDS["restart markers"](scene())
    middle = len(jpeg) * 2 // 3
    assert reason(decoder, jpeg[:middle] + jpeg[middle + 200 :]) == "torn"
    plain = read_header(jpeg)
    assert plain.restart == 7
    assert check_whole(jpeg, plain) == jpeg


def test_an_end_within_the_last_header_is_torn(decoder: JpegDecoder) -> None:
    head = encode(scene())
    head = head[: head.rindex(b"\xff\xda")]
    for zeros in (0, 4):
        body = bytes((3, 0, 0, 0, 0, 0, 0, 0, 0xFF, 0xD9)) + bytes(zeros)
        jpeg = head + b"\xff\xda" + struct.pack(">H", len(body) + 2) + body
        assert reason(decoder, jpeg) == "torn"


def test_the_start_of_the_next_picture_inside_is_torn(decoder: JpegDecoder) -> None:
    jpeg = encode(scene())
    assert reason(decoder, jpeg[: len(jpeg) * 3 // 4] + jpeg) == "torn"


def test_the_header_by_hand() -> None:
    frame = struct.pack(">BHHB9B", 8, 1080, 1920, 3, 1, 0x21, 0, 2, 0x11, 1, 3, 0x11, 1)
    scan = bytes((3, 1, 0, 2, 0x11, 3, 0x11, 0, 63, 0))
    jpeg = b"\xff\xd8" + b"\xff\xdd\x00\x04\x00\x78"
    for marker, body in ((0xC0, frame), (0xDA, scan)):
        jpeg += struct.pack(">BBH", 0xFF, marker, len(body) + 2) + body
    header = read_header(jpeg + b"data")
    assert (header.width, header.height, header.unit, header.blocks) == (1920, 1080, (16, 8), 4)
    assert jpeg[header.height_at : header.height_at + 2] == struct.pack(">H", 1080)
    assert (header.scan, header.restart, header.plain) == (len(jpeg), 120, True)
    assert header.units(1080) == 120 * 135


def test_without_the_library_opencv_decodes(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(*_: object) -> None:
        raise OSError("no such library")

    monkeypatch.setattr("ctypes.CDLL", missing)
    assert isinstance(fastest_decoder(), OpenCvDecoder)
