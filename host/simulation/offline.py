"""The simulated robot, offline: every message it would give, in order of arrival, at full speed.

It follows a scripted path or, in closed loop, obeys its board, which obeys its host's commands.
"""

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from host.config import RobotConfig
from host.drivers.natnet import protocol as natnet_protocol
from host.drivers.natnet.frames import MocapFrame, Version
from host.drivers.natnet.protocol import bodies_of, frame_of, frame_packet
from host.drivers.romeo.differential_drive import ticks_for
from host.drivers.x4.protocol import delayed
from host.geometry import to_frame
from host.messages import Bearings, Bodies, DeviceBytes, Message, Truth
from host.simulation.devices.board import BoardKind, motion_of
from host.simulation.devices.catalogue import board_entry, last_return, lidar_entry
from host.simulation.devices.driven_wheels import DrivenWheels
from host.simulation.pictures.render import Surroundings
from host.simulation.pictures.searched_camera import SearchedCamera
from host.simulation.world.arena import ARENA_STEP_S, Arena
from host.simulation.world.built import built, known
from host.simulation.world.camera import SimulatedCamera
from host.simulation.world.motion_capture import MotionCapture
from host.simulation.world.scenarios import Scenario
from host.simulation.world.sensors import SimulatedEncoders, SimulatedLidar, WheelSlip

OBSERVER = 0
TRUTH_HZ = 10.0
_TICK_S = 0.1
_TALKS = 5  # of host and board a tick
_NATNET: Version = (4, 1)  # as the simulated motion capture streams

Arrival = tuple[float, Message]


