"""Pixels of strips and true places of teammates → lenses, mountings and the cameras' delay.

Whose strip a pixel is, and whether it is one at all, is unknown: each is taken for the teammate
that would be drawn nearest, within a bound that shrinks as the fit gets better. Both cameras are
fitted at once, for they share one delay. What is not observable is held near what was configured,
by a prior that the covariance includes.
"""

import copy
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from host.calibration.camera.model import (
    LENS_NAMES,
    NAMES,
    Pairs,
    camera_of,
    draw,
    equidistant,
    errors,
    off_by,
    row_of,
    slopes,
)
from host.calibration.camera.noise import (
    GATE_SIGMAS,
    Noise,
    Weighing,
    Whitening,
    likely,
    measured,
    softened,
)
from host.calibration.camera.pairs import CAMERAS, LEAST_PAIRS, Reference, Strips
from host.calibration.camera.search import likely_starts
from host.calibration.camera.uncertainty import covariance_of
from host.config import Camera, Cameras
from host.messages import BoolArray, FloatArray
from host.perception.lens import Lens

# How far (std) a lens and its mounting may be from what is configured.
_PRIOR = np.array([100.0, 60.0, 60.0, 0.15, 0.05, 0.5, 0.3, 0.2, 0.1, 0.1, 0.1])
_PRIOR_DELAY_S = 0.5
_SHIFT_S = 0.02  # over which velocities are taken

_GATES = (150.0, 70.0, 35.0, 18.0, 9.0)  # of pairs, px
_ROUNDS = 2  # of weighing and solving at one gate
_STEPS = 4  # of a solution
_BORDER_PX = 5.0  # a blurred edge, and a reduced pixel
_FARTHEST_RAD, _MARGIN_PX = math.radians(115.0), 150.0  # where a strip may be drawn at all


@dataclass(frozen=True, slots=True)
class CameraFit:
    """Both cameras as fitted.

    values (23,): those named by NAMES for each of CAMERAS, then the delay found (s). covariance
    (23, 23). used (n,): pairs that the fit rests upon. noise: of their errors. cameras: what the
    values say. fitted (2,): whether a camera had enough pairs; one that had not is as it was.
    """

    values: FloatArray
    covariance: FloatArray
    pairs: Pairs
    used: BoolArray
    noise: Noise
    cameras: tuple[Camera, Camera]
    fitted: tuple[bool, bool]

    @property
    def delay(self) -> float:
        """What was found beyond the configured delay, s."""
        return float(self.values[-1])


