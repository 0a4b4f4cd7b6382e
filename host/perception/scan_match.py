"""How the robot moved between two scans, by what the scans show alone: point-to-line ICP.

Censi 2008, "An ICP variant using a point-to-line metric", with nearest neighbours instead of his
search along the scan.
"""

import math

import numpy as np
from scipy.spatial import cKDTree

from host.geometry import along_rays, to_parent
from host.messages import FloatArray, Scan

FEWEST_RETURNS = 60  # of a scan that can be compared with another

_NEIGHBOURS = 5  # of a return, on the line through it
_GATES_M = (0.5, 0.4, 0.3, 0.2, 0.15, 0.1, 0.08, 0.08)  # of one step after the other
_FEWEST_PAIRS = 30
_NEAR_M, _NEAR_SHARE = 0.05, 0.01  # a return fits within 5 cm and 1 % of its range
_SOME = 5  # every fifth return is enough for a first look
_HEADINGS = 36
_HEADING_STEP = math.tau / _HEADINGS
_CLEARLY = 0.1  # share of the returns
_RIDGE = 0.01  # a motion that no return speaks for, as along a corridor, stays as it was


def returns_of(scan: Scan, mounting: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Its returns (n, 2) m in the robot frame, each as the robot stood then; and when, (n,) s.

    mounting (3,): x, y (m) and heading (rad) of the lidar in the robot frame.
    """
    returned = scan.ranges > 0.0
    ranges, angles = scan.ranges[returned], scan.angles[returned]
    beams = along_rays((0.0, 0.0), angles, ranges)
    return to_parent(beams, mounting), scan.times[returned]


class Surroundings:
    """What one scan shows, to be compared with another. points (n, 2) m in the robot frame."""

    def __init__(self, points: FloatArray) -> None:
        self._points = points
        self._tree = cKDTree(points)
        self._normals: FloatArray | None = None

    def misfit(self, points: FloatArray, motion: FloatArray) -> float:
        """Share of the `points` (m, 2) of a later scan with nothing near them in this one.

        motion (3,): x, y (m) and heading (rad) of the later robot frame in this one's.
        """
        near = _NEAR_M + _NEAR_SHARE * np.hypot(*points.T)
        distances, _ = self._tree.query(to_parent(points, motion))
        return float(np.mean(distances > near))

    def rotation(self, points: FloatArray) -> FloatArray:
        """The rotation in place (3,), to 10 deg, that fits a later scan's `points` best.

        None, unless another one is clearly better: a square room looks alike four times around.
        """
        some = points[::_SOME]
        motions = np.column_stack((np.zeros((_HEADINGS, 2)), np.arange(_HEADINGS) * _HEADING_STEP))
        misfits = [self.misfit(some, motion) for motion in motions]
        best = int(np.argmin(misfits))
        chosen: FloatArray = motions[best if misfits[best] < misfits[0] - _CLEARLY else 0]
        return chosen

    def match(self, points: FloatArray, start: FloatArray) -> FloatArray:
        """The motion (3,) that brings the later scan's `points` (m, 2) onto this one's lines.

        start (3,): where the search begins. It finds what is within 0.3 m and 0.5 rad, mostly.
        """
        if self._normals is None:
            self._normals = self._lines()
        motion = np.array(start, dtype=float)
        for gate in _GATES_M:
            moved = to_parent(points, motion)
            distances, index = self._tree.query(moved, distance_upper_bound=gate)
            paired = np.isfinite(distances)
            if np.count_nonzero(paired) < _FEWEST_PAIRS:
                break
            moved, index = moved[paired], index[paired]
            normals = self._normals[index]
            off = np.sum((self._points[index] - moved) * normals, axis=1)
            arm = moved - motion[:2]
            swing = arm[:, 0] * normals[:, 1] - arm[:, 1] * normals[:, 0]
            jacobian = np.column_stack((normals, swing))
            information = jacobian.T @ jacobian + _RIDGE * len(off) * np.eye(3)
            motion += np.linalg.solve(information, jacobian.T @ off)
        return motion

    def _lines(self) -> FloatArray:
        """Unit normals (n, 2) of the line through each point and its neighbours."""
        _, index = self._tree.query(self._points, k=_NEIGHBOURS)
        around = self._points[index] - self._points[index].mean(axis=1, keepdims=True)
        xx, yy = np.mean(around**2, axis=1).T
        xy = np.mean(around[..., 0] * around[..., 1], axis=1)
        along = 0.5 * np.arctan2(2.0 * xy, xx - yy)
        return np.column_stack((-np.sin(along), np.cos(along)))
