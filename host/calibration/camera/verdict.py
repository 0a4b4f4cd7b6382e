"""Whether a calibration of the cameras will do, and what to do where it will not."""

import math
from collections.abc import Mapping

import numpy as np
from pydantic import ValidationError

from host.calibration.camera.bearing_errors import (
    LEAST_VIEWS,
    Sector,
    difference,
    gaps,
    in_words,
    sectors,
)
from host.calibration.camera.fit import CameraFit
from host.calibration.camera.pairs import EYES
from host.calibration.result import Check
from host.config import Camera, Cameras
from host.perception.lens import equidistant_limit

_SIGMA_DEG, _HALVES_DEG = 0.3, 1.0  # of bearings
_DELAY_MS, _USED_PERCENT = 15.0, 40.0

Halves = tuple[CameraFit, CameraFit] | None


def verdict(
    camera: Cameras, fit: CameraFit, halves: Halves, table: Mapping[int, list[Sector]]
) -> tuple[Check, ...]:
    """Every condition on the fit. halves: of the fit; table: the sectors of each eye, by number."""
    checks = []
    sigma = 1000.0 * math.sqrt(fit.covariance[-1, -1])
    for number, found in table.items():
        checks.append(_views(EYES[number], found))
        if fit.fitted[number]:
            checks += [
                _bearings(EYES[number], found, sigma <= _DELAY_MS),
                _explained(fit, number),
                *_sound(fit, number),
            ]
    checks.append(
        Check(
            name="sigma of the delay",
            value=sigma,
            threshold=_DELAY_MS,
            unit="ms",
            passed=sigma <= _DELAY_MS,
            advice="turn the robot to the left and to the right by turns while teammates are in "
            "view: at one constant speed a delay looks like a camera that is mounted askew",
        )
    )
    delay = 1000.0 * (camera.delay_s + fit.delay)
    if delay < -2.0 * sigma:
        checks.append(
            Check(
                name="delay of the cameras",
                value=delay,
                threshold=0.0,
                unit="ms",
                passed=False,
                advice="pictures cannot come before they are taken: motion capture is late, so set "
                "its own delay (mocap.ceiling.delay_s), or the clocks of a recording differ",
            )
        )
    return (*checks, _agreement(camera, fit, halves, table))


def _views(name: str, found: list[Sector]) -> Check:
    seen = sum(sector.pairs >= LEAST_VIEWS for sector in found)
    return Check(
        name=f"{name} camera: sectors with views",
        value=float(seen),
        threshold=float(len(found)),
        unit="sectors",
        passed=bool(found) and seen == len(found),
        advice=f"{gaps(found) or f'{name} camera shows no strip anywhere as it is mounted'}; "
        "drive so that a teammate comes by there, near and far",
    )


def _bearings(name: str, found: list[Sector], timed: bool) -> Check:
    seen = [sector for sector in found if sector.pairs >= LEAST_VIEWS]
    worst = max((math.degrees(sector.sigma_rad) for sector in seen), default=math.inf)
    bad = [sector for sector in seen if not math.degrees(sector.sigma_rad) <= _SIGMA_DEG]
    return Check(
        name=f"{name} camera: sigma of a bearing, worst sector",
        value=worst,
        threshold=_SIGMA_DEG,
        unit="deg",
        passed=bool(seen) and not bad,
        advice=f"{name} camera knows bearings badly {in_words(bad, found)}: record for longer, "
        "with teammates there, near (0.5 m) and far (2 m)"
        if timed
        else "as long as the delay is not known, neither is where the camera looks",
    )


def _explained(fit: CameraFit, number: int) -> Check:
    used = 100.0 * float(np.mean(fit.used[fit.pairs.strips.eyes == number]))
    return Check(
        name=f"{EYES[number]} camera: strips where a teammate was",
        value=used,
        threshold=_USED_PERCENT,
        unit="%",
        passed=used >= _USED_PERCENT,
        advice="take away what else has the strip's colour, or narrow the colour; check the "
        "strip's height in [camera.strip], and motion capture for bodies it loses",
    )


def _sound(fit: CameraFit, number: int) -> list[Check]:
    """What is wrong with an eye in itself: at most one failed check each for lens and values."""
    eye, name = fit.eyes[number], EYES[number]
    limit = math.degrees(equidistant_limit(eye.k1, eye.k2))
    checks = [
        Check(
            name=f"{name} camera: the lens reaches off its axis",
            value=limit,
            threshold=90.0,
            unit="deg",
            passed=limit >= 90.0,
            advice="no such lens is built: bring teammates to the border of the picture, or give "
            "pictures of a checkerboard",
        )
    ]
    try:
        Camera.model_validate(eye.model_dump())
    except ValidationError as error:
        wrong = ", ".join(str(detail["loc"][0]) for detail in error.errors())
        checks.append(
            Check(
                name=f"{name} camera: values out of all bounds",
                value=float(error.error_count()),
                threshold=0.0,
                unit="values",
                passed=False,
                advice=f"{wrong} cannot be; check that front and rear are not exchanged, and the "
                "strip's height in [camera.strip]",
            )
        )
    return checks


def _agreement(
    camera: Cameras, fit: CameraFit, halves: Halves, table: Mapping[int, list[Sector]]
) -> Check:
    """Whether both halves of the data give the same bearings, where both had views."""
    apart = math.inf
    if halves is not None:
        off = [np.zeros(0)]
        for number in table:
            both = [sectors(half, number, camera) for half in halves]
            seen = [{s.first_deg for s in part if s.pairs >= LEAST_VIEWS} for part in both]
            chosen = [s for s in table[number] if s.first_deg in seen[0] & seen[1]]
            off.append(difference(*halves, number, chosen, camera.strip.height_m))
        all_off = np.abs(np.concatenate(off))
        apart = math.degrees(float(np.percentile(all_off, 95))) if len(all_off) else math.inf
    return Check(
        name="bearings by the halves of the data, apart (95 %)",
        value=apart,
        threshold=_HALVES_DEG,
        unit="deg",
        passed=apart <= _HALVES_DEG,
        advice="record for longer, with teammates all around in each half; if that does not help, "
        "look whether a camera is loose",
    )
