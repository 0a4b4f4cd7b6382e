"""Corners of tags in pictures → lens and mounting of the camera under the ceiling.

All tags lie level at one known height and have one known size. So a camera that is right draws
each as a square of that size, wherever it lies: how far the corners are from that of the square
that fits them best is what is made small. Where the floor's origin and axes are is free, since
nothing but the camera's own mounting says so: x_m, y_m and the heading are kept.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from host.calibration.robust.statistics import plane_sigma, sandwich
from host.config import Camera, Ceiling
from host.messages import BoolArray, FloatArray
from host.perception.aruco import on_plane, square_at, squares
from host.perception.lens import View

LENS = ("focal_px", "centre_x_px", "centre_y_px", "k1", "k2")
NAMES = (*LENS, "z_m", "lean_x_rad", "lean_y_rad")
"""Of the values of a fit; the last two rotate the camera about the floor's x- and y-axis."""
# How far (std) they may be from what is configured; the height is measured by hand.
_PRIOR = np.array([200.0, 60.0, 60.0, 0.3, 0.2, 0.01, 0.2, 0.2])
_STEPS = np.array([0.1, 0.1, 0.1, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4])
_SOFT_PX, _OUTLIER_SIGMAS, _LEAST_NOISE_PX = 0.5, 5.0, 0.02
_INSIDE_PX = 0.03  # std by which the edges of all tags are found too far inside or outside
_NOWHERE_PX = 100.0  # the error of a corner that the lens does not draw
_GRID = 9  # points a side at which places on the floor are judged


@dataclass(frozen=True, slots=True)
class CeilingFit:
    """values (8,) by NAMES, covariance (8, 8); ceiling: what they say.

    errors (n, 4, 2) px: of the tags' corners, drawn minus seen. used (n,): tags that it rests upon.
    """

    values: FloatArray
    covariance: FloatArray
    ceiling: Ceiling
    errors: FloatArray
    used: BoolArray

    @property
    def rms_px(self) -> float:
        """Of the distances of drawn from seen corners, of the tags used."""
        return math.sqrt(float(np.mean(np.sum(self.errors[self.used] ** 2, axis=-1))))


