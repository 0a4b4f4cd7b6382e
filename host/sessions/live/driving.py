"""Driving a robot, or a simulated one that obeys its board."""

import contextlib

from host.behaviour.driving import Driving
from host.behaviour.interface import Behaviour
from host.config import RobotConfig
from host.simulation.offline import OBSERVER
from host.sources.rig import Rig, real_rig, simulated_rig
from host.sources.sensors import LIDAR_AND_CAMERA


def drive_rig(stack: contextlib.ExitStack, robot: RobotConfig, scenario: str | None) -> Rig:
    """The devices to drive with: the robot's, or simulated ones until `stack` is left."""
    if scenario is None:
        return real_rig(robot, None)
    return simulated_rig(stack, robot, scenario, {}, LIDAR_AND_CAMERA, driven=True)


def driving_of(rig: Rig, behaviour: Behaviour) -> Driving:
    """Drives these devices by the behaviour."""
    return Driving(rig.config, behaviour, rig.board.command, rig.last_return)


def contacts_in_words(rig: Rig) -> str:
    """What a simulated robot drove against and who drove against it; "": nothing is known."""
    if rig.contacts is None:
        return ""
    contacts = rig.contacts()
    own = sum(contact.robot == OBSERVER for contact in contacts)
    others = sum(contact.other == OBSERVER for contact in contacts)
    return f"contacts: the robot drove against something {own} times, others against it {others}"
