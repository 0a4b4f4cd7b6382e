"""Pictures of a checkerboard → focal length, centre, k1 and k2 of a lens that sees 180 degrees.

All views are fitted at once, each with its own pose of the board (Kannala and Brandt 2006, part
IV). Rays stand where other calibrations have points of a picture plane, so corners at and past
90 deg off the axis count like any other. Pixels are square.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from pydantic import ValidationError
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from host.calibration.robust.statistics import plane_sigma
from host.config import Camera
from host.config.errors import explain_settings
from host.errors import UserError
from host.messages import BoolArray, FloatArray, Image
from host.perception.lens import Lens, equidistant_limit, equidistant_radius

_LEAST_VIEWS, _LEAST_CORNERS = 3, 8
_START_WIDTHS = np.geomspace(0.15, 1.2, 13)  # focal lengths tried first, in widths of the picture
_SOFT_PX = 0.5  # the first fit trusts corners less from this error on
_OUTLIER_SIGMAS, _OUTLIER_PX = 6.0, 2.0  # a corner beyond both was not where it was taken to be
_MOST_STEPS = 100
_WRONG_PX = 5.0  # no lens of this model explains the corners


@dataclass(frozen=True, slots=True)
class BoardView:
    """The corners of one picture. board (n, 2) m: on the board; pixels (n, 2): in the picture."""

    board: FloatArray
    pixels: FloatArray


@dataclass(frozen=True, slots=True)
class LensFit:
    """A fitted equidistant lens.

    camera: the given one with the fitted focal length, centre, k1 and k2. poses (v, 6): of the
    board in each view, as rotation vector (rad) and translation (m), board → camera frame. Of the
    corners of all views: errors (n, 2) px, drawn minus seen; used (n,), False for those left out;
    angles (n,) rad, how far off the axis they were.
    """

    camera: Camera
    poses: FloatArray
    errors: FloatArray
    used: BoolArray
    angles: FloatArray

    @property
    def rms_px(self) -> float:
        """Root of the mean squared distance between drawn and seen corners, of those used."""
        return math.sqrt(float(np.mean(np.sum(self.errors[self.used] ** 2, axis=1))))

    @property
    def reach_rad(self) -> float:
        """The farthest used corner's angle off the axis: beyond it the lens is extrapolated."""
        return float(np.max(self.angles[self.used]))


def find_corners(grey: Image, columns: int, rows: int) -> FloatArray | None:
    """Inner corners (columns * rows, 2) px of a checkerboard, row by row; None if not all are seen.

    grey (height, width). Which corner comes first is arbitrary, and does not matter to a fit.
    """
    found, corners = cv2.findChessboardCornersSB(
        grey, (columns, rows), flags=cv2.CALIB_CB_EXHAUSTIVE
    )
    return np.asarray(corners, dtype=float).reshape(-1, 2) if found else None


def board_corners(columns: int, rows: int, square_m: float) -> FloatArray:
    """Inner corners (columns * rows, 2) m of a board, in the order of `find_corners`."""
    y, x = np.mgrid[:rows, :columns]
    return square_m * np.stack((x.ravel(), y.ravel()), axis=1).astype(float)


def fit_lens(views: Sequence[BoardView], camera: Camera) -> LensFit:
    """Fit the lens of `camera`, of which only the picture's size is trusted.

    A corner is left out if the robust first fit misses it by more than 2 px and by more than 6
    times the spread of all. Raises UserError where the views do not determine a lens.
    """
    _check(views)
    corners = _Corners(views)
    start = _start(corners, views, camera)
    rough = corners.solve(start, np.full(len(corners.seen), True), "soft_l1")
    miss = np.hypot(*corners.errors(rough).T)
    if np.median(miss) > _WRONG_PX:
        raise _not_a_lens(f"the best lens misses half of the corners by {np.median(miss):.0f} px")
    used = miss <= max(_OUTLIER_PX, _OUTLIER_SIGMAS * plane_sigma(miss))
    fitted = corners.solve(rough, used, "linear")
    fit = LensFit(
        _camera_of(fitted, camera),
        fitted[5:].reshape(-1, 6),
        corners.errors(fitted),
        used,
        corners.draw(fitted)[1],
    )
    if fit.rms_px > _WRONG_PX:
        raise _not_a_lens(f"the best lens misses the corners by {fit.rms_px:.1f} px")
    if equidistant_limit(fit.camera.k1, fit.camera.k2) < fit.reach_rad:
        raise _not_a_lens("the best lens draws the outermost corners twice")
    return fit


def _check(views: Sequence[BoardView]) -> None:
    few = [view for view in views if len(view.pixels) < _LEAST_CORNERS]
    if len(views) < _LEAST_VIEWS or few:
        raise UserError(
            "there are too few corners to fit a lens to",
            f"{len(views)} pictures, {len(few)} of them with fewer than {_LEAST_CORNERS} corners; "
            f"{_LEAST_VIEWS} are needed",
            "take 10 pictures of the board or more, tilted, at the middle and at every border",
        )