class CeilingProblem:
    """Corners (n, 4, 2) px of tags and what is configured; lens_known: it is held."""

    def __init__(self, corners: FloatArray, ceiling: Ceiling, lens_known: bool) -> None:
        self.corners, self.ceiling = corners, ceiling
        self.start = np.array([*(getattr(ceiling.eye, name) for name in (*LENS, "z_m")), 0.0, 0.0])
        self._free = np.full(len(NAMES), True)
        self._free[: len(LENS)] = not lens_known

    def fit(self) -> CeilingFit:
        """Trusting far corners less first, then without the tags that miss by 5 sigmas."""
        every = np.full(len(self.corners), True)
        values = self._solve(self.start, every, 1.0, "soft_l1")
        used = every
        for _ in range(3):
            miss = np.hypot(*np.moveaxis(self.errors(values), -1, 0))
            noise = max(plane_sigma(miss[used].ravel()), _LEAST_NOISE_PX)
            used = miss.max(axis=1) < _OUTLIER_SIGMAS * noise
            values = self._solve(values, used, noise, "linear")
        covariance = self._covariance(values, used, noise)
        return CeilingFit(values, covariance, self.with_(values), self.errors(values), used)

    def part(self, chosen: BoolArray) -> "CeilingProblem":
        """The same of the `chosen` (n,) tags alone."""
        return CeilingProblem(self.corners[chosen], self.ceiling, not self._free[0])

    def with_(self, values: FloatArray) -> Ceiling:
        """The configuration as the values (8,) have it."""
        eye = self.ceiling.eye
        update = dict(zip((*LENS, "z_m"), values[:6].tolist(), strict=True))
        if values[6:].any():
            update |= _angles(Rotation.from_rotvec([*values[6:], 0.0]).as_matrix(), eye)
        return self.ceiling.model_copy(update={"eye": eye.model_copy(update=update)})

    def errors(self, values: FloatArray) -> FloatArray:
        """Of the corners (n, 4, 2) px: where squares of the true size would be, minus seen."""
        ceiling = self.with_(values)
        view = View(ceiling.eye)
        floor = on_plane(view, self.corners.reshape(-1, 2), ceiling.tag_height_m)
        fitted = square_at(squares(floor.reshape(-1, 4, 2)), ceiling.tag_m)
        high = np.full((*fitted.shape[:2], 1), ceiling.tag_height_m)
        drawn = view.pixels_of(np.concatenate((fitted, high), axis=2).reshape(-1, 3))
        return np.nan_to_num(drawn.reshape(self.corners.shape) - self.corners, nan=_NOWHERE_PX)

    def _solve(self, start: FloatArray, used: BoolArray, noise: float, loss: str) -> FloatArray:
        def whole(part: FloatArray) -> FloatArray:
            values = start.copy()
            values[self._free] = part * _STEPS[self._free] + start[self._free]
            return values

        def misses(part: FloatArray) -> FloatArray:
            values = whole(part)
            held = (values - self.start) / _PRIOR
            return np.concatenate((self.errors(values)[used].ravel() / noise, held[self._free]))

        zero = np.zeros(int(self._free.sum()))
        scale = _SOFT_PX if loss != "linear" else 1.0
        found = least_squares(
            misses, zero, loss=loss, f_scale=scale, diff_step=1e-3, x_scale="jac", max_nfev=30
        )
        return whole(found.x)

    def _slopes(self, values: FloatArray) -> FloatArray:
        """Derivatives (n, 4, 2, 8) of the errors."""
        found = np.zeros((*self.corners.shape, len(NAMES)))
        for k in np.flatnonzero(self._free):
            step = np.zeros(len(NAMES))
            step[k] = _STEPS[k]
            found[..., k] = (self.errors(values + step) - self.errors(values - step)) / (
                2.0 * _STEPS[k]
            )
        return found

    def _covariance(self, values: FloatArray, used: BoolArray, noise: float) -> FloatArray:
        """Covariance (8, 8): one tag's corners may err together, those of different ones do not."""
        free = np.ix_(self._free, self._free)
        slopes = self._slopes(values)[used].reshape(int(used.sum()), 8, len(NAMES)) / noise
        off = self.errors(values)[used].reshape(-1, 8) / noise
        held = np.diag(_PRIOR**-2.0)[free]
        bread = np.linalg.inv(np.einsum("nij,nik->jk", slopes, slopes)[free] + held)
        gains = np.einsum("nij,ni->nj", slopes, off)[:, self._free]
        covariance = np.zeros((len(NAMES), len(NAMES)))
        # What is wrong alike at all tags moves the fit as a whole: the scale above all.
        outward = self.corners[used] - self.corners[used].mean(axis=1, keepdims=True)
        outward *= math.sqrt(2.0) / np.linalg.norm(outward, axis=-1, keepdims=True)
        pull = np.einsum("nij,ni->j", slopes, outward.reshape(-1, 8) / noise)[self._free]
        pulled = _INSIDE_PX * bread @ pull
        covariance[free] = sandwich(bread, gains.T @ gains + held) + np.outer(pulled, pulled)
        return covariance

    def place_sigmas(self, fit: CeilingFit) -> FloatArray:
        """Std (k,) m of places of tags relative to each other, all over the picture.

        What moves or rotates all places alike is no error: the floor's origin is the camera's.
        """
        eye = fit.ceiling.eye
        x, y = np.meshgrid(
            np.linspace(0.0, eye.width_px - 1.0, _GRID),
            np.linspace(0.0, eye.height_px - 1.0, _GRID),
        )
        pixels = np.column_stack((x.ravel(), y.ravel()))
        here = self._places(fit.values, pixels)
        known = np.isfinite(here).all(axis=1)
        moved = np.zeros((2 * int(known.sum()), len(NAMES)))
        for k, step in enumerate(np.diag(_STEPS)):
            there = self._places(fit.values + step, pixels)
            moved[:, k] = np.nan_to_num((there - here)[known] / _STEPS[k]).ravel()
        rigid = np.zeros((len(moved), 3))
        rigid[0::2, 0] = rigid[1::2, 1] = 1.0
        rigid[0::2, 2], rigid[1::2, 2] = -here[known, 1], here[known, 0]
        moved -= rigid @ np.linalg.lstsq(rigid, moved, rcond=None)[0]
        variances = np.einsum("ni,ij,nj->n", moved, fit.covariance, moved)
        return np.asarray(np.sqrt(variances.reshape(-1, 2).sum(axis=1)))

    def _places(self, values: FloatArray, pixels: FloatArray) -> FloatArray:
        ceiling = self.with_(values)
        return on_plane(View(ceiling.eye), pixels, ceiling.tag_height_m)


def _angles(rotation: FloatArray, eye: Camera) -> dict[str, float]:
    """The mounting's angles (rad) after rotating the camera by `rotation` (3, 3) on the floor."""
    right, down, axis = (rotation @ View(eye).to_robot).T
    heading = math.atan2(axis[1], axis[0])
    # Of a level, unrolled camera of that heading the picture's right.
    level = np.array([math.sin(heading), -math.cos(heading), 0.0])
    return {
        "heading_rad": heading,
        "tilt_rad": math.asin(min(max(-axis[2], -1.0), 1.0)),
        "roll_rad": math.atan2(-float(down @ level), float(right @ level)),
    }
