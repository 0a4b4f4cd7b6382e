"""The devices of a live run: the robot's own, or simulated ones."""

import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import cast

from host.config import RobotConfig
from host.drivers.computer import COMPUTER, Computer
from host.drivers.link.device import LINK, Link
from host.drivers.natnet.client import MOCAP, NatNetClient
from host.errors import UserError
from host.messages import Truth
from host.pipeline import Source
from host.simulation.devices.catalogue import BoardDriver, board_entry, last_return, lidar_entry
from host.simulation.live import BOARD, LIDAR, Interval, LiveSimulation
from host.simulation.world import scenarios
from host.simulation.world.arena import Contact
from host.sources.cameras import StripCamera, camera_sources
from host.sources.ceiling import CeilingCamera
from host.sources.sensors import CAMERA_ONLY, LIDAR_AND_CAMERA, LIDAR_ONLY


@dataclass(frozen=True, slots=True)
class Rig:
    """What a run consists of: the devices, the configuration in effect, and truth if known.

    simulated_board: of a simulation, what stands in for the board. contacts: there, who drove
    against what so far. record_pictures: a recording gets the cameras' pictures, too. link: to
    the other robots.
    """

    title: str
    config: RobotConfig
    sensors: str
    sources: Mapping[str, Source]
    scenario: str | None = None
    simulated_board: str | None = None
    truth: Callable[[float], Truth] | None = None
    contacts: Callable[[], Sequence[Contact]] | None = None
    record_pictures: bool = False
    link: Link | None = None

    @property
    def board(self) -> BoardDriver:
        """The board, to be commanded."""
        return cast(BoardDriver, self.sources[BOARD])

    @property
    def last_return(self) -> Callable[[], float] | None:
        """When anything last came back to the lidar, host time (s); None: unknown."""
        return last_return(self.sources[LIDAR])

    @property
    def cameras(self) -> list[StripCamera]:
        """Those whose pictures can be looked at."""
        return [source for source in self.sources.values() if isinstance(source, StripCamera)]


def real_rig(robot: RobotConfig, sensors: str | None) -> Rig:
    """The robot's own devices. Raises UserError where `sensors` needs cameras and none is named."""
    found = {} if sensors == LIDAR_ONLY else camera_sources(robot.camera)
    if sensors in (LIDAR_AND_CAMERA, CAMERA_ONLY) and not found:
        raise UserError(
            "there is no camera to use",
            'source is "none" in [camera.front] and [camera.rear] of robot.toml',
            "name their sources there (docs/cameras.md), or use --sensors lidar",
        )
    sensors = sensors or (LIDAR_AND_CAMERA if found else LIDAR_ONLY)
    drivers, computer = _drivers(robot, sensors), {COMPUTER: Computer()}
    link = Link(robot.link) if robot.link.on else None
    sources = {**drivers, **found, **_motion_capture(robot), **computer, **_linked(link)}
    return Rig(f"robot {robot.name}", robot, sensors, sources, link=link)


def _drivers(robot: RobotConfig, sensors: str) -> dict[str, Source]:
    board: Source = board_entry(robot.board.model).driver(robot)
    if sensors == CAMERA_ONLY:
        return {BOARD: board}
    return {LIDAR: lidar_entry(robot.lidar.model).driver(robot.lidar), BOARD: board}


def simulated_rig(
    stack: contextlib.ExitStack,
    robot: RobotConfig,
    scenario: str,
    unplug: Mapping[str, Sequence[Interval]],
    sensors: str,
    driven: bool = False,
) -> Rig:
    """Simulated devices, which run until `stack` is left.

    driven: the robot obeys its board, and so the host, instead of following its scripted path.
    Raises UserError for robots on their own stacks: they are simulated offline.
    """
    parsed = scenarios.parse_scenario(scenario)
    if parsed.stacks == "all" or (parsed.stacks == "own" and not driven):
        raise UserError(
            f"cannot simulate {scenario} live",
            f"stacks={parsed.stacks}: robots on their own stacks are simulated at full speed only",
            f"record it: swarmloc simulate {scenario} --output FILE; or drive one robot live: "
            "swarmloc drive walk --simulate",
        )
    board = board_entry(robot.board.model).best(robot.motors)
    live = stack.enter_context(LiveSimulation(parsed, robot, unplug, board, driven=driven))
    config = live.config
    sources = {**_drivers(config, sensors), **_motion_capture(config)}
    if sensors != LIDAR_ONLY:
        sources |= camera_sources(config.camera) if parsed.rendered else {"camera": live.camera}
    link = Link(config.link) if config.link.on else None
    sources |= _linked(link)
    title = f"{scenario} (simulated; board: {board.name})"
    return Rig(
        title,
        config,
        sensors,
        sources,
        scenario,
        board.name,
        live.truth,
        lambda: live.contacts,
        link=link,
    )


def _linked(link: Link | None) -> dict[str, Source]:
    return {} if link is None else {LINK: link}


def _motion_capture(robot: RobotConfig) -> dict[str, Source]:
    if robot.mocap.source == "natnet":
        return {MOCAP: NatNetClient(robot.mocap.natnet)}
    if robot.mocap.source == "ceiling":
        if robot.mocap.ceiling.eye.source == "none":
            raise UserError(
                "there is no ceiling camera",
                'source is "ceiling" in [mocap] of robot.toml, but "none" in [mocap.ceiling.eye]',
                'name the camera there, or write "none" in [mocap], too',
            )
        return {MOCAP: CeilingCamera(robot.mocap.ceiling)}
    return {}
