"""What flows through swarmloc: one frozen dataclass a kind.

Every message carries `time`: the host's monotonic time of the measurement (not of its arrival),
in seconds. Lengths in metres, angles in radians, counter-clockwise positive, x forward, y left.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
Image = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Scan:
    """One revolution of the lidar, in its own frame (counter-clockwise, mounting not applied).

    time: end of the revolution. times (n,): of each sample. angles (n,) rad in [-pi, pi).
    ranges (n,) m, 0 where there was no return.
    """

    time: float
    times: FloatArray
    angles: FloatArray
    ranges: FloatArray


@dataclass(frozen=True, slots=True)
class Positions:
    """What the lidar may have seen of teammates, in the robot frame at `time`.

    positions (n, 2) m, covariances (n, 2, 2) m².
    lags (n,) s: how long before `time` each reading was made; None: all at `time`.
    clearance (k,) m: how far the lidar saw in each of k equal sectors that start at bearing -pi;
    inf where nothing came back, 0 where it did not look; None from a sensor that cannot tell.
    identities (n,): who was measured (-1 nobody), where a dataset knows; only the clairvoyant
    filter of the evaluation reads it.
    scores (n,): log likelihood ratio of a teammate against anything else, by how each looks; None
    from a sensor that does not tell.
    """

    time: float
    positions: FloatArray
    covariances: FloatArray
    lags: FloatArray | None = None
    clearance: FloatArray | None = None
    identities: IntArray | None = None
    scores: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class Bearings:
    """Directions in which the cameras saw a teammate's strip, in the robot frame at `time`.

    bearings (n,) rad, variances (n,) rad². origin (x, y) m: where the rays start.
    lag s: how long before `time` they were seen (not 0 once the localizer has carried them).
    identities as in `Positions`. view (centre, half width) rad: what the camera can see at all.
    ranges (n,) m, range_variances (n,) m²: from `origin`, by the size of the strip in the picture.
    camera: the camera that saw them, "front" or "rear"; pixels (n, 2): where in its picture.
    """

    time: float
    bearings: FloatArray
    variances: FloatArray
    origin: tuple[float, float] = (0.0, 0.0)
    lag: float = 0.0
    identities: IntArray | None = None
    view: tuple[float, float] = (0.0, math.pi)
    ranges: FloatArray | None = None
    range_variances: FloatArray | None = None
    camera: str = ""
    pixels: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class Displacement:
    """How the robot itself moved in the `interval` seconds that end at `time`.

    dx, dy (m) and dpsi (rad): its new pose in its own frame at the start of the interval.
    translation_variance (m², per axis) and heading_variance (rad²) are the odometry's noise.
    ticks: encoder counts (left, right) in the interval, where they are known.
    """

    time: float
    interval: float
    dx: float
    dy: float
    dpsi: float
    translation_variance: float = 0.0
    heading_variance: float = 0.0
    ticks: tuple[int, int] | None = None


@dataclass(frozen=True, slots=True)
class Estimate:
    """Where the teammates are, in the robot frame at `time`.

    positions (n, 2) m, covariances (n, 2, 2) m², weights (n,) expected teammates there,
    ages (n,) s since the last reading, labels (n,): numbers that stay with an estimate while it
    lives; they are rows on a screen, not identities. obstacles (k, 2) m with obstacle_covariances
    (k, 2, 2) m²: what the lidar took for a teammate and is none, seen now or minutes ago.
    """

    time: float
    positions: FloatArray
    covariances: FloatArray
    weights: FloatArray
    ages: FloatArray
    labels: IntArray
    obstacles: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    obstacle_covariances: FloatArray = field(default_factory=lambda: np.zeros((0, 2, 2)))


@dataclass(frozen=True, slots=True)
class TeammateOdometry:
    """How robot `identity` says over the link that it moved in the `interval` s that end at `time`.

    The rest as in `Displacement`. restarted: it began anew, what it sent before is void.
    """

    time: float
    identity: int
    interval: float
    dx: float
    dy: float
    dpsi: float
    translation_variance: float = 0.0
    heading_variance: float = 0.0
    restarted: bool = False

    @property
    def step(self) -> Displacement:
        """The same as a displacement of that robot."""
        variances = self.translation_variance, self.heading_variance
        return Displacement(self.time, self.interval, self.dx, self.dy, self.dpsi, *variances)


@dataclass(frozen=True, slots=True)
class Names:
    """Who the teammates of the estimate of `time` are, by the odometry that they send.

    labels (n,) of the estimate, with the robots' numbers: identities (n,); probabilities (n,);
    headings (n,) rad, in the robot frame at `time`. Teammates that are not recognized are left out.
    """

    time: float
    labels: IntArray
    identities: IntArray
    probabilities: FloatArray
    headings: FloatArray


@dataclass(frozen=True, slots=True)
class Named:
    """One of `Names`: robot `identity`, with `probability`; heading (rad) in the robot frame."""

    identity: int
    probability: float
    heading: float


@dataclass(frozen=True, slots=True)
class Truth:
    """Where the other robots truly are, in the robot frame at `time`; never given to a filter.

    identities (n,), positions (n, 2) m.
    """

    time: float
    identities: IntArray
    positions: FloatArray


@dataclass(frozen=True, slots=True)
class Bodies:
    """Where motion capture saw rigid bodies, in the floor's frame at `time` (of the exposure).

    identities (n,): their numbers. poses (n, 3): x, y (m) and heading (rad) of each body's own
    origin. A body that is not tracked is left out. Never given to a filter.
    """

    time: float
    identities: IntArray
    poses: FloatArray


@dataclass(frozen=True, slots=True)
class Health:
    """How a device does. ok: it delivers. reason: in words, with the next step where it does not.

    Of one that is ok: how it does and, each after "; ", what could be better. Of one that is not,
    lines: what, why, the next step, as far as they are known.
    counts: what it accepted and dropped since it started, by name.
    """

    time: float
    device: str
    ok: bool
    reason: str
    counts: dict[str, int]


@dataclass(frozen=True, slots=True)
class DeviceBytes:
    """What a device sent, as it was read at `time`; empty where a connection to it begins.

    It comes before the messages that are made of it. device: "lidar" or "board".
    """

    time: float
    device: str
    data: bytes


@dataclass(frozen=True, slots=True)
class DeviceIdentity:
    """Which device is connected. values: what it says of itself, by name, as "firmware"."""

    time: float
    device: str
    values: dict[str, str]


@dataclass(frozen=True, slots=True)
class Picture:
    """A camera's picture, exposed at `time`. camera: "front" or "rear"; jpeg: as it came."""

    time: float
    camera: str
    jpeg: bytes


Measurement = Scan | Positions | Bearings
Message = (
    Measurement
    | Displacement
    | Estimate
    | Truth
    | Bodies
    | Health
    | DeviceBytes
    | DeviceIdentity
    | Picture
    | TeammateOdometry
    | Names
)
