"""What calibration works on: a robot's messages in one place, and the true paths in them."""

import copy
import math
from collections.abc import Mapping, Sequence

import numpy as np

from host.calibration.chain import Chain
from host.calibration.identity.check import check_identity
from host.config import Mocap, RobotConfig
from host.errors import UserError
from host.geometry import Path, to_frame, to_parent
from host.messages import Bearings, Bodies, Displacement, FloatArray, IntArray, Message, Scan, Truth

_GAP_S = 0.1  # a body lost for longer is not interpolated
_NOBODY = Bodies(0.0, np.zeros(0, dtype=np.int64), np.zeros((0, 3)))


def untracked(nothing: str) -> UserError:
    """The error of a drive of which `nothing` was seen while the robot was tracked."""
    return UserError(
        f"{nothing} can be compared with motion capture",
        "the robot's own body was not tracked during any of them",
        "check that the robot is in the capture volume, and that both run at the same time",
    )


class Tracks:
    """True paths of the robot and its teammates on the floor, from what motion capture saw.

    bodies: times (k,) s and poses (k, 3), headings not wrapped, of each by its number. identities
    (n,): of the teammates. turrets: where in its body's frame (2,) m a teammate's turret is, by its
    number; others are at its pivot. Between frames paths are interpolated; while a body is lost
    for longer than 0.1 s, before the first frame and after the last, everything is nan.
    Raises UserError where the robot's own body was never seen.
    """

    def __init__(self, frames: Sequence[Bodies], mocap: Mocap) -> None:
        times = np.concatenate([np.full(len(f.identities), f.time) for f in (_NOBODY, *frames)])
        numbers = np.concatenate([f.identities for f in (_NOBODY, *frames)])
        poses = np.concatenate([f.poses for f in (_NOBODY, *frames)])
        self.bodies: dict[int, tuple[FloatArray, FloatArray]] = {}
        for number in np.unique(numbers).tolist():
            chosen = np.flatnonzero(numbers == number)
            chosen = chosen[np.unique(times[chosen], return_index=True)[1]]
            path = poses[chosen].copy()
            path[:, 2] = np.unwrap(path[:, 2])
            self.bodies[number] = times[chosen], path
        if mocap.body not in self.bodies:
            seen = ", ".join(str(number) for number in self.bodies) or "none"
            raise UserError(
                f"motion capture never saw body {mocap.body}, which is this robot",
                f"bodies seen: {seen}",
                "set body in [mocap] of robot.toml to this robot's streaming id or tag number",
            )
        self._body = mocap.body
        self._mount(np.array([mocap.x_m, mocap.y_m, mocap.heading_rad]))
        self.turrets: Mapping[int, FloatArray] = {
            turret.body: np.array([turret.x_m, turret.y_m]) for turret in mocap.turrets
        }
        self.identities: IntArray = np.array([n for n in self.bodies if n != mocap.body], dtype=int)

    def _mount(self, pose: FloatArray) -> None:
        # The robot frame in the body's own frame.
        self._robot = to_frame(np.zeros((1, 2)), pose), -float(pose[2])

    def mounted(self, pose: FloatArray, turrets: Mapping[int, FloatArray]) -> "Tracks":
        """The same, for an own body that lies at `pose` (3,) on the robot, and other turrets."""
        other = copy.copy(self)
        other._mount(pose)
        other.turrets = turrets
        return other

    @property
    def span(self) -> tuple[float, float]:
        """First and last time (s) at which the robot was seen."""
        times = self.bodies[self._body][0]
        return float(times[0]), float(times[-1])

    def body(self, identity: int, times: FloatArray) -> FloatArray:
        """Poses (k, 3) of a body on the floor at `times` (k,): x, y (m), heading (not wrapped)."""
        known, poses = self.bodies[identity]
        times = np.asarray(times, dtype=float)
        after = np.clip(np.searchsorted(known, times), 1, max(len(known) - 1, 1))
        before = after - 1
        after = np.minimum(after, len(known) - 1)
        interval = known[after] - known[before]
        share = np.where(interval > 0.0, (times - known[before]) / np.maximum(interval, 1e-12), 0.0)
        found: FloatArray = poses[before] + share[:, None] * (poses[after] - poses[before])
        lost = (times < known[0]) | (times > known[-1]) | (interval > _GAP_S)
        # At a frame itself the body was seen, however far the next ones are.
        found[lost & (times != known[before]) & (times != known[after])] = math.nan
        return found

    def own(self, times: FloatArray) -> FloatArray:
        """Poses (k, 3) of the robot itself on the floor at `times` (k,)."""
        body = self.body(self._body, times)
        place, rotation = self._robot
        own = np.empty_like(body)
        own[:, :2] = to_parent(np.broadcast_to(place, (len(body), 2)), body)
        own[:, 2] = body[:, 2] + rotation
        return own

    def relative(self, identity: int, times: FloatArray) -> FloatArray:
        """Positions (k, 2) m of a teammate in the robot frame at `times` (k,)."""
        body = self.body(identity, times)
        place = body[:, :2]
        if identity in self.turrets:
            place = to_parent(np.broadcast_to(self.turrets[identity], place.shape), body)
        return to_frame(place, self.own(times))

    def teammates(self, times: FloatArray) -> FloatArray:
        """Positions (k, m, 2) m of all teammates in the robot frame at `times` (k,)."""
        places = [self.relative(number, times) for number in self.identities.tolist()]
        return np.stack(places, axis=1) if places else np.zeros((len(times), 0, 2))

    def rotated(self, identity: int, times: FloatArray) -> FloatArray:
        """Headings (k,) rad of a teammate's body in the robot frame at `times` (k,)."""
        return np.asarray(self.body(identity, times)[:, 2] - self.own(times)[:, 2])

    def truths(self, times: FloatArray) -> list[Truth]:
        """Where the teammates are at each of `times` (k,) at which they and the robot are seen."""
        found = []
        for time, seen in zip(times.tolist(), self.teammates(times), strict=True):
            tracked = np.isfinite(seen[:, 0])
            if tracked.any():
                found.append(Truth(time, self.identities[tracked], seen[tracked]))
        return found