def _not_a_lens(why: str) -> UserError:
    return UserError(
        "no lens fits these corners",
        why,
        "check the number of the board's inner corners, and that all pictures are of one camera",
    )


class _Corners:
    """All corners in one row, and what a fit asks of them.

    Values (5 + 6 v,) of a fit: focal length, centre x, y (px), k1, k2, then the pose of each view.
    """

    def __init__(self, views: Sequence[BoardView]) -> None:
        counts = [len(view.pixels) for view in views]
        self.board = np.concatenate([view.board for view in views])
        self.seen = np.concatenate([view.pixels for view in views])
        self._owner = np.repeat(np.arange(len(views)), counts)

    def draw(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Pixels (n, 2) of the corners and their angles off the axis (n,)."""
        focal, centre, (k1, k2) = values[0], values[1:3], values[3:5]
        poses = values[5:].reshape(-1, 6)
        rotating = Rotation.from_rotvec(poses[:, :3]).as_matrix()[self._owner]
        rays = np.einsum("nij,nj->ni", rotating[:, :, :2], self.board) + poses[self._owner, 3:]
        across = np.hypot(rays[:, 0], rays[:, 1])
        angles = np.arctan2(across, rays[:, 2])
        # A fit passes lenses that fold back on its way: no limit, and so no nan, is set here.
        radii = focal * equidistant_radius(angles, k1, k2)
        return centre + (radii / np.maximum(across, 1e-12))[:, None] * rays[:, :2], angles

    def errors(self, values: FloatArray) -> FloatArray:
        """Drawn minus seen, (n, 2) px."""
        return np.asarray(self.draw(values)[0] - self.seen)

    def solve(
        self, start: FloatArray, used: BoolArray, loss: Literal["linear", "soft_l1"]
    ) -> FloatArray:
        """The values that draw the `used` (n,) corners where they were seen, as `loss` weighs."""
        found = least_squares(
            lambda values: self.errors(values)[used].ravel(),
            start,
            x_scale="jac",
            loss=loss,
            f_scale=_SOFT_PX,
            max_nfev=_MOST_STEPS,
        )
        return np.asarray(found.x)


def _start(corners: _Corners, views: Sequence[BoardView], camera: Camera) -> FloatArray:
    """Values to begin with: the plain lens, of many focal lengths, that explains the views best."""
    middle = (0.5 * (camera.width_px - 1), 0.5 * (camera.height_px - 1))
    best, best_miss = None, math.inf
    for focal in _START_WIDTHS * camera.width_px:
        lens = Lens(_plain(camera, focal, middle))
        poses = [_pose(view.board, lens.unproject(view.pixels)) for view in views]
        values = np.concatenate(([focal, *middle, 0.0, 0.0], *poses))
        if not np.isfinite(values).all():
            continue
        miss = float(np.median(np.hypot(*corners.errors(values).T)))
        if miss < best_miss:
            best, best_miss = values, miss
    if best is None:
        raise _not_a_lens("corners lie farther from the middle of the picture than any lens draws")
    return best


def _plain(camera: Camera, focal: float, centre: tuple[float, float]) -> Camera:
    changes = {"lens": "equidistant", "focal_px": float(focal), "k1": 0.0, "k2": 0.0}
    changes |= {"centre_x_px": centre[0], "centre_y_px": centre[1]}
    return camera.model_copy(update=changes)


def _camera_of(values: FloatArray, camera: Camera) -> Camera:
    focal, x, y, k1, k2 = (float(value) for value in values[:5])
    settings = _plain(camera, focal, (x, y)).model_dump() | {"k1": k1, "k2": k2}
    try:
        return type(camera).model_validate(settings)
    except ValidationError as error:
        raise _not_a_lens(f"of the best one, {explain_settings(error, type(camera))}") from error


def _pose(board: FloatArray, rays: FloatArray) -> FloatArray:
    """Pose (6,) of a plane from `rays` (n, 3) to its points `board` (n, 2), nan where a ray is.

    By a pinhole camera that looks at the middle of the board, since the lens sees past 90 deg.
    """
    if not np.isfinite(rays).all():
        return np.full(6, math.nan)
    x, y, z = rays.mean(axis=0)
    angle, across = math.atan2(math.hypot(x, y), z), max(math.hypot(x, y), 1e-12)
    look = Rotation.from_rotvec(angle / across * np.array([y, -x, 0.0]))
    ahead = look.apply(rays)
    if ahead[:, 2].min() <= 0.0:
        return np.full(6, math.nan)
    points = np.column_stack((board, np.zeros(len(board))))
    found, rotating, place = cv2.solvePnP(
        points, ahead[:, :2] / ahead[:, 2:], np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
    )
    if not found or not np.isfinite(np.hstack((rotating, place))).all():
        return np.full(6, math.nan)
    pose = look.inv() * Rotation.from_rotvec(rotating.ravel())
    return np.concatenate((pose.as_rotvec(), look.inv().apply(place.ravel())))
