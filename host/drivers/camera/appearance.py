"""How a picture looks as a whole, by which exposure and health are judged."""

from dataclasses import astuple, dataclass

import numpy as np
import simplejpeg

_REDUCED = 8  # along a side: the most that libjpeg can
_WHITE = 250


@dataclass(frozen=True, slots=True)
class Appearance:
    """Of 255. level: three quarters of the picture are darker, whose black surround that a
    fisheye may have. brightest: of all but the brightest hundredth. contrast: between the
    darkest twentieth and that. white: share of pixels without detail. warmth: red less blue,
    as share of the mean.
    """

    level: float
    brightest: float
    contrast: float
    white: float
    warmth: float


def look_at(jpeg: bytes) -> Appearance | None:
    """How a picture looks; None where it is not whole."""
    try:
        height, width, *_ = simplejpeg.decode_jpeg_header(jpeg)
        picture = simplejpeg.decode_jpeg(
            jpeg, "RGB", min_width=-(-width // _REDUCED), min_height=-(-height // _REDUCED)
        )
    except ValueError:
        return None
    means = picture.reshape(-1, 3).mean(axis=0)
    luma = picture.mean(axis=2)
    dark, level, brightest = np.percentile(luma, (5.0, 75.0, 99.0))
    return Appearance(
        level=float(level),
        brightest=float(brightest),
        contrast=float(brightest - dark),
        white=float(np.mean(luma >= _WHITE)),
        warmth=float((means[0] - means[2]) / max(means.mean(), 1.0)),
    )


def mean_of(looks: list[Appearance]) -> Appearance:
    """The mean of several pictures."""
    values = np.mean([astuple(look) for look in looks], axis=0)
    return Appearance(*(float(value) for value in values))
