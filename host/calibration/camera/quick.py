"""Start values of the cameras' headings, places and delay, within seconds.

Belaroussi 2024, section 4.4: positions that a camera gives, by a strip's bearing and size, are
aligned with positions of the lidar or of motion capture by singular value decomposition. Other than
his, it has a guard against reflections, it finds wrong pairs, and it tries delays. A camera's lens
and tilt stay as they are, and so a start value is all that it gives.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from host.calibration.camera.pairs import CAMERAS, LEAST_PAIRS, Reference, reference_of
from host.calibration.gathered import Gathered
from host.calibration.result import Calibration, Fitted, Quantity, at_least
from host.calibration.robust.rigid_alignment import Alignment, align_robustly
from host.config import Camera
from host.errors import UserError
from host.geometry import along_rays, to_parent, wrap
from host.messages import FloatArray

_DELAYS_S = np.arange(-0.1, 0.405, 0.05)  # beyond the configured one
_GATES_M = (0.6, 0.4, 0.3)  # of a pair, in one round after the other
_MOST_POSITIONS = 400  # of a longer drive every second, third, ... is used
_LEAST_USED = 0.4
_START = "a start value: calibrate camera without --quick says how well it is known"


@dataclass(frozen=True, slots=True)
class Aligned:
    """How the positions of one camera have to be moved, and by how much it is later than known."""

    motion: Alignment
    delay_s: float

    @property
    def used(self) -> float:
        """Share of the positions that the alignment rests upon."""
        return float(np.mean(self.motion.inliers))

    def moved(self, camera: Camera) -> FloatArray:
        """x, y (m) and heading (rad) of the camera: (3,)."""
        (place,) = self.motion.apply(np.array([[camera.x_m, camera.y_m]]))
        return np.append(place, float(wrap(camera.heading_rad + self.motion.heading)))


def calibrate(gathered: Gathered) -> Calibration:
    """Align each camera with motion capture, or the lidar where there is none.

    Raises UserError where no camera gave enough positions.
    """
    config = gathered.config.camera
    reference = reference_of(gathered)
    aligned = {name: aligned_with(*seen_by(gathered, name), reference) for name in CAMERAS}
    found = {name: each for name, each in aligned.items() if each is not None}
    if not found:
        raise UserError(
            "the cameras cannot be aligned",
            f"none of them gave {LEAST_PAIRS} positions of strips that agree with a teammate's",
            "bring a teammate nearer, and check the strip's colour and height in [camera.strip]",
        )
    delay = float(np.median([each.delay_s for each in found.values()]))
    late = Quantity("camera.delay_s", "delay of the cameras", "ms", _START).row(
        max(config.delay_s + delay, 0.0), math.nan, config.delay_s
    )
    rows = [row for name, each in found.items() for row in _rows(name, getattr(config, name), each)]
    least = min(each.used for each in found.values())
    advice = "drive with one teammate in plain view, and check the strip's colour"
    return Calibration(
        kind="camera",
        fitted=(*rows, late),
        checks=(at_least("positions that agree", least, _LEAST_USED, "%").otherwise(advice),),
        residuals=", ".join(
            f"{name}: rms {1e3 * each.motion.rms:.0f} mm over {len(each.motion.inliers)} positions"
            for name, each in found.items()
        ),
        warnings=("a start value: the lens and the tilt stay as they are",),
        figures={"used": {name: each.used for name, each in found.items()}},
    )


def seen_by(gathered: Gathered, camera: str) -> tuple[FloatArray, FloatArray]:
    """Where a camera saw strips, by bearing and size: times (n,) s and positions (n, 2) m then."""
    times: list[float] = []
    positions = [np.zeros((0, 2))]
    for bearings in gathered.bearings:
        if bearings.camera == camera and bearings.ranges is not None:
            positions.append(along_rays(bearings.origin, bearings.bearings, bearings.ranges))
            times += [bearings.time] * len(bearings.ranges)
    step = -(-len(times) // _MOST_POSITIONS) or 1
    return np.array(times)[::step], np.concatenate(positions)[::step]


def aligned_with(times: FloatArray, positions: FloatArray, reference: Reference) -> Aligned | None:
    """The alignment at the delay at which the errors are least; None where there is none."""
    tried = []
    for delay in _DELAYS_S.tolist():
        teammates = reference.positions(times, -delay)
        motion = _align(positions, teammates)
        if motion is not None:
            tried.append((_cost(positions, teammates, motion.pose), delay, motion))
    if not tried:
        return None
    _, delay, motion = min(tried, key=lambda each: each[0])
    return Aligned(motion, delay)


def _align(positions: FloatArray, teammates: FloatArray) -> Alignment | None:
    """With each position's nearest teammate (n, m, 2), found again after every round."""
    pose = np.zeros(3)
    for gate in _GATES_M:
        nearest, apart = _nearest(to_parent(positions, pose), teammates)
        known = np.isfinite(apart)
        if np.count_nonzero(known) < LEAST_PAIRS:
            return None
        weights = np.where(known, 1.0 / np.sum(positions**2, axis=1), 0.0)
        partners = np.where(known[:, None], nearest, 0.0)
        try:
            motion = align_robustly(positions, partners, gate, pose, weights)
        except UserError:
            return None
        pose = motion.pose
    return motion


def _nearest(positions: FloatArray, teammates: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The nearest teammate (n, 2) of each position (n, 2), and how far (n,) m it is; inf: none."""
    apart = np.linalg.norm(teammates - positions[:, None], axis=2)
    apart = np.where(np.isfinite(apart), apart, math.inf)
    rows, best = np.arange(len(positions)), np.argmin(apart, axis=1)
    return teammates[rows, best], apart[rows, best]


def _cost(positions: FloatArray, teammates: FloatArray, pose: FloatArray) -> float:
    """Mean squared error relative to the distance, each cut off at that of the last gate."""
    _, apart = _nearest(to_parent(positions, pose), teammates)
    return float(np.mean(np.minimum(apart, _GATES_M[-1]) ** 2 / np.sum(positions**2, axis=1)))


def _rows(name: str, camera: Camera, aligned: Aligned) -> Sequence[Fitted]:
    values = aligned.moved(camera)
    sigmas = np.sqrt(np.diag(aligned.motion.covariance))
    labels = (
        ("x_m", "position x", "mm"),
        ("y_m", "position y", "mm"),
        ("heading_rad", "heading", "deg"),
    )
    return [
        Quantity(f"camera.{name}.{key}", f"{name} {label}", unit, _START).row(
            value, sigma, getattr(camera, key)
        )
        for (key, label, unit), value, sigma in zip(labels, values, sigmas, strict=True)
    ]