class CameraProblem:
    """Strips, a reference for them and what is configured: all that a fit needs.

    lenses: cameras whose lens (focal length, centre, k1, k2) is known already, and held. mean,
    spread (23,): the prior, of what is configured and how far (std) it may be off.
    """

    def __init__(
        self, strips: Strips, reference: Reference, cameras: Cameras, lenses: Mapping[str, Camera]
    ) -> None:
        self.strips, self.cameras, self._lenses = strips, cameras, lenses
        self._reference = reference
        lenses_of = [lenses.get(name, equidistant(getattr(cameras, name))) for name in CAMERAS]
        # Where it is mounted says the configuration alone.
        mounted = [getattr(cameras, name) for name in CAMERAS]
        rows = [
            [getattr(lens if k < LENS_NAMES else mount, name) for k, name in enumerate(NAMES)]
            for lens, mount in zip(lenses_of, mounted, strict=True)
        ]
        self.mean = np.array([*rows[0], *rows[1], 0.0])
        self.spread = np.concatenate((_PRIOR, _PRIOR, [_PRIOR_DELAY_S]))
        self._free = np.full(len(self.mean), True)
        for number, name in enumerate(CAMERAS):
            if name in lenses:
                self._free[len(NAMES) * number :][:LENS_NAMES] = False

    def fit(self) -> CameraFit:
        """Search, then refine from the two likeliest delays; the fit that explains more."""
        lenses_known = tuple(name in self._lenses for name in CAMERAS)
        starts = likely_starts(self.strips, self._reference, self.cameras, self.mean, lenses_known)
        found = [self._refine(start, _GATES) for start in starts]
        return min(found, key=lambda fit: self.cost(fit.values, fit.pairs))

    def again(self, start: CameraFit, chosen: BoolArray) -> CameraFit | None:
        """The fit of the `chosen` (n,) strips alone, from another's result; None: too few."""
        strips = Strips(
            self.strips.times[chosen], self.strips.cameras[chosen], self.strips.pixels[chosen]
        )
        part = CameraProblem(strips, self._reference, self.cameras, self._lenses)
        fit = part.near(start.values)
        return fit if fit.fitted == start.fitted else None

    def near(self, start: FloatArray) -> CameraFit:
        """The fit from values (23,) near by, without a search."""
        return self._refine(start, _GATES[-2:])

    def against(self, reference: Reference) -> "CameraProblem":
        """The same with another reference."""
        other = copy.copy(self)
        other._reference = reference
        return other

    def cost(self, values: FloatArray, pairs: Pairs) -> float:
        """Mean over all strips of how badly they are explained, 0 to 1; unpaired ones count 1."""
        off = off_by(values, pairs)
        explained = 1.0 / (1.0 + (off / _GATES[-1]) ** 2)
        return float(np.mean(1.0 - np.where(pairs.paired, explained, 0.0)))

    def pair(self, values: FloatArray) -> Pairs:
        """Take each strip for the teammate that `values` draw nearest to it."""
        times, delay = self.strips.times - values[-1], float(values[-1])
        places = self._reference.positions(times)
        count, width = places.shape[:2]
        mounts = values[:-1].reshape(len(CAMERAS), -1)[self.strips.cameras, 8:11]
        points = self._middles(places, mounts)
        off = np.full((count, width), math.inf)
        for number in range(len(CAMERAS)):
            mine = self.strips.cameras == number
            drawn = self._in_view(values, number, points[mine].reshape(-1, 3))
            gap = drawn.reshape(-1, width, 2) - self.strips.pixels[mine][:, None]
            miss = np.hypot(gap[..., 0], gap[..., 1])
            off[mine] = np.where(np.isfinite(miss), miss, math.inf)
        every = np.arange(count)
        nearest = np.argmin(off, axis=1) if width else np.zeros(count, dtype=int)
        paired = off[every, nearest] < math.inf if width else np.zeros(count, dtype=bool)
        ahead = self._reference.positions(times, _SHIFT_S)
        behind = self._reference.positions(times, -_SHIFT_S)
        speed = np.zeros((count, 3))
        chosen = np.zeros((count, 3))
        if width:
            speed[:, :2] = ((ahead - behind) / (2.0 * _SHIFT_S))[every, nearest]
            chosen = points[every, nearest]
        paired &= np.isfinite(speed).all(axis=1) & ~self._cut(values, chosen)
        speed[~paired], chosen[~paired] = 0.0, (1.0, 0.0, 0.0)
        sigmas = np.hypot(1.0, self._reference.noise_m * self._px_per_m(values, chosen))
        headings = np.where(paired, self._reference.headings(times), 0.0)
        return Pairs(self.strips, chosen, speed, sigmas, paired, nearest, headings, delay)

    def _cut(self, values: FloatArray, points: FloatArray) -> BoolArray:
        """Which strips (n,) at `points` (n, 3) m the border of the picture cuts.

        What is seen of them lies up to 4 px nearer to the picture's middle than the strip does.
        """
        strip, cameras = self.cameras.strip, self.cameras
        size = self._px_per_m(values, points)[:, None]
        half = 0.5 * np.array([strip.diameter_m, strip.tall_m]) * size
        sizes = [(c.width_px, c.height_px) for c in (cameras.front, cameras.rear)]
        last = np.array(sizes)[self.strips.cameras] - 1.0
        inside = np.minimum(self.strips.pixels, last - self.strips.pixels)
        return np.asarray((inside < half + _BORDER_PX).any(axis=1))

    def _middles(self, places: FloatArray, mounts: FloatArray) -> FloatArray:
        """Where the middles (n, m, 3) of what is seen of strips look to be, from `mounts` (n, 3).

        places (n, m, 2): of the strips' axes; all in m. Of a cylinder its near half is seen: on
        average, by the width at which each part appears, it is pi/4 of the radius nearer than the
        axis. A strip's middle is that of the elevations of its edges, which near the camera is not
        the elevation of its middle. Taken for the middle of the axis, it makes cameras 3 mm too
        high.
        """
        strip = self.cameras.strip
        offset, height = places - mounts[:, None, :2], mounts[:, 2:]
        away = np.maximum(np.hypot(offset[..., 0], offset[..., 1]), 0.1)
        nearer = math.pi / 8.0 * strip.diameter_m
        upper, lower = (
            np.arctan2(strip.height_m + half - height, away - nearer)
            for half in (0.5 * strip.tall_m, -0.5 * strip.tall_m)
        )
        level = height + (away - nearer) * np.tan(0.5 * (upper + lower))
        return np.concatenate(
            (places - nearer * offset / away[..., None], level[..., None]), axis=2
        )

    def _in_view(self, values: FloatArray, number: int, points: FloatArray) -> FloatArray:
        """Pixels (n, 2) of points (n, 3); nan for what one camera cannot show."""
        camera = camera_of(values, number, self.cameras)
        pixels, angles = draw(row_of(values, number), points)
        size = np.array([camera.width_px, camera.height_px])
        shown = ((pixels > -_MARGIN_PX) & (pixels < size + _MARGIN_PX)).all(axis=1)
        shown &= angles < min(_FARTHEST_RAD, Lens(camera).limit_rad)
        return np.asarray(np.where(shown[:, None], pixels, math.nan))

    def _px_per_m(self, values: FloatArray, points: FloatArray) -> FloatArray:
        """How large (n,) a metre at `points` (n, 3) m is drawn."""
        rows = values[:-1].reshape(len(CAMERAS), -1)[self.strips.cameras]
        away = np.maximum(np.linalg.norm(points - rows[:, 8:11], axis=1), 0.1)
        return np.asarray(rows[:, 0] / away)

    def _refine(self, values: FloatArray, gates: tuple[float, ...]) -> CameraFit:
        free, values = self._free, values.copy()  # a camera's values may be put back, below
        for gate in gates:
            for _ in range(_ROUNDS):
                pairs = self.pair(values)
                free = self._known(pairs.paired)
                values = self._solve(values, pairs, *softened(values, pairs, gate), free)
        noise = Noise(gates[-1] / GATE_SIGMAS)
        used = np.zeros(0, dtype=bool)
        for _ in range(3 * _ROUNDS):
            pairs, used = self.chosen(values, noise)
            free = self._known(used)
            if used.any():
                independent = Whitening(values, pairs, used, noise)
                values = self._solve(values, pairs, used, independent, free)
                noise = measured(values, pairs, used, free, noise)
        # What a camera without pairs enough went through on the way is worth nothing.
        fitted = [bool(free[len(NAMES) * n + LENS_NAMES]) for n in range(len(CAMERAS))]
        for number, enough in enumerate(fitted):
            if not enough:
                row_of(values, number)[:] = row_of(self.mean, number)
        used &= np.array(fitted)[self.strips.cameras]
        return self._result(values, pairs, used, noise, free, (fitted[0], fitted[1]))

    def chosen(self, values: FloatArray, noise: Noise) -> tuple[Pairs, BoolArray]:
        """The pairs by `values`, and which of them (n,) are right, by a noise that they have."""
        pairs = self.pair(values)
        return pairs, likely(values, pairs, noise)

    def _known(self, paired: BoolArray) -> BoolArray:
        """Which values to fit: those of cameras with pairs enough."""
        free = self._free.copy()
        for number in range(len(CAMERAS)):
            if np.count_nonzero(paired & (self.strips.cameras == number)) < LEAST_PAIRS:
                free[len(NAMES) * number :][: len(NAMES)] = False
        return free

    def _solve(
        self, start: FloatArray, pairs: Pairs, used: BoolArray, weighed: Weighing, free: BoolArray
    ) -> FloatArray:
        """Values that draw the pairs `used` (n,) where they were seen, after a few steps."""
        prior = np.diag(1.0 / self.spread)[free][:, free]

        def whole(part: FloatArray) -> FloatArray:
            values = start.copy()
            values[free] = part
            return values

        def misses(part: FloatArray) -> FloatArray:
            values = whole(part)
            drawn = weighed(errors(values, pairs)[used]).ravel()
            return np.concatenate((drawn, ((values - self.mean) / self.spread)[free]))

        def jacobian(part: FloatArray) -> FloatArray:
            rows = weighed(slopes(whole(part), pairs)[used][:, :, free])
            return np.concatenate((rows.reshape(-1, rows.shape[2]), prior))

        if not free.any() or not used.any():
            return start
        found = least_squares(misses, start[free], jac=jacobian, x_scale="jac", max_nfev=_STEPS)
        return whole(found.x)

    def _result(
        self,
        values: FloatArray,
        pairs: Pairs,
        used: BoolArray,
        noise: Noise,
        free: BoolArray,
        fitted: tuple[bool, bool],
    ) -> CameraFit:
        covariance = np.diag(np.where(self._free, self.spread, 0.0) ** 2)
        if used.any() and free.any():
            covariance = covariance_of(covariance, values, pairs, used, noise, free)
        first, second = (camera_of(values, number, self.cameras) for number in range(len(CAMERAS)))
        return CameraFit(values, covariance, pairs, used, noise, (first, second), fitted)
