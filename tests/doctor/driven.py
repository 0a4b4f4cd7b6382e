"""A robot that obeys its board, in a room of straight walls, and how its wheels may be wired."""

import math
from dataclasses import dataclass

import numpy as np

from host.config import Wheels
from host.messages import FloatArray
from host.simulation.devices.romeo_stand_in import RomeoStandIn

STEP_S = 0.01
RECENT = 200  # steps: a lidar asks for samples of the last packets
WALLS_M = (-1.2, 2.0, -0.9, 1.6)  # x from, to; y from, to


@dataclass(frozen=True, slots=True)
class Wiring:
    """motor, encoder (left, right): 1 as it should be, -1 the other way round, 0 dead.

    drives, counts (left, right): which wheel the channel's motor and its encoder are at.
    """

    motor: tuple[int, int] = (1, 1)
    encoder: tuple[int, int] = (1, 1)
    drives: tuple[int, int] = (0, 1)
    counts: tuple[int, int] = (0, 1)


class DrivenRobot:
    """Wheels that run as commanded, at once. board: the stand-in that is to be plugged in."""

    def __init__(self, wiring: Wiring, geometry: Wheels) -> None:
        self.board = RomeoStandIn(self._ticks)
        self._wiring, self._geometry = wiring, geometry
        self._times, self._poses = [0.0], [(0.0, 0.0, 0.0)]
        self._angles = np.zeros(2)  # of the wheels, in ticks

    def sense(self, times: FloatArray, raw_angles: FloatArray) -> FloatArray:
        """Ranges to the walls: what an X4Emulator measures."""
        self._advance(float(times[-1]))
        past = np.column_stack((self._times[-RECENT:], self._poses[-RECENT:]))
        x, y, heading = (np.interp(times, past[:, 0], column) for column in past[:, 1:].T)
        along = heading - raw_angles
        with np.errstate(divide="ignore"):
            to_x = np.where(np.cos(along) > 0, WALLS_M[1] - x, WALLS_M[0] - x) / np.cos(along)
            to_y = np.where(np.sin(along) > 0, WALLS_M[3] - y, WALLS_M[2] - y) / np.sin(along)
        noise = np.random.default_rng(int(1e6 * times[0])).normal(0.0, 0.003, len(times))
        return np.asarray(np.minimum(to_x, to_y) + noise)

    def _ticks(self, time: float) -> tuple[int, int]:
        if hasattr(self, "_angles"):
            self._advance(time)
            encoder, counts = self._wiring.encoder, self._wiring.counts
            left, right = (encoder[k] * self._angles[counts[k]] for k in (0, 1))
            return round(left), round(right)
        return 0, 0

    def _advance(self, until: float) -> None:
        metres = math.tau * self._geometry.left_radius_m / self._geometry.counts_per_turn
        while self._times[-1] < until:
            time = self._times[-1] + STEP_S
            asked, wheels = self.board.wheel_speeds(time), np.zeros(2)
            for channel in (0, 1):
                wheels[self._wiring.drives[channel]] += self._wiring.motor[channel] * asked[channel]
            self._angles += wheels * STEP_S
            left, right = wheels * STEP_S * metres
            x, y, heading = self._poses[-1]
            turned = (right - left) / self._geometry.track_m
            step, along = 0.5 * (left + right), heading + 0.5 * turned
            self._poses.append(
                (x + step * math.cos(along), y + step * math.sin(along), heading + turned)
            )
            self._times.append(time)
