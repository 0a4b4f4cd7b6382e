"""The wheels at work: each forward alone, then both in a rotation to each side.

The robot stands on the floor, with half a metre around it, so that the lidar sees what moves.
"""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from host.config import RobotConfig
from host.cross_checks.wheels import wheel_travel
from host.doctor.delays import sensor_delays
from host.doctor.findings import Finding, Level
from host.doctor.lidar_motion import LidarMotion, motion_of
from host.doctor.views import hidden
from host.doctor.watching import Watched
from host.doctor.wheels import WheelTest, diagnose
from host.messages import FloatArray

_SPEED_MPS, _DRIVE_S = 0.1, 1.0  # of one wheel
_TURN_RADPS, _TURN_S = 1.0, 3.5
_REST_S = 1.5  # until the wheels stand; a board that switched off needs it to be told to go on
_COMMAND_S = 0.05
_SCALE_OFF = 0.1  # of the rotation by the wheels against that by the lidar

Drive = Callable[[float, float], None]


@dataclass(frozen=True, slots=True)
class Phase:
    """What was commanded from `begin` to `end` (with the rest after it), s of the host's clock."""

    begin: float
    end: float


@dataclass
class Spin:
    """Drives the wheels; `findings` then judges what was watched meanwhile.

    drive(m/s, rad/s): has to be called again and again, as `Romeo.command`. clock: of the messages'
    times, s; sleep: lets it pass.
    """

    drive: Drive
    config: RobotConfig
    clock: Callable[[], float] = time.monotonic
    sleep: Callable[[float], None] = time.sleep
    _tests: list[WheelTest] = field(default_factory=list)
    _begin: float = 0.0
    _rotations: list[Phase] = field(default_factory=list)

    def run(self, watched: Watched) -> None:
        """Each wheel, then rotations where both are in order."""
        self._begin, track = self.clock(), self.config.wheels.track_m
        for side, turn in enumerate((-1.0, 1.0)):  # the left wheel alone rotates it clockwise
            phase = self._hold(0.5 * _SPEED_MPS, turn * _SPEED_MPS / track, _DRIVE_S)
            self._tests.append(self._test(side, watched, phase))
        if all(diagnose(test, self.config.motors).ok for test in self._tests):
            for turn in (_TURN_RADPS, -_TURN_RADPS):
                self._rotations.append(self._hold(0.0, turn, _TURN_S))

    def _hold(self, speed: float, turn_rate: float, seconds: float) -> Phase:
        begin = self.clock()
        for until, command in (
            (begin + seconds, (speed, turn_rate)),
            (begin + seconds + 0.2, (0.0, 0.0)),
        ):
            while self.clock() < until:
                self.drive(*command)
                self.sleep(_COMMAND_S)
        self.sleep(_REST_S)
        return Phase(begin, self.clock())

    def findings(self, watched: Watched) -> tuple[list[Finding], Mapping[str, bool]]:
        """What was found, and what to change in robot.toml, by dotted key."""
        found, settings = [], dict[str, bool]()
        for test in self._tests:
            diagnosis = diagnose(test, self.config.motors)
            found.append(diagnosis.finding)
            settings |= diagnosis.settings
        if self._rotations:
            found += self._by_rotation(watched, self._rotations[-1].end)
        return found, settings

    def _by_rotation(self, watched: Watched, end: float) -> list[Finding]:
        """What a robot whose wheels are in order shows besides."""
        scans = [scan for scan in watched.scans if self._begin - 1.0 < scan.time < end]
        motion = motion_of(scans, self.config.lidar)
        if motion is None:
            return []
        begin = self._rotations[0].begin
        return [
            self._scale(watched, motion),
            *hidden([scan for scan in scans if scan.time > begin], self.config.lidar),
            *sensor_delays(watched, motion, (self._begin, end), self.config.mocap.body),
        ]

    def _test(self, side: int, watched: Watched, phase: Phase) -> WheelTest:
        scans = [scan for scan in watched.scans if phase.begin - 0.5 < scan.time]
        motion = motion_of(scans, self.config.lidar)
        seen = None
        if motion is not None and motion.covers(phase.begin, phase.end):
            half_track = 0.5 * self.config.wheels.track_m
            seen = wheel_travel(motion.between(phase.begin, phase.end), half_track)
        return WheelTest(side, self._counted(watched, phase), seen)

    def _counted(self, watched: Watched, phase: Phase) -> FloatArray:
        """Travel (left, right) m by the encoders."""
        ticks = [
            step.ticks
            for step in watched.steps
            if phase.begin < step.time < phase.end and step.ticks is not None
        ]
        wheels = self.config.wheels
        radii = np.array([wheels.left_radius_m, wheels.right_radius_m])
        total = np.sum(ticks, axis=0) if ticks else np.zeros(2)
        return np.asarray(total * math.tau * radii / wheels.counts_per_turn)

    def _scale(self, watched: Watched, motion: LidarMotion) -> Finding:
        """Rotation by the wheels against that by the lidar: geometry and counts per turn."""
        said = seen = 0.0
        for phase in self._rotations:
            steps = [s.dpsi for s in watched.steps if phase.begin < s.time < phase.end]
            said += abs(sum(steps))
            seen += abs(float(motion.between(phase.begin, phase.end)[2]))
        by_lidar, by_wheels = (round(math.degrees(angle)) for angle in (seen, said))
        what = f"rotated by {by_lidar} deg by the lidar, {by_wheels} deg by the wheels"
        if abs(said - seen) <= _SCALE_OFF * seen:
            return Finding("board", Level.OK, what)
        return Finding(
            "board",
            Level.WARN,
            f"{what}: counts_per_turn, radii or track are another robot's, or the wheels slip",
            "swarmloc calibrate wheels; [wheels] in robot.toml",
        )
