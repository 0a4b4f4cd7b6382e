"""JPEG → a quarter of its size in colour, fast, and only where the picture is whole.

At a quarter of the size libjpeg scales brightness and colour each in its own inverse transform, so
that a webcam's picture, whose colour is stored at half size, loses none of the colour it has: what
a strip is found by. A picture that lost a part is noticed by the decoder: Huffman codes find their
step again after a gap, but then the blocks end before the data do, or after. Only a decoder that
reads to the end notices that, so rows that nobody needs are decoded, too.
"""

import numpy as np
import simplejpeg

from host.messages import Image

SCALE = 4  # pixels of the picture in one pixel of the reduced one, along a side


class UnusableError(Exception):
    """A picture that is not used; its text is the reason under which it is counted."""


def size_of(jpeg: bytes) -> tuple[int, int]:
    """Width and height (px) by the picture's header. Raises UnusableError."""
    if jpeg[:2] != b"\xff\xd8":
        raise UnusableError("not_jpeg")
    try:
        height, width, *_ = simplejpeg.decode_jpeg_header(jpeg)
    except ValueError as error:
        raise UnusableError("torn") from error
    return width, height


def decode(jpeg: bytes, size: tuple[int, int], rows: int) -> Image:
    """The uppermost `rows` of a picture of `size` (width, height), reduced: (r, w, 3) BGR.

    r and w are rows and width by SCALE, rounded up. Raises UnusableError with the reason: not_jpeg,
    torn, wrong_size.
    """
    if size_of(jpeg) != size:
        raise UnusableError("wrong_size")
    width, height = (-(-side // SCALE) for side in size)
    try:
        # Where libjpeg warns of corrupt data, this raises.
        picture = simplejpeg.decode_jpeg(jpeg, "BGR", min_width=width, min_height=height)
    except ValueError as error:
        raise UnusableError("torn") from error
    return np.asarray(picture[: -(-rows // SCALE)], dtype=np.uint8)
