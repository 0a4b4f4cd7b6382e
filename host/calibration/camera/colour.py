"""The colour range of [camera.strip], learnt from pictures; pictures that show what it finds."""

import math
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from host.config import Strip
from host.drivers.camera.mjpeg import Splitter
from host.errors import UserError
from host.messages import BoolArray, FloatArray, Image
from host.perception.jpeg_decoder import SCALE
from host.perception.strips.blob import Blob
from host.perception.strips.geometry import StripGeometry

Box = tuple[int, int, int, int]  # left, top, width, height in full-size px

_COLOURED, _BRIGHT = 0.25, 0.06  # least saturation and value of a pixel that has a colour
_NEAR_HUE_DEG = 40.0  # of one colour, in light and shade
_HUE_MARGIN_DEG, _LEAST_WIDTH_DEG = 6.0, 20.0
_SATURATION_SHARE, _VALUE_SHARE = 0.75, 0.4  # of the dullest pixels': other light is to pass too
_LEAST_PIXELS, _SURE_PIXELS = 4, 30
_BIN_DEG = 5.0
_GREEN, _RED, _BLUE = (60, 200, 60), (60, 60, 230), (230, 160, 60)
_YELLOW, _WHITE = (40, 230, 240), (255, 255, 255)


def read_picture(path: Path) -> bytes:
    """The bytes of a picture as a JPEG, cut as those of a camera; other kinds are converted to one.

    Raises UserError where the file is no picture, or its first is not whole.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise UserError(f"cannot read {path}", error.strerror or str(error)) from error
    if data[:3] == b"\xff\xd8\xff":
        splitter = Splitter()
        found = splitter.feed(data) + splitter.finish()
        if not found:
            raise UserError(f"{path} cannot be used", "it is torn", "give whole pictures")
        return found[0]
    picture = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_COLOR) if data else None
    if picture is None:
        raise UserError(f"{path} is not a picture", "", "give JPEG or PNG files of the camera")
    return bytes(cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 95])[1])


def reduced(box: Box, slack_px: int = 0) -> tuple[slice, slice]:
    """Rows and columns of the reduced picture that a box covers, and `slack_px` around it."""
    left, top, width, height = box
    rows, columns = (
        slice(max(first - slack_px, 0) // SCALE, max(-(-(first + size + slack_px) // SCALE), 0))
        for first, size in ((top, height), (left, width))
    )
    return rows, columns


def pixels_in_box(picture: Image, box: Box) -> Image:
    """Pixels (n, 3) of a reduced picture (h, w, 3) that lie in a box of the full one."""
    return picture[reduced(box)].reshape(-1, 3)


def band_of(geometry: StripGeometry) -> BoolArray:
    """Which pixels (h, w) of the reduced picture may show a strip."""
    level = (geometry.elevation >= geometry.lowest) & (geometry.elevation <= geometry.highest)
    return np.asarray(level & (geometry.drawn > 0))


def pixels_of_best_blob(picture: Image, strip: Strip, geometry: StripGeometry) -> Image:
    """Pixels (n, 3) of the most saturated blob near the strip's hue, where strips can be.

    picture: reduced, (h, w, 3). Empty where there is none.
    """
    hue, saturation, value = _hsv(picture)
    near = np.abs(_hue_difference(hue - strip.hue_deg)) <= _NEAR_HUE_DEG
    shown = np.zeros(near.shape, dtype=bool)
    shown[: len(geometry.drawn)] = band_of(geometry)
    mask = near & (saturation >= _COLOURED) & (value >= _BRIGHT) & shown
    count, label = cv2.connectedComponents(mask.astype(np.uint8))
    sizes = np.bincount(label.ravel(), minlength=count)
    means = np.bincount(label.ravel(), saturation.ravel(), count) / np.maximum(sizes, 1)
    score = np.where(sizes >= _LEAST_PIXELS, means * np.minimum(sizes / _SURE_PIXELS, 1.0), 0.0)
    score[0] = 0.0  # the background
    best = int(np.argmax(score))
    return picture[label == best] if score[best] > 0.0 else picture[:0, 0]


def learn(pixels: Image, strip: Strip) -> Strip:
    """The strip with the colour range of `pixels` (n, 3) BGR, some of which may be background.

    The range is that of the pixels of the commonest hue, with margins for other light. Raises
    UserError where too few of them have a colour.
    """
    hue, saturation, value = _hsv(pixels)
    kept = (saturation >= _COLOURED) & (value >= _BRIGHT)
    if kept.any():
        kept &= (
            np.abs(_hue_difference(hue - _commonest(hue[kept], saturation[kept]))) <= _NEAR_HUE_DEG
        )
        # What the strip fills only in part is paler than the strip.
        kept &= saturation >= 0.6 * float(np.percentile(saturation[kept], 90))
    if np.count_nonzero(kept) < _LEAST_PIXELS:
        raise UserError(
            "there is no strip's colour to learn",
            "the pixels looked at are grey, dark or too few",
            "draw a box around a strip with --box x,y,width,height (in pixels of the picture)",
        )
    middle = _mean_hue(hue[kept], saturation[kept])
    low, high = np.percentile(_hue_difference(hue[kept] - middle), [2, 98])
    width = max(float(high - low) + 2.0 * _HUE_MARGIN_DEG, _LEAST_WIDTH_DEG)
    dullest = float(np.percentile(saturation[kept], 5))
    darkest = float(np.percentile(value[kept], 5))
    return strip.model_copy(
        update={
            "hue_deg": round(float(middle + 0.5 * (low + high)) % 360.0, 1) % 360.0,
            "hue_width_deg": round(min(width, 180.0), 1),
            "saturation_min": round(max(_SATURATION_SHARE * dullest, 0.15), 2),
            "value_min": round(max(_VALUE_SHARE * darkest, _BRIGHT), 2),
        }
    )


def _hsv(picture: Image) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Hue (deg), saturation and value (0 to 1) of pixels (..., 3), which may be none."""
    if not picture.size:
        none = np.zeros(picture.shape[:-1])
        return none, none, none
    rows = picture.reshape(-1, 1, 3).astype(np.float32) / 255.0
    hsv = np.asarray(cv2.cvtColor(rows, cv2.COLOR_BGR2HSV), float).reshape(picture.shape)
    return hsv[..., 0], hsv[..., 1], hsv[..., 2]


