"""Corners of tags where the lines along their sides meet.

A search for corners puts them, in a picture that is a little blurred, a fifth of a pixel inside:
tags look smaller by a hundredth, and the camera a hundredth higher. Edges stay where they are.
"""

import cv2
import numpy as np

from host.messages import FloatArray, Image

_ALONG = np.linspace(0.15, 0.85, 15)  # of a side, away from its corners
_ACROSS = np.linspace(-1.0, 1.0, 17)
_REACH, _REACH_PX = 0.08, (1.5, 5.0)  # across a side: a share of it, within bounds


def at_edges(grey: Image, corners: FloatArray) -> FloatArray:
    """The corners (n, 4, 2) px of dark squares on white, by the edges near them."""
    found = corners.copy()
    for place, quad in enumerate(corners):
        following = np.roll(quad, -1, axis=0)
        along = following - quad
        length = np.hypot(*along.T)
        normal = np.column_stack((along[:, 1], -along[:, 0])) / length[:, None]
        middle = quad.mean(axis=0)
        outward = np.sign(np.sum(normal * (0.5 * (quad + following) - middle), axis=1))
        normal *= outward[:, None]
        points = quad[:, None] + _ALONG[:, None] * along[:, None]
        reach = float(np.clip(_REACH * length.mean(), *_REACH_PX))
        points += _offsets(grey, points, normal, reach)[..., None] * normal[:, None]
        lines = _lines(points)
        # A corner is where its own side meets the one before.
        met = np.cross(np.roll(lines, 1, axis=0), lines)
        if met[:, 2].all() and np.abs(met[:, :2] / met[:, 2:] - quad).max() < reach:
            found[place] = met[:, :2] / met[:, 2:]
    return found


def _offsets(grey: Image, points: FloatArray, normal: FloatArray, reach: float) -> FloatArray:
    """How far outward (4, m) px of points (4, m, 2) it gets bright, by the mean of the slope."""
    steps = reach * _ACROSS
    where = points[:, :, None] + steps[:, None] * normal[:, None, None]
    x, y = (where[..., k].reshape(-1, len(steps)).astype(np.float32) for k in (0, 1))
    light = cv2.remap(grey, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    rise = np.maximum(np.diff(light.astype(float), axis=1), 0.0)
    between = 0.5 * (steps[1:] + steps[:-1])
    middle = (rise @ between) / np.maximum(rise.sum(axis=1), 1e-9)
    return np.asarray(middle.reshape(points.shape[:2]))


def _lines(points: FloatArray) -> FloatArray:
    """Lines (4, 3) through points (4, m, 2), as homogeneous vectors: their cross product is where
    two of them meet, with a third component of 0 where they are parallel."""
    middle = points.mean(axis=1)
    normal = np.linalg.svd(points - middle[:, None])[2][:, 1]
    return np.column_stack((normal, -np.sum(normal * middle, axis=1)))
