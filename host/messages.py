"""The messages between devices, localizer and sinks: one frozen dataclass per kind.

Every message carries `time`: the host's monotonic time of the measurement (not of its arrival),
in seconds. Lengths in metres, angles in radians, counter-clockwise positive, x forward, y left.
"""

import math
from collections.abc import Mapping
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
    """Detections of possible teammates as positions, in the robot frame at `time`.

    positions (n, 2) m, covariances (n, 2, 2) m².
    lags (n,) s: how long before `time` each reading was made; None: all at `time`.
    clearance (360,) m: free range in each of so many equal sectors, the first at bearing -pi; inf
    without a return, 0 where the sensor did not look; None if unknown.
    identities (n,): the teammate that was measured (-1: none), if a data set has it; read only by
    the clairvoyant filter.
    scores (n,): log likelihood ratio of a teammate against any other object, by its shape; None if
    unknown.
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
    """Directions of teammates' strips in one picture, in the robot frame at `time`.

    bearings (n,) rad, variances (n,) rad². origin (x, y) m: where the rays start.
    lag s: age of the picture at `time` (0 until the localizer transforms it to the present).
    identities: as in `Positions`. view (centre, half width) rad: the camera's field of view.
    ranges (n,) m, range_variances (n,) m²: from `origin`, by the strip's size in the picture.
    camera: "front" or "rear"; pixels (n, 2): positions in its picture.
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
    """The robot's own motion in the `interval` (s) that ends at `time`.

    dx, dy (m) and dpsi (rad): the new pose in the robot frame at the start of the interval.
    translation_variance (m², per axis) and heading_variance (rad²) are the odometry's noise.
    ticks: encoder counts (left, right) in the interval, if known.
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

    positions (n, 2) m, covariances (n, 2, 2) m², weights (n,): expected number of teammates there,
    ages (n,) s since the last reading. labels (n,): track numbers, constant while a track exists;
    not the robots' identities. obstacles (k, 2) m with obstacle_covariances (k, 2, 2) m²: objects
    that look like teammates to the lidar and are not, seen now or remembered.
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
    """Motion that robot `identity` sent over the link, in the `interval` (s) that ends at `time`.

    The rest as in `Displacement`. restarted: the sender restarted; its earlier motion is void.
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
    """Identities of the teammates in the estimate of `time`, by the odometry that they send.

    labels (n,) of the estimate; identities (n,): robot numbers; probabilities (n,); headings (n,)
    rad, in the robot frame at `time`. Only recognized teammates.
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
    """True positions of the other robots, in the robot frame at `time`; never given to a filter.

    identities (n,), positions (n, 2) m.
    """

    time: float
    identities: IntArray
    positions: FloatArray


@dataclass(frozen=True, slots=True)
class Bodies:
    """Rigid bodies in one motion capture frame, in the floor frame at `time` (of the exposure).

    identities (n,): their numbers. poses (n, 3): x, y (m) and heading (rad) of each body's origin.
    Only tracked bodies. Never given to a filter.
    """

    time: float
    identities: IntArray
    poses: FloatArray


@dataclass(frozen=True, slots=True)
class Health:
    """State of a device. ok: it works. reason: a sentence for the user.

    If ok: its state and, each after "; ", what could be better. If not, lines: what happened, why,
    the next step, as far as known.
    counts: what it accepted and dropped since it started, by name.
    """

    time: float
    device: str
    ok: bool
    reason: str
    counts: dict[str, int]


@dataclass(frozen=True, slots=True)
class DeviceBytes:
    """Bytes read from a device at `time`; empty at the start of a connection.

    Comes before the messages decoded from it. device: "lidar" or "board".
    """

    time: float
    device: str
    data: bytes


@dataclass(frozen=True, slots=True)
class DeviceIdentity:
    """Which device is connected. values: what it reports about itself, by name, e.g. "firmware"."""

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


@dataclass(frozen=True, slots=True)
class Now:
    """What is known at this moment, whenever it was measured.

    estimate: predicted to now. measured: time (s) of the newest reading in it. truth: at the
    estimate's time, if known. names: by label, of teammates recognized over the link.
    """

    estimate: Estimate
    measured: float
    truth: Truth | None = None
    names: Mapping[int, Named] = field(default_factory=dict)
