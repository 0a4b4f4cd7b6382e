"""How likely a sensor is to detect a teammate where it is supposed to be (eq. 18–23, 29–30).

And how likely what is there stays within the sensors' reach (eq. 10).

The factors of the thesis, each repaired: range (a curve), blind sectors (a product over the
pillars), occlusion (nearer things in the way) and interference (nothing comes back).
"""

import math

import numpy as np
from scipy.special import expit

from host.config import Cameras, FilterSettings, Lidar
from host.estimator.gaussians.gaussian_mixture import WEIGHT, Y
from host.geometry import SECTORS, polar, sector, wrap
from host.messages import BoolArray, FloatArray

_LEAST, _MOST = 0.01, 0.98  # a detection probability is never certain either way
_HIDDEN = 0.2  # behind something nearer, which may hide it in part only
_HIDDEN_STRIP = 0.2  # the cameras look over the lidar: a nearer teammate hides most of a strip
_NULL_LOSS = 0.95  # eq. 23: how much less likely a detection is where nothing comes back
_BELIEVED = 0.5  # from this existence on a thing can hide another
_FADE_S = 1.0  # mean survival beyond the survival range
_RAYS = np.linspace(-1.0, 1.0, 7)
_MARGIN_M = 0.12  # nearer by less than this does not hide


def clearance_of(
    bearing: FloatArray, distance: FloatArray, present: BoolArray, width: float
) -> FloatArray:
    """How far one sees past targets (n,) that are `width` m wide: (SECTORS,) m, inf in the open.

    present (n,): targets that are believed in. Serves where no scan measured it: for the cameras,
    and for a lidar that only gives positions.
    """
    clearance = np.full(SECTORS, math.inf)
    index = present.nonzero()[0]
    index = index.take((-distance.take(index)).argsort())
    near = distance.take(index)[:, None]
    # The nearest is written last. Seven rays leave no sector out beyond 0.6 m for a turret.
    rays = bearing.take(index)[:, None] + _RAYS * (0.5 * width / np.maximum(near, width))
    place = (rays * (SECTORS / math.tau) + 1.5 * SECTORS).astype(np.int64) % SECTORS
    clearance[place] = near
    return clearance


def surroundings(
    rows: FloatArray, width: float, clearance: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Bearing (n,) rad and distance (n,) m of things; how far one sees in every sector.

    rows (6, n) as in `gaussian_mixture`, the weight how surely each is there. width m: of what
    hides others. clearance (SECTORS,) m: as the scan measured it; None: worked out from the things.
    """
    distance, bearing = polar(rows[: Y + 1].T)
    if clearance is None:
        clearance = clearance_of(bearing, distance, rows[WEIGHT] > _BELIEVED, width)
    return bearing, distance, clearance


def survival(x: FloatArray, y: FloatArray, dt: float, settings: FilterSettings) -> FloatArray:
    """p_S (n,) over dt: Perera eq. 10 as a hazard, so that it does not depend on the rate."""
    far = np.hypot(x, y) > settings.survival_range_m
    return np.asarray(np.exp(-dt / settings.survival_s - far * (dt / _FADE_S)))


def _range_curve(
    distance: FloatArray, most: float, half_range: float, steepness: float
) -> FloatArray:
    """Eq. 19 and 30 in their common form: `most` close by, half of it at `half_range` m."""
    return np.asarray(most * expit(steepness * (half_range - distance)))


def in_view(bearing: FloatArray, view: tuple[float, float]) -> BoolArray:
    """Which bearings (n,) rad a picture of this view (centre, half width, rad) shows."""
    centre, half_width = view
    if half_width >= math.pi:
        return np.ones(len(bearing), dtype=bool)
    return np.asarray(np.abs(wrap(bearing - centre)) <= half_width)


def beside_sectors(bearing: FloatArray, centres: FloatArray, half_widths: FloatArray) -> FloatArray:
    """Eq. 20 (n,), repaired: how far from the blind sectors (k,), each a pillar of the robot's own.

    A product over the pillars, 0 at the middle of one; bearing (n,), all in rad.
    """
    offset = wrap(bearing[:, None] - centres) / half_widths
    return np.asarray(np.prod(1.0 - np.exp(-0.5 * offset * offset), axis=1))


class LidarModel:
    """Detection probability of the lidar's turret finder, and its clutter intensity in 1/m²."""

    def __init__(self, config: Lidar) -> None:
        self._config = config
        self._centres = np.array([s.centre_rad for s in config.blind_sectors])
        self._half_widths = np.array([s.width_rad / 2.0 for s in config.blind_sectors])
        self.close_by = config.detection_probability  # in plain view
        self.clutter = config.clutter_per_m2

    def detection(
        self,
        bearing: FloatArray,
        distance: FloatArray,
        clearance: FloatArray,
        measured: bool,
    ) -> FloatArray:
        """P_D (n,) of targets at bearing (n,) rad in [-pi, pi] and distance (n,) m (eq. 18).

        clearance (SECTORS,) m; measured: it comes from the scan itself, so that a sector which
        sees nothing at all means interference, and one that ends at the target is not clear.
        """
        config = self._config
        probability = _range_curve(
            distance,
            self.close_by,
            config.half_range_m,
            config.range_steepness_per_m,
        )
        if len(self._centres):
            probability *= beside_sectors(bearing, self._centres, self._half_widths)
        beyond = clearance.take(sector(bearing)) - distance  # how much further one sees there
        factor = 1.0 - (1.0 - _HIDDEN) * (beyond < -_MARGIN_M)
        if measured:
            factor -= _NULL_LOSS * np.isinf(beyond)
        within = (distance >= config.min_range_m) & (distance <= config.max_range_m)
        if config.field_of_view_rad < math.tau:
            within &= np.abs(bearing) <= 0.5 * config.field_of_view_rad
        probability *= factor * within
        return np.minimum(np.maximum(probability, _LEAST), _MOST)


class CameraModel:
    """Detection probability of the cameras, and their clutter intensity in 1/rad."""

    def __init__(self, config: Cameras) -> None:
        self._config = config
        self.clutter = config.clutter_per_rad

    def detection(
        self,
        bearing: FloatArray,
        distance: FloatArray,
        clearance: FloatArray,
        view: tuple[float, float],
    ) -> FloatArray:
        """P_D (n,) of teammates at bearing (n,) rad in [-pi, pi] and distance (n,) m (eq. 29).

        view: of the picture, as in Bearings; outside of it the probability is 0.
        """
        config = self._config
        probability = _range_curve(
            distance,
            config.detection_probability,
            config.half_range_m,
            config.range_steepness_per_m,
        )
        hidden = clearance[sector(bearing)] < distance - _MARGIN_M
        seen = probability * np.where(hidden, _HIDDEN_STRIP, 1.0)
        return np.minimum(np.maximum(seen, _LEAST), _MOST) * in_view(bearing, view)
