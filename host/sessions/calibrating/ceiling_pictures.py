"""Tags in the pictures of a ceiling camera: from a folder, a film, or the camera as it runs."""

import itertools
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np

from host.calibration.ceiling.edges import at_edges
from host.config import Ceiling
from host.drivers.camera.driver import CameraDriver, Picture
from host.drivers.camera.files import RecordedFile
from host.drivers.natnet.client import MOCAP
from host.errors import UserError
from host.messages import FloatArray, Health, Image
from host.perception.aruco import TagFinder

_SUFFIXES = (".jpg", ".jpeg", ".png")
_MOST_HZ = 5.0  # that a camera that runs is looked at
_DAMAGED_IN_A_ROW = 10  # pictures of a film, and it is over
_MOST_TAGS = 2000


def tags_in_file(path: Path, ceiling: Ceiling) -> FloatArray:
    """Corners (n, 4, 2) px of the tags in a folder of pictures, an MJPEG or an AVI file.

    Of many every second, third, ... is given. Raises UserError for what cannot be read, or is of
    another size.
    """
    finder, found, number = TagFinder(ceiling), [], 0
    for name, grey in _folder(path) if path.is_dir() else _film(path, ceiling):
        eye, number = ceiling.eye, number + 1
        if grey.shape != (eye.height_px, eye.width_px):
            raise UserError(
                f"{name} has {grey.shape[1]} x {grey.shape[0]} px",
                f"[mocap.ceiling.eye] says {eye.width_px} x {eye.height_px} px",
                "give pictures of that camera at that size",
            )
        found.append(at_edges(grey, finder.corners(grey)[1]))
    if not number:
        raise UserError(f"there are no pictures in {path}", f"none of *{', *'.join(_SUFFIXES)}")
    corners = np.concatenate(found)
    return corners[:: -(-len(corners) // _MOST_TAGS) or 1]


def _folder(path: Path) -> Iterator[tuple[str, Image]]:
    for each in sorted(path.iterdir()):
        if each.suffix.lower() in _SUFFIXES:
            try:
                data = each.read_bytes()
            except OSError as error:
                why = error.strerror or str(error)
                raise UserError(f"cannot read the picture {each}", why, "remove it") from error
            yield str(each), _decoded(str(each), data)


def _film(path: Path, ceiling: Ceiling) -> Iterator[tuple[str, Image]]:
    ticks = itertools.count()
    # A clock that runs faster than any film: each picture is due at once.
    film = RecordedFile(str(path), ceiling.eye.rate_hz, lambda: 100.0 * next(ticks))
    damaged, stop = 0, threading.Event()
    try:
        while damaged < _DAMAGED_IN_A_ROW:
            frame = film.read(stop)
            damaged = 0 if frame else damaged + 1
            if frame:
                yield str(path), _decoded(str(path), frame.jpeg)
    finally:
        film.close()


def _decoded(name: str, data: bytes) -> Image:
    grey = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE) if data else None
    if grey is None:
        raise UserError(f"{name} is no picture", "it cannot be decoded", "remove it")
    return np.asarray(grey, dtype=np.uint8)


def tags_seen_live(
    ceiling: Ceiling, stop: threading.Event, show: Callable[[int, str], None]
) -> FloatArray:
    """Corners (n, 4, 2) px of the tags that the camera sees until `stop` is set.

    show: gets the number of tags so far and how the camera does, once per second. Raises UserError
    where there is no camera.
    """
    if ceiling.eye.source == "none":
        raise UserError(
            "there is no ceiling camera",
            'source is "none" in [mocap.ceiling.eye] of robot.toml',
            "name its device there, or give its pictures with --pictures",
        )
    finder, found = TagFinder(ceiling), [np.zeros((0, 4, 2))]

    def take(message: Picture | Health) -> None:
        if isinstance(message, Health):
            show(sum(map(len, found)), message.reason)
        else:
            grey = _decoded("a picture", message.jpeg)
            found.append(at_edges(grey, finder.corners(grey)[1]))

    CameraDriver(MOCAP, ceiling.eye, 0.0, ceiling.mains_hz, _MOST_HZ).run(take, stop)
    return np.concatenate(found)
