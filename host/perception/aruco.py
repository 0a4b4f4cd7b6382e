"""Grey picture of a camera under the ceiling → ArUco tags on the floor.

A tag's height above the floor is known, so each of its corners lies where that corner's ray meets
the plane at that height. The tag's pose is that of the square of known size that fits the four
best. The middle of the four in the picture would be off: perspective draws the nearer half larger.
"""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import cv2
import numpy as np

from host.config import Ceiling
from host.errors import UserError
from host.geometry import wrap
from host.messages import Bodies, FloatArray, Image, IntArray
from host.perception.lens import View

_Detect = Callable[[Image], tuple[Sequence[Any], Any, Any]]

_SIZE_TOLERANCE = 0.1  # of a tag's side: a side longer or shorter is no tag's, or another tag's
# Upper left, upper right, lower right, lower left corner in halves of a side, as complex numbers:
# right as printed is the tag's x-axis, up its y-axis.
_SQUARE = np.array([-1 + 1j, 1 + 1j, 1 - 1j, -1 - 1j])


class TagFinder:
    """Finds the tags in pictures of one ceiling camera.

    counts: tags found; misread: squares that are not as large on the floor as a tag; doubled:
    pictures' tags left out as their number was seen twice. side_m: the median side of all squares
    in the last picture that had one. Raises UserError where OpenCV came without ArUco.
    """

    def __init__(self, config: Ceiling) -> None:
        self._config = config
        self._view = View(config.eye)
        self._detect = _detector(config.dictionary)
        self.counts = Counter(tags=0, misread=0, doubled=0)
        self.side_m = math.nan

    def find(self, grey: Image, time: float) -> Bodies:
        """The tags in a picture (height, width) as bodies at `time` (s), by their numbers.

        A body's heading is the direction in which its tag's upper edge, as printed, runs to the
        right. Tags of a wrong size and numbers seen twice are left out and counted.
        """
        identities, pixels = self.corners(grey)
        if not len(identities):
            return Bodies(time, identities, np.zeros((0, 3)))
        places = self.on_floor(pixels.reshape(-1, 2)).reshape(-1, 4, 2)
        corners = places @ np.array([1.0, 1.0j])
        sides = np.abs(np.roll(corners, -1, axis=1) - corners)
        self.side_m = float(np.median(sides))
        whole = np.all(np.abs(sides / self._config.tag_m - 1.0) <= _SIZE_TOLERANCE, axis=1)
        known, times_seen = np.unique(identities[whole], return_counts=True)
        good = whole & np.isin(identities, known[times_seen == 1])
        self.counts["misread"] += int(np.sum(~whole))
        self.counts["doubled"] += int(np.sum(whole & ~good))
        self.counts["tags"] += int(np.sum(good))
        order = np.flatnonzero(good)[np.argsort(identities[good])]
        return Bodies(time, identities[order], squares(places[order]))

    def corners(self, grey: Image) -> tuple[IntArray, FloatArray]:
        """Numbers (n,) of the tags in a picture, and where their corners (n, 4, 2) px are.

        Upper left, upper right, lower right, lower left, as printed.
        """
        quads, numbers, _ = self._detect(grey)
        if numbers is None or not len(numbers):
            return np.zeros(0, dtype=np.int64), np.zeros((0, 4, 2))
        identities = np.asarray(numbers, dtype=np.int64).ravel()
        return identities, np.asarray(quads, dtype=float).reshape(-1, 4, 2)

    def on_floor(self, pixels: FloatArray) -> FloatArray:
        """Where the rays of `pixels` (n, 2) meet the plane of the tags: (n, 2) m on the floor.

        nan where they do not, because they run level, or away from it.
        """
        return on_plane(self._view, pixels, self._config.tag_height_m)


def on_plane(view: View, pixels: FloatArray, height_m: float) -> FloatArray:
    """Where the rays of `pixels` (n, 2) meet the plane at a height: (n, 2) m; nan where nowhere."""
    rays = view.directions_of(pixels)
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (height_m - view.origin[2]) / rays[:, 2]
        along = np.where(along > 0.0, along, math.nan)
    return np.asarray(view.origin[:2] + along[:, None] * rays[:, :2])


def squares(places: FloatArray) -> FloatArray:
    """Poses (n, 3) of the squares that fit corners (n, 4, 2) best (Umeyama 1991, in the plane).

    With complex numbers for points the rotation is the angle of their correlation.
    """
    corners = places @ np.array([1.0, 1.0j])
    middle = corners.mean(axis=1)
    heading = wrap(np.angle(corners @ _SQUARE.conj()))
    return np.stack((middle.real, middle.imag, heading), axis=1)


def square_at(poses: FloatArray, side_m: float) -> FloatArray:
    """Corners (n, 4, 2) m of squares at poses (n, 3): the way back of `squares`."""
    x, y, heading = poses.T
    corners = (x + 1j * y)[:, None] + 0.5 * side_m * np.exp(1j * heading)[:, None] * _SQUARE
    return np.stack((corners.real, corners.imag), axis=-1)


def _detector(dictionary: str) -> _Detect:
    """OpenCV's search for tags, by the names it has had since 4.7 or by those before."""
    if not hasattr(cv2, "aruco"):
        raise UserError(
            "this OpenCV cannot find tags",
            f"opencv {cv2.__version__} came without ArUco",
            'pip install "opencv-python-headless>=4.7"',
        )
    aruco: Any = cv2.aruco
    tags = aruco.getPredefinedDictionary(getattr(aruco, f"DICT_{dictionary}"))
    modern = hasattr(aruco, "ArucoDetector")
    settings = aruco.DetectorParameters() if modern else aruco.DetectorParameters_create()
    # The smallest window, 3 pixels, finds the noise and takes half of the time.
    settings.adaptiveThreshWinSizeMin = 13
    settings.cornerRefinementMethod = aruco.CORNER_REFINE_SUBPIX
    settings.cornerRefinementMinAccuracy = 0.01
    settings.cornerRefinementMaxIterations = 50
    settings.cornerRefinementWinSize = 3  # the old default, 5, reaches into a small tag's cells
    if modern:
        detect: _Detect = aruco.ArucoDetector(tags, settings).detectMarkers
        return detect
    # Else the edge of the paper around a tag is taken for the tag.
    settings.minMarkerDistanceRate = 0.02
    return lambda grey: aruco.detectMarkers(grey, tags, parameters=settings)
