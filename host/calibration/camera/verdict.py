"""Whether a calibration of the cameras will do, and what to do where it will not."""

import math
from collections.abc import Mapping

import numpy as np
from pydantic import ValidationError

from host.calibration.camera.bearing_errors import (
    LEAST_VIEWS,
    BearingSector,
    difference,
    sectors_in_words,
    sectors_of,
    sectors_without_views,
)
from host.calibration.camera.fit import CameraFit
from host.calibration.camera.pairs import CAMERAS
from host.calibration.result import Check, at_least, at_most
from host.calibration.stamps import delay_check
from host.config import Camera, Cameras
from host.config.errors import explain_settings
from host.perception.lens import equidistant_limit

_SIGMA_RAD, _HALVES_RAD = math.radians(0.3), math.radians(1.0)  # of bearings
_DELAY_S, _USED_SHARE = 0.010, 0.4

Halves = tuple[CameraFit, CameraFit] | None


def verdict(
    cameras: Cameras, fit: CameraFit, halves: Halves, table: Mapping[int, list[BearingSector]]
) -> tuple[Check, ...]:
    """Every condition on the fit. halves: of the fit; table: each camera's sectors, by number."""
    checks = []
    sigma = math.sqrt(fit.covariance[-1, -1])
    for number, found in table.items():
        checks.append(_views(CAMERAS[number], found))
        if fit.fitted[number]:
            checks += [
                _bearings(CAMERAS[number], found, sigma <= _DELAY_S),
                _explained(fit, number),
                *_sound(fit, number),
            ]
    return (
        *checks,
        at_most("sigma of the delay", sigma, _DELAY_S, "ms").otherwise(
            "rotate the robot to the left and to the right while teammates are in view: "
            "at one constant speed a delay looks like a camera that is mounted askew"
        ),
        delay_check("delay of the cameras", cameras.delay_s + fit.delay, sigma),
        _agreement(cameras, halves, table),
    )


def _views(name: str, found: list[BearingSector]) -> Check:
    gaps = sectors_without_views(found) or f"{name} camera shows no strip anywhere as it is mounted"
    return at_least(
        f"{name} camera: sectors with views",
        sum(sector.pairs >= LEAST_VIEWS for sector in found),
        max(len(found), 1),
        "sectors",
    ).otherwise(f"{gaps}; drive so that a teammate comes by there, near and far")


def _bearings(name: str, found: list[BearingSector], timed: bool) -> Check:
    seen = [sector for sector in found if sector.pairs >= LEAST_VIEWS]
    bad = [sector for sector in seen if not sector.sigma_rad <= _SIGMA_RAD]
    return at_most(
        f"{name} camera: sigma of a bearing, worst sector",
        float(np.max([sector.sigma_rad for sector in seen])) if seen else math.inf,
        _SIGMA_RAD,
        "deg",
    ).otherwise(
        f"{name} camera knows bearings badly {sectors_in_words(bad, found)}: record for longer, "
        "with teammates there, near (0.5 m) and far (2 m)"
        if timed
        else "as long as the delay is not known, neither is where the camera looks: rotate both "
        "ways, at more than one speed, with teammates in view"
    )


def _explained(fit: CameraFit, number: int) -> Check:
    return at_least(
        f"{CAMERAS[number]} camera: strips where a teammate was",
        float(np.mean(fit.used[fit.pairs.strips.cameras == number])),
        _USED_SHARE,
        "%",
    ).otherwise(
        "take away what else has the strip's colour, or narrow the colour; check the strip's "
        "height in [camera.strip], and motion capture for bodies it loses"
    )


def _sound(fit: CameraFit, number: int) -> list[Check]:
    """Whether such a camera can be: its lens, and each of its values."""
    camera, name = fit.cameras[number], CAMERAS[number]
    try:
        Camera.model_validate(camera.model_dump())
        wrong = []
    except ValidationError as error:
        wrong = explain_settings(error, Camera).splitlines()
    return [
        at_least(
            f"{name} camera: half of the lens's field of view",
            equidistant_limit(camera.k1, camera.k2),
            math.radians(90.0),
            "deg",
        ).otherwise(
            "no such lens is built: bring teammates to the border of the picture, or give pictures "
            "of a checkerboard"
        ),
        at_most(f"{name} camera: values out of bounds", len(wrong), 0, "values").otherwise(
            f"{'; '.join(wrong)}; check that front and rear are not exchanged, and the "
            "strip's height in [camera.strip]"
        ),
    ]


def _agreement(cameras: Cameras, halves: Halves, table: Mapping[int, list[BearingSector]]) -> Check:
    """Whether both halves of the data give the same bearings, where both had views."""
    apart = math.inf
    if halves is not None:
        off = [np.zeros(0)]
        for number in table:
            both = [sectors_of(half, number, cameras) for half in halves]
            seen = [{s.first_deg for s in part if s.pairs >= LEAST_VIEWS} for part in both]
            chosen = [s for s in table[number] if s.first_deg in seen[0] & seen[1]]
            off.append(difference(*halves, number, chosen, cameras.strip.height_m))
        all_off = np.abs(np.concatenate(off))
        apart = float(np.percentile(all_off, 95)) if len(all_off) else math.inf
    return at_most(
        "difference of bearings between the halves (95 %)", apart, _HALVES_RAD, "deg"
    ).otherwise(
        "record for longer, with teammates all around in each half; if that does not help, look "
        "whether a camera is loose"
    )
