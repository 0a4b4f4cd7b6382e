"""What the filter takes for given of a swarm, an observer and its sensor."""

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class IdPhdSettings:
    """The view: a robot within half_view_rad of straight ahead and reach_m is read in a frame with
    probability `detection`; a frame has `clutter` readings of nothing. area_m2: where they may be.

    headings: how many a new track starts with, all around. restart: how likely a reading is of a
    robot that a hypothesis has elsewhere. alike: readings of successive frames share errors, each
    counts as one in so many. gain_sigmas: how wrong, as shares, may be the odometry's distance and
    rotation of a teammate, and the observer's rotation.
    false_things: at most at once; false_birth: how likely a reading is of a new one.
    exchange: how likely, a second, two tags of the likeliest hypothesis are each other's.
    lost_m: sigma from which on a robot is nowhere. silent_s: without odometry for so long it has
    left. hypotheses: at most kept. known: readings have identities, to compare with.
    """

    detection: float = 0.9
    half_view_rad: float = math.pi
    reach_m: float = 3.0
    clutter: float = 0.05
    area_m2: float = 30.0
    headings: int = 12
    restart: float = 0.01
    exchange: float = 0.0
    alike: float = 1.0
    gain_sigmas: tuple[float, float, float] = (0.02, 0.02, 0.02)
    false_things: int = 2
    false_birth: float = 0.01
    lost_m: float = 1.5
    silent_s: float = 10.0
    hypotheses: int = 200
    known: bool = False