class Simulation:
    """A scenario, one robot's devices in it, and what the host makes of their bytes.

    lidar and board: the devices at byte level, of the models that `config` names; camera: the
    image pairs. built: the true robot; config: what the host knows of it. All times are seconds
    since the scenario's start.
    """

    def __init__(
        self,
        scenario: Scenario,
        config: RobotConfig,
        board: BoardKind | None = None,
        *,
        driven: bool = False,
        robot: int = OBSERVER,
        arena: Arena | None = None,
    ) -> None:
        """driven: it obeys its board; then whoever runs it calls `talk`, the arena's `advance` and
        `sense` in turns. robot: which one of the scenario. arena: shared with other robots.
        """
        self.scenario = scenario
        self.built = built(config, scenario)
        self.config = known(config, scenario)
        self.arena = arena or Arena(scenario)
        self._robot = robot
        self._others = np.delete(np.arange(scenario.robots), robot)
        self.lidar_entry = lidar_entry(config.lidar.model)
        board_kind = board_entry(config.board.model)
        sensor = SimulatedLidar(
            self.arena, robot, scenario, self.built.lidar, self.lidar_entry.beams
        )
        self.camera = SimulatedCamera(self.arena, robot, scenario)
        self.lidar = self.lidar_entry.emulator(
            sensor.ranges, scenario.lidar_turn_hz, scenario.seed + robot, scenario.lidar_delay_s
        )
        make = (board or board_kind.stand_in).make
        self._encoders: SimulatedEncoders | None = None
        if driven:
            wheels = DrivenWheels(self.built.wheels, WheelSlip(scenario, robot))
            self.board = make(wheels.ticks)
            wheels.attach(motion_of(self.board, self.config, self.built.wheels))
            self.arena.hand_over(robot, wheels.carried)
        else:
            self._encoders = SimulatedEncoders(self.arena, robot, scenario, self.built.wheels)
            self.board = make(self._encoders.ticks)
        self._wanted: tuple[int, int] | None = None  # ticks/s
        self._mocap = MotionCapture(self.arena, robot, scenario, self.built.mocap)
        self._decoder = self.lidar_entry.decoder()
        self._natnet = natnet_protocol.MocapDecoder(_NATNET)
        self._session = board_kind.session(self.config)
        self._talked = 0.0
        self._frames = 0
        self._truths = 0
        self._exposures = 0

    def truth(self, time: float) -> Truth:
        """True positions of the teammates at `time` (s), in the observer's frame."""
        (poses,) = self.arena.poses(np.array([time]))
        return Truth(time, self._others, to_frame(poses[self._others, :2], poses[self._robot]))

    def bodies(self, time: float) -> Bodies:
        """What motion capture sees at `time` (s); call once a frame, in order."""
        return self._mocap.bodies(time)

    def surroundings(self, time: float) -> Surroundings:
        """What is around the observer at `time` (s), for its cameras."""
        half = 0.5 * ARENA_STEP_S
        before, poses, after = self.arena.poses(np.array([time - half, time, time + half]))
        own = poses[self._robot]
        return Surroundings(
            to_frame(poses[self._others, :2], own),
            to_frame(self.arena.posts, own),
            own,
            self.arena.half_side_m,
            float(after[self._robot, 2] - before[self._robot, 2]) / ARENA_STEP_S,
            self.arena.furniture.seen_from(own),
        )

    def forget(self, before: float) -> None:
        """Forget the robots' motion before `before` (s), which no device may still need."""
        if self._encoders is not None:
            self._encoders.forget(before)
        self.arena.forget(before)

    @property
    def last_return(self) -> Callable[[], float] | None:
        """When anything last came back to the lidar, s; None: unknown."""
        return last_return(self._decoder)

    def command(self, speed_mps: float, turn_rate_radps: float) -> None:
        """Command it, as `Romeo.command`; in force until the next one."""
        self._wanted = ticks_for(self.config.wheels, speed_mps, turn_rate_radps)

    def messages(self) -> Iterator[Message]:
        """Yield Scan, Displacement, Bearings, Bodies, Truth (10 Hz) in order of arrival, once.

        DeviceBytes come before what is made of them.
        The devices' bytes go through the decoders and the conversion that serve the real ones.
        """
        self.switch_on()
        for device in ("lidar", "board"):
            yield DeviceBytes(0.0, device, b"")
        for tick in range(math.ceil(self.scenario.seconds / _TICK_S) + 1):
            now = min(tick * _TICK_S, self.scenario.seconds)
            yield from self.sense(now, self.talk(now, _TALKS))

    def switch_on(self) -> None:
        """Start lidar and board at time 0."""
        self.lidar.receive(self.lidar_entry.start, 0.0)
        self._session.connect(0.0)

    def talk(self, now: float, talks: int = 1) -> list[Arrival]:
        """Let board and host talk so often up to `now` (s); return the displacements.

        A host answers at once, not once a tick.
        """
        return list(self._displacements(now, talks))

    def sense(self, now: float, talked: list[Arrival]) -> list[Message]:
        """What comes up to `now` (s), in order of arrival, with what `talk` returned."""
        arrivals = [
            *self._scans(now),
            *talked,
            *self._bearings(now),
            *self._bodies(now),
            *self._truths_until(now),
        ]
        arrivals.sort(key=lambda arrival: arrival[0])
        return [message for _, message in arrivals]

    def _scans(self, now: float) -> Iterator[Arrival]:
        delay = self.config.lidar.delay_s
        for time, data in self.lidar.transmit(now):
            if data:
                yield time, DeviceBytes(time, "lidar", data)
            for scan in self._decoder.feed(data, time):
                yield time, delayed(scan, delay)

    def _displacements(self, now: float, talks: int) -> Iterator[Arrival]:
        for talk in np.linspace(self._talked, now, talks + 1)[1:]:
            for time, data in self.board.transmit(talk):
                if data:
                    yield time, DeviceBytes(time, "board", data)
                for displacement in self._session.receive(data, time):
                    yield time, displacement
            self.board.receive(self._session.transmit(talk, self._wanted), talk)
        self._talked = now

    def _bearings(self, now: float) -> Iterator[Arrival]:
        delay = self.scenario.camera_delay_s
        unknown = delay - self.config.camera.delay_s
        while (time := self._frames / self.scenario.camera_hz) + delay <= now:
            for bearings in self._seen(time):
                yield time + delay, replace(bearings, time=time + unknown)
            self._frames += 1

    def _bodies(self, now: float) -> Iterator[Arrival]:
        if not self.scenario.mocap_hz:
            return
        while (time := self._exposures / self.scenario.mocap_hz) <= now:
            packet = frame_packet(frame_of(self.bodies(time), "y", self._exposures), _NATNET)
            self._exposures += 1
            frame = self._natnet.feed(packet)
            if isinstance(frame, MocapFrame):
                yield time, bodies_of(frame, time, "y")

    def _seen(self, time: float) -> list[Bearings]:
        """What the image pair taken at `time` (s) shows, as one or, where rendered, as two."""
        if not self.scenario.rendered:
            return [self.camera.bearings(time)]
        scene = self.surroundings(time)
        found = [
            camera.bearings(scene, self._others, time, self._frames) for camera in self._searched
        ]
        return [bearings for bearings in found if bearings is not None]

    @functools.cached_property
    def _searched(self) -> tuple[SearchedCamera, SearchedCamera]:
        known, true, seed = self.config.camera, self.built.camera, self.scenario.seed
        return SearchedCamera("front", known, true, seed), SearchedCamera("rear", known, true, seed)

    def _truths_until(self, now: float) -> Iterator[Arrival]:
        while (time := self._truths / TRUTH_HZ) <= now:
            self._truths += 1
            yield time, self.truth(time)
