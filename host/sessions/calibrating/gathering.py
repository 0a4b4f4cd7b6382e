"""Where a calibration's data come from: a recording, a scenario, or the robot as it drives."""

import contextlib
from collections.abc import Callable, Iterable, Sequence

from host.calibration.gathered import Gathered
from host.config import RobotConfig
from host.drivers.natnet.client import MOCAP
from host.errors import UserError, one_line
from host.messages import Health, Message
from host.pipeline import DRIVER, LOCALIZER
from host.sessions.recordings.runs import Progress, find_source, read_as, simulated, unseen
from host.sessions.recordings.truth_files import TruthFile, truth_of_scenario, with_truth
from host.simulation.world import scenarios
from host.simulation.world.scenarios import Scenario
from host.simulation.world.settings import settings
from host.sources.rig import Rig, real_rig, simulated_rig
from host.sources.sensors import LIDAR_AND_CAMERA

_MOCAP_HZ = 100

Advice = Callable[[Gathered], list[str]]


def with_mocap(scenario: str) -> str:
    """The scenario as written, with motion capture where it sets none."""
    if scenarios.parse_scenario(scenario).mocap_hz or "mocap_hz" in settings(scenario):
        return scenario
    return f"{scenario}{',' if ':' in scenario else ':'}mocap_hz={_MOCAP_HZ}"


def gather_source(
    source: str,
    robot: RobotConfig | None,
    progress: Progress = unseen,
    warn: Callable[[str], None] = print,
    truth: TruthFile | None = None,
) -> Gathered:
    """What a recording holds, or what a scenario gives at full speed.

    A recording is read as if taken with the configuration `robot`, None: with its own. warn: gets
    what a user should know of the source but does not prevent its use. truth: in place of the
    recording's own. Raises UserError.
    """
    found = find_source(source)
    if not isinstance(found, Scenario):
        config = robot or found.header.config
        gathered = Gathered(config)
        messages: Iterable[Message] = read_as(found, config)
        if truth is not None:
            messages, clock = with_truth(messages, truth, config.mocap)
            gathered.truth_time_sigma = clock.sigma
        for message in messages:
            gathered.take(message)
        for remark in found.remarks:
            warn(f"{source}: {remark}")
        return gathered
    if truth is not None:
        raise truth_of_scenario(source)
    parsed = scenarios.parse_scenario(with_mocap(source))
    simulation, messages = simulated(parsed, robot or RobotConfig())
    gathered = Gathered(simulation.config)
    for message in messages:
        gathered.take(message)
        progress(message.time, simulation.scenario.seconds)
    return gathered


def calibration_rig(
    stack: contextlib.ExitStack,
    robot: RobotConfig,
    scenario: str | None,
    mocap_needed: bool,
    driven: bool = False,
) -> Rig:
    """The devices to gather from: the robot's, or simulated ones, which run until `stack` is left.

    driven: a simulated robot obeys its board. Raises UserError where there is no motion capture
    and it is needed.
    """
    if scenario is None:
        rig = real_rig(robot, None)
    else:
        rig = simulated_rig(stack, robot, with_mocap(scenario), {}, LIDAR_AND_CAMERA, driven)
    if mocap_needed and MOCAP not in rig.sources:
        raise UserError(
            "there is no motion capture to calibrate against",
            'source is "none" in [mocap] of robot.toml',
            "name it there (docs/calibration.md), or try --simulate misbuilt4",
        )
    return rig


class DriveWatch:
    """What the devices deliver while the robot drives: `gathered`, and what is `missing` still."""

    def __init__(self, rig: Rig, advice: Advice) -> None:
        self.gathered = Gathered(rig.config)
        self._advice = advice
        self._mocap = MOCAP in rig.sources
        self._health: dict[str, Health] = {}

    def note(self, message: Message) -> None:
        """Keep the health of each device."""
        if isinstance(message, Health):
            self._health[message.device] = message

    def missing(self) -> Sequence[str]:
        """A device that is down, or else what the drive still lacks; empty: enough to fit."""
        for name, health in list(self._health.items()):
            if not health.ok and name not in (LOCALIZER, DRIVER):
                return [f"{name}: {one_line(health.reason)}"]
        return self.lacking()

    def lacking(self) -> Sequence[str]:
        """What the drive still lacks, however the devices do."""
        if self._mocap and not self.gathered.bodies:
            return ["waiting for motion capture"]
        try:
            return self._advice(self.gathered)
        except UserError as error:
            return str(error).splitlines()
