"""Where both cameras look and how late they are, by bearings alone: where a fit may begin.

How high a strip is drawn says little before the lens is known.
"""

import math

import numpy as np

from host.calibration.camera.model import NAMES, camera_of
from host.calibration.camera.pairs import CAMERAS, LEAST_PAIRS, Reference, Strips
from host.config import Camera, Cameras
from host.messages import FloatArray
from host.perception.lens import View

_HEADINGS = np.radians(np.arange(-32.0, 33.0, 4.0))  # beside the configured one
_FOCALS = np.array([0.85, 0.92, 1.0, 1.08, 1.17])  # times the configured one
_DELAY_STEP_S, _LONGEST_DELAY_S = 0.04, 1.0
_NEAR_RAD = math.radians(4.0)  # a strip this far from a teammate counts half
_STRIPS = 200  # of each camera
_APART_S = 0.12  # delays nearer to each other are refined to the same


def likely_starts(
    strips: Strips,
    reference: Reference,
    cameras: Cameras,
    mean: FloatArray,
    lenses_known: tuple[bool, ...],
) -> list[FloatArray]:
    """Two sets of values (23,) as in `fit.CameraFit`, of the two likeliest delays.

    In each, the heading and the focal length of each camera are those that bring most strips near a
    teammate; all else is as in `mean` (23,). lenses_known (2,): cameras whose focal length is held.
    """
    longest = _LONGEST_DELAY_S - cameras.delay_s
    delays = np.arange(-cameras.delay_s, longest + 1e-9, _DELAY_STEP_S)
    total = np.zeros(len(delays))
    best = np.tile(mean, (len(delays), 1))
    best[:, -1] = delays
    for number in range(len(CAMERAS)):
        mine = np.flatnonzero(strips.cameras == number)
        mine = mine[:: max(1, len(mine) // _STRIPS)]
        if len(mine) < LEAST_PAIRS:
            continue
        start = len(NAMES) * number
        camera = camera_of(mean, number, cameras)
        focals = np.ones(1) if lenses_known[number] else _FOCALS
        seen = _azimuths(camera, focals, strips.pixels[mine])
        for k, delay in enumerate(delays.tolist()):
            places = reference.positions(strips.times[mine] - delay)
            true = np.arctan2(places[..., 1] - camera.y_m, places[..., 0] - camera.x_m)
            score, which, heading = _aim(true, seen)
            total[k] += len(mine) * score
            best[k, start] *= focals[which]
            best[k, start + NAMES.index("heading_rad")] += heading
    first = int(np.argmax(total))
    total[np.abs(delays - delays[first]) < _APART_S] = -1.0
    return [best[first], best[int(np.argmax(total))]]


def _azimuths(camera: Camera, focals: FloatArray, pixels: FloatArray) -> FloatArray:
    """Azimuths (f, k) rad of pixels (k, 2), for a focal length times each of `focals`."""
    rows = []
    for focal in focals.tolist():
        view = View(camera.model_copy(update={"focal_px": camera.focal_px * focal}))
        x, y, _ = view.directions_of(pixels).T
        rows.append(np.arctan2(y, x))
    return np.array(rows)


def _aim(true: FloatArray, seen: FloatArray) -> tuple[float, int, float]:
    """The best score (0 to 1), which of the focal lengths has it, and the heading error (rad).

    true (k, m) rad: azimuths of all teammates, nan where unknown; seen (f, k) rad: of strips.
    """
    off = true.T[:, None] - seen  # (teammates, focal lengths, strips)
    cos, sin = np.nan_to_num(np.cos(off)), np.nan_to_num(np.sin(off))  # unknown: a right angle
    best = (-1.0, 0, 0.0)
    for heading in _HEADINGS.tolist():
        near = np.max(math.cos(heading) * cos + math.sin(heading) * sin, axis=0, initial=-1.0)
        # The squared chord stands for the squared angle.
        scores = np.mean(1.0 / (1.0 + 2.0 * (1.0 - near) / _NEAR_RAD**2), axis=1)
        k = int(np.argmax(scores))
        if scores[k] > best[0]:
            best = (float(scores[k]), k, heading)
    return best
