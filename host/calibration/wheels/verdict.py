"""What was driven, and whether a calibration of the wheels made from it is to be used."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from host.calibration.chain import BODY
from host.calibration.result import Check, Fitted, Quantity, at_least, at_most
from host.calibration.wheels.fit import WINDOW_S, Fit
from host.calibration.wheels.model import GEOMETRY, LAGS, Drive, Windows, values_of, windows_of
from host.config import Mocap, Wheels
from host.geometry import wrap
from host.messages import FloatArray

LEAST_WAY_M, LEAST_TURN_RAD = 3.0, math.radians(150.0)
_RADIUS_LIMIT, _TRACK_LIMIT = 0.003, 0.0064  # relative
_PLACE_LIMIT_M, _HEADING_LIMIT_RAD = 0.005, math.radians(0.5)
_LEAST_USED = 0.6  # of the windows
_PLAUSIBLE = 0.15  # relative, of a radius
_TOO_ALIKE = 0.95  # correlation of the track with the difference of the radii
_LEAST_SPREAD = 0.08  # of `Coverage.spread`
_CURVE_S, _CURVES, _LEAST_CURVED = 0.5, (0.08, 0.75), 0.2  # of `Coverage.curved`
_RADIUS_VARIES, _TRACK_VARIES = 0.0005, 0.002  # std between kinds of paths, relative ...
_ALIKE = 1.3  # ... and so many times more where all curves are alike
_VAGUE = 0.4  # sigma of a noise, as a share of it
LAG = "odometry's delay behind motion capture"
KEYS = ("wheels.left_radius_m", "wheels.right_radius_m", "wheels.track_m", *BODY)
_NOISES = (
    ("distance_noise_m", "distance noise after 1 m", "mm"),
    ("heading_noise_rad", "heading noise after 1 rad", "deg"),
    ("drift_noise_rad", "heading noise after 1 m", "deg"),
)
_LEAST_NOISE = 0.001  # m, rad
BIN_S = 2.0


@dataclass(frozen=True, slots=True)
class Coverage:
    """What was driven, in windows of 2 s, by the true path.

    way_m; left_rad, right_rad: rotated each way; straight: share of the way without rotating.
    spread: how different the curves were: the standard deviation of the share that rotating has in
    the way of the wheels (0 straight on, 1 on the spot), over that way. 0 on a circle. curved:
    share of the time, in windows of 0.5 s, in curves: neither straight on nor on the spot.
    speeds, turn_rates (k,): m/s and rad/s in each window.
    """

    way_m: float
    left_rad: float
    right_rad: float
    straight: float
    spread: float
    curved: float
    speeds: FloatArray
    turn_rates: FloatArray


def coverage(drives: Sequence[Drive], track_m: float) -> Coverage:
    """What the drives hold of ways and rotations."""
    windows = windows_of(drives, BIN_S, BIN_S)
    if not len(windows):
        return Coverage(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, np.zeros(0), np.zeros(0))
    rotation = windows.moved[:, 2]
    way, side = _way_and_side(windows, track_m)
    share = side / np.maximum(way + side, 1e-9)
    short = windows_of(drives, _CURVE_S, _CURVE_S)
    each, rotating = _way_and_side(short.where(short.moving), track_m)
    part = rotating / np.maximum(each + rotating, 1e-9)
    weight = np.maximum(way + side, 1e-12)
    mean = np.average(share, weights=weight)
    return Coverage(
        float(way.sum()),
        float(rotation[rotation > 0.0].sum()),
        float(-rotation[rotation < 0.0].sum()),
        float(way[share < 0.05].sum() / max(way.sum(), 1e-9)),
        math.sqrt(np.average((share - mean) ** 2, weights=weight)),
        float(np.mean((part > _CURVES[0]) & (part < _CURVES[1]))) if len(part) else 0.0,
        way / BIN_S,
        rotation / BIN_S,
    )


def _way_and_side(windows: Windows, track_m: float) -> tuple[FloatArray, FloatArray]:
    """Way (w,) m of the middle between the wheels, and of each wheel about it."""
    x, y, rotation = windows.moved.T
    # The chord of an arc is shorter than the arc.
    way = np.hypot(x, y) / np.maximum(np.abs(np.sinc(rotation / math.tau)), 0.1)
    return way, 0.5 * track_m * np.abs(rotation)


def value_rows(
    found: Fit, halves: list[FloatArray] | None, wheels: Wheels, mocap: Mocap
) -> tuple[Fitted, ...]:
    values, sigmas = found.values.copy(), np.sqrt(np.diag(found.covariance))
    values[5] = wrap(values[5])
    pairs = np.zeros((6, 0))
    if halves is not None:
        # A heading near half a circle stays beside the other ones.
        apart = np.array([half[:6] for half in halves]) - found.values[:6]
        apart[:, 5] = wrap(apart[:, 5])
        pairs = (values[:6] + apart).T
    small = _RADIUS_LIMIT * wheels.left_radius_m
    shown = (
        ("left wheel's radius", small, "mm"),
        ("right wheel's radius", small, "mm"),
        ("track", _TRACK_LIMIT * wheels.track_m, "mm"),
        ("tracked body, forward", _PLACE_LIMIT_M, "mm"),
        ("tracked body, to the left", _PLACE_LIMIT_M, "mm"),
        ("tracked body, heading", _HEADING_LIMIT_RAD, "deg"),
    )
    before = values_of(wheels, mocap)
    rows = [
        Quantity(KEYS[k], name, unit, limit).row(values[k], sigmas[k], before[k], pairs[k])
        for k, (name, limit, unit) in enumerate(shown)
    ]
    lags = found.values[LAGS]
    share = np.full(len(lags), 1.0 / len(lags))
    lag = Quantity("", LAG, "ms", "the delay belongs to the recording and is not written")
    sigma = math.sqrt(share @ found.covariance[LAGS, LAGS] @ share)
    return (*rows, lag.row(lags.mean(), sigma))


def noise_rows(noises: FloatArray, sigmas: FloatArray, wheels: Wheels) -> tuple[Fitted, ...]:
    """The rows of the noises (3,) as `noise` has them; one that is too vague is not written."""
    rows = []
    for (key, name, unit), noise, sigma in zip(
        _NOISES, noises.tolist(), sigmas.tolist(), strict=True
    ):
        value = max(noise, _LEAST_NOISE) if math.isfinite(noise) else math.nan
        what = Quantity(f"wheels.{key}", name, unit, _VAGUE * value)
        if not sigma <= _VAGUE * value:
            why = "a noise that is too uncertain is kept as it was"
            what = Quantity("", f"{name} (too uncertain: kept)", unit, why)
        rows.append(what.row(value, sigma, getattr(wheels, key)))
    return tuple(rows)


def verdict(found: Fit, driven: Coverage, wheels: Wheels) -> tuple[Check, ...]:
    """The conditions under which the fit is to be used."""
    used = float(np.count_nonzero(found.used)) / max(len(found.used), 1)
    off = found.values[:2] / (wheels.left_radius_m, wheels.right_radius_m) - 1.0
    worst = int(np.argmax(np.abs(off)))
    rotations = [
        at_least(f"rotation to the {side}", angle, LEAST_TURN_RAD, "deg").otherwise(
            f"the robot rotates to the {side} by {abs(math.degrees(angle)):.0f} deg only: rotating "
            "one way, or going straight on, does not separate the track from the wheels' radii; "
            f"rotate to the {side} too"
        )
        for side, angle in (("left", driven.left_rad), ("right", driven.right_rad))
    ]
    return (
        at_least("distance driven", driven.way_m, LEAST_WAY_M, "m").otherwise(
            f"drive further than {LEAST_WAY_M:.0f} m: {driven.way_m:.1f} m so far"
        ),
        *rotations,
        at_most(
            "correlation of the track with the difference of the wheels",
            _track_correlation(found),
            _TOO_ALIKE,
        ).otherwise(
            "on this path a wider track looks like a larger wheel: rotate as much to the left as "
            "to the right, and drive straight in between"
        ),
        at_least("parts of the drive that fit together", used, _LEAST_USED, "%").otherwise(
            "the wheels slipped, the robot was pushed, or motion capture tracks something else: "
            "check that mocap.body is this robot, and drive slower on a clean floor"
        ),
        at_most(
            "difference of a radius from the configured one",
            abs(float(off[worst])),
            _PLAUSIBLE,
            "%",
        ).otherwise(
            f"the {('left', 'right')[worst]} wheel's radius comes out {100.0 * off[worst]:+.1f} % "
            "off: no wheel differs so much; measure its diameter, and check the gear and "
            "counts_per_turn in robot.toml; if the other wheel fits, this encoder may lose counts"
        ),
    )


def _track_correlation(found: Fit) -> float:
    """|correlation| of the track with the ratio of the radii, both relative."""
    rows = np.zeros((2, len(found.values)))
    rows[0, :2] = (1.0, -1.0) / found.values[:2]
    rows[1, 2] = 1.0
    both = rows @ found.covariance @ rows.T
    return abs(float(both[0, 1])) / math.sqrt(float(both[0, 0] * both[1, 1]))


def warnings(driven: Coverage) -> list[str]:
    """What may go wrong with a fit that is good for the drive it was made from."""
    if driven.spread < _LEAST_SPREAD:
        return [
            f"all curves are alike (spread {driven.spread:.2f}, {_LEAST_SPREAD:.2f} is needed): "
            "expect the fit to transfer badly to other paths; drive straight, in wide curves and "
            "on the spot as well"
        ]
    if driven.curved < _LEAST_CURVED:
        return [
            f"straight lines and rotations on the spot, curves for {100 * driven.curved:.0f} % of "
            "the time only: expect the fit to transfer badly to other paths; drive wide and "
            "narrow curves as well"
        ]
    return []


def with_other_paths(found: Fit, driven: Coverage) -> Fit:
    """The fit with a covariance that holds for other kinds of paths as well."""
    covariance = found.covariance.copy()
    covariance[GEOMETRY, GEOMETRY] += other_paths(found.values, driven)
    return dataclasses.replace(found, covariance=covariance)


def other_paths(values: FloatArray, driven: Coverage) -> FloatArray:
    """What of the covariance (3, 3) of radii and track is for other kinds of paths.

    Radii and track are effective values, of tyres that are pressed and scrub: on recorded sessions
    of one robot (free paths, circles, squares) tracks lay up to 0.5 % apart, several times what one
    kind of path shows. Where all curves were alike, least is known of others.
    """
    alike = 1.0 - min(driven.spread / _LEAST_SPREAD, 1.0)
    shares = np.array([_RADIUS_VARIES, _RADIUS_VARIES, _TRACK_VARIES * (1.0 + _ALIKE * alike)])
    return np.diag((shares * values[GEOMETRY]) ** 2)


def residuals(found: Fit) -> str:
    wrong = found.residuals[found.used]
    place, heading = np.sqrt(np.mean(wrong**2, axis=0))[[0, 2]]
    used = 100.0 * np.count_nonzero(found.used) / len(found.used)
    missed = f"{1e3 * place:.1f} mm along and {math.degrees(heading):.2f} deg"
    return (
        f"rms {missed} over {WINDOW_S:.0f} s, {len(found.used)} windows, {used:.0f} % of them used"
    )