class Gathered:
    """Messages of one robot, kept by kind in the order they came.

    config: under which they were taken, so that e.g. its delays are in their times already.
    truth_time_sigma: by how much (s, std) all true paths may be early or late. chain: what earlier
    fits left uncertain.
    """

    def __init__(self, config: RobotConfig) -> None:
        self.config = config
        self.scans: list[Scan] = []
        self.displacements: list[Displacement] = []
        self.bearings: list[Bearings] = []
        self.bodies: list[Bodies] = []
        self.truth_time_sigma = 0.0
        self.chain = Chain()

    @property
    def frame_times(self) -> FloatArray:
        """When (k,) s motion capture saw anything, in the order in which it came."""
        return np.array([frame.time for frame in self.bodies])

    @property
    def own_times(self) -> FloatArray:
        """When (k,) s it saw the robot's own body, in the order in which it came."""
        body = self.config.mocap.body
        return np.array([frame.time for frame in self.bodies if body in frame.identities])

    def take(self, message: Message) -> None:
        """Keep a message if calibration has a use for it."""
        if isinstance(message, Scan):
            self.scans.append(message)
        elif isinstance(message, Displacement):
            self.displacements.append(message)
        elif isinstance(message, Bearings):
            self.bearings.append(message)
        elif isinstance(message, Bodies):
            self.bodies.append(message)

    def tracks(self) -> Tracks:
        """The true paths. Raises UserError where there are none, or not of this robot."""
        if not self.bodies:
            raise UserError(
                "there is no motion capture to calibrate against",
                "not one frame of it was received",
                "name its source in [mocap] of robot.toml (docs/calibration.md)",
            )
        tracks = Tracks(self.bodies, self.config.mocap)
        steps = [step for step in self.displacements if step.ticks is not None]
        if steps:
            times = np.array([steps[0].time - steps[0].interval, *(step.time for step in steps)])
            ticks = np.cumsum([(0, 0), *(step.ticks for step in steps if step.ticks)], axis=0)
            config = self.config
            check_identity(times, ticks, tracks.bodies, config.wheels, config.mocap)
        return tracks

    def tracks_of_teammates(self) -> Tracks:
        """The true paths, with teammates in them. Raises UserError where there is none, too."""
        tracks = self.tracks()
        if not len(tracks.identities):
            raise UserError(
                "motion capture saw no teammate",
                f"of all bodies it saw {self.config.mocap.body} alone, which is this robot",
                "put a teammate with its own body on the floor",
            )
        return tracks

    def path(self) -> Path:
        """The whole path by the wheels alone."""
        path = Path(keep_seconds=math.inf)
        for displacement in self.displacements:
            path.append(displacement)
        return path
