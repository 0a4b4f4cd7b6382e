"""A line, and a meeting, of anonymous robots by relative positions alone."""

from dataclasses import dataclass

import numpy as np

from host.behaviour.formations.motion import LOOK_AROUND, clear, towards
from host.behaviour.interface import Command, Situation
from host.messages import FloatArray

_ONTO_PER_S = 0.8
_ALONG_PER_S = 0.5


@dataclass(frozen=True, slots=True)
class Line:
    """All on one line, evenly.

    In a line robots hide all but their neighbours, so neighbours are all it takes: the line is the
    main axis of whoever is known, an inner robot goes to the middle of the two beside it, an outer
    one keeps the spacing. One that leaves the line sees, and is seen, over its neighbour's turret.
    """

    spacing_m: float = 0.6

    def command(self, now: Situation) -> Command:
        """Never done. Without a teammate in sight it looks around."""
        if not len(now.teammates):
            return LOOK_AROUND
        return towards(clear(now, self.velocity(now.teammates)))

    def velocity(self, mates: FloatArray) -> FloatArray:
        """For a robot at the origin, (2,) m/s; mates (n, 2) m."""
        axis = main_axis(np.vstack((np.zeros(2), mates)))
        places = mates @ axis
        ahead, behind = places[places > 0.0], -places[places <= 0.0]
        onto = np.zeros(2)
        if len(mates) > 1:  # the foot of the robot on the line of the others
            line = main_axis(mates)
            middle = mates.mean(axis=0)
            onto = middle - (middle @ line) * line
            onto = onto - (onto @ axis) * axis
        return np.asarray(_ONTO_PER_S * onto + _ALONG_PER_S * self._along(ahead, behind) * axis)

    def _along(self, ahead: FloatArray, behind: FloatArray) -> float:
        """How far (m) to go along the axis, by the distances of who is ahead and behind."""
        if len(ahead) and len(behind):
            return 0.5 * float(ahead.min() - behind.min())
        if len(ahead):
            return float(ahead.min()) - self.spacing_m
        return self.spacing_m - float(behind.min())


def main_axis(points: FloatArray) -> FloatArray:
    """The unit vector (2,) along which points (n, 2) spread most."""
    around = points - points.mean(axis=0)
    axis: FloatArray = np.linalg.eigh(around.T @ around)[1][:, 1]
    return axis


@dataclass(frozen=True, slots=True)
class Gather:
    """Consensus on relative positions: everyone goes to the mean of whom it knows.

    They stop where T0 keeps them apart.
    """

    gain_per_s: float = 0.5

    def command(self, now: Situation) -> Command:
        """Never done. Without a teammate in sight it looks around."""
        if not len(now.teammates):
            return LOOK_AROUND
        return towards(clear(now, self.gain_per_s * now.teammates.mean(axis=0)))