def _hue_difference(degrees: FloatArray) -> FloatArray:
    return np.asarray((degrees + 180.0) % 360.0 - 180.0)


def _commonest(hue: FloatArray, weight: FloatArray) -> float:
    """The commonest hue: the fullest of three neighbouring bins of the circle."""
    bins = np.bincount((hue // _BIN_DEG).astype(int) % 72, weight, 72)
    smooth = bins + np.roll(bins, 1) + np.roll(bins, -1)
    return (float(np.argmax(smooth)) + 0.5) * _BIN_DEG


def _mean_hue(hue: FloatArray, weight: FloatArray) -> float:
    angle = np.radians(hue)
    return math.degrees(math.atan2(weight @ np.sin(angle), weight @ np.cos(angle)))


def annotate(
    jpeg: bytes,
    blobs: Sequence[Blob],
    geometry: StripGeometry,
    boxes: Sequence[Box] = (),
    mistaken: Sequence[Blob] = (),
    background: BoolArray | None = None,
) -> Image:
    """The picture with its blobs framed: green with the bearing, or red with the reason.

    Blue lines are the bounds between which a strip can be; boxes are white. Yellow: `mistaken`, of
    the blobs, and `background` (h, w) of the reduced picture.
    """
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    picture = np.array(cv2.imdecode(np.frombuffer(jpeg, dtype=np.uint8), flags), dtype=np.uint8)
    for bound in (geometry.lowest, geometry.highest):
        below = ((geometry.elevation < bound) & (geometry.drawn > 0)).astype(np.uint8)
        edge = below != cv2.erode(below, np.ones((2, 2), np.uint8))
        _paint(picture, edge, _BLUE)
    if background is not None:
        _paint(picture, background, _YELLOW)
    for left, top, width, height in boxes:
        cv2.rectangle(picture, (left, top), (left + width, top + height), _WHITE, 1)
    for blob in blobs:
        colour = _YELLOW if blob in mistaken else _GREEN if blob.kept else _RED
        half = np.array([0.5 * blob.width + 6.0, 0.5 * blob.height + 6.0])
        corners = [(round(blob.x + k * half[0]), round(blob.y + k * half[1])) for k in (-1, 1)]
        cv2.rectangle(picture, corners[0], corners[1], colour, 2)
        said = f"{math.degrees(blob.bearing_rad):.1f} deg" if blob.kept else blob.reason
        place = (corners[0][0], max(corners[0][1] - 6, 16))
        cv2.putText(picture, said, place, cv2.FONT_HERSHEY_SIMPLEX, 0.6, colour, 2, cv2.LINE_AA)
    return picture


def _paint(picture: Image, reduced: BoolArray, colour: tuple[int, int, int]) -> None:
    """Colour what `reduced` (h, w) says, in the full-size picture."""
    for row, column in np.argwhere(reduced):
        y, x = SCALE * row + SCALE // 2, SCALE * column
        picture[y : y + 2, x : x + SCALE] = colour
