"""The arena: a square room with posts, in which differential-drive robots walk at random.

The walk is that of Belaroussi 2024, appendix A.1: straight on until one of four front proximity
sensors reads less than 0.4 m, then away from it for a random 0.2 to 0.8 s. The reading is taken
from the robot's centre, so that robots do come near each other. Bodies are discs that never
overlap; what would make them touch is stopped as a bumper would.
"""

import math

import numpy as np

from host.errors import UserError
from host.geometry import wrap
from host.messages import BoolArray, FloatArray
from host.simulation.world.scenarios import Scenario

ARENA_STEP_S = 0.02
FORGET_STEPS = 512  # to be forgotten at once, since the rest is moved
BODY_RADIUS_M = 0.143  # the circle around a Cherokey of 22.5 x 17.5 cm
TURRET_RADIUS_M = 0.0325  # a post is as thick as a turret
SENSOR_BEARINGS = np.radians([60.0, 20.0, -20.0, -60.0])  # the left two come first
SENSOR_HALF_CONE = math.radians(20.0)
SENSOR_RANGE_M = 0.4
TURN_RATE_RADPS = 3.0
TURN_SECONDS = (0.2, 0.8)
ACCELERATION_MPS2 = 1.0
TURN_ACCELERATION_RADPS2 = 20.0


class Arena:
    """Robots on the move; time starts at 0 and the room's centre is the origin.

    posts (p, 2) m stand still. The motion is a function of the scenario alone: it is computed in
    fixed steps, when someone asks for a time not reached yet.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.half_side_m = scenario.side_m / 2.0
        self.count = scenario.robots
        self._speed = scenario.speed_mps
        self._random = scenario.generator("arena")
        places = self._place(scenario)
        self.posts: FloatArray = places[self.count :]
        # Of the obstacles, which are the robots and then the posts.
        self._radii = np.full(len(places), TURRET_RADIUS_M)
        self._radii[: self.count] = BODY_RADIUS_M
        self._each = np.arange(self.count)
        self._position = places[: self.count]
        self._heading = self._random.uniform(-math.pi, math.pi, self.count)
        self._velocity = np.zeros(self.count)
        self._turn_rate = np.zeros(self.count)
        self._rotate_until = np.zeros(self.count)
        self._rotation_sign = np.ones(self.count)
        self._history = np.zeros((512, self.count, 3))
        self._first = 0  # the step of the history's first row
        self._steps = 0
        self._record()

    def _place(self, scenario: Scenario) -> FloatArray:
        """Robots, then posts, at random and apart from each other and the walls."""
        room = self.half_side_m - 0.35
        places = np.empty((0, 2))
        for _ in range(400 * (scenario.robots + scenario.posts)):
            candidate = self._random.uniform(-room, room, 2)
            if np.all(np.hypot(*(places - candidate).T) > 0.5):
                places = np.vstack((places, candidate))
            if len(places) == scenario.robots + scenario.posts:
                return places
        raise UserError(
            f"no room for {scenario.robots} robots and {scenario.posts} posts",
            f"they start 0.5 m apart in {scenario.side_m} x {scenario.side_m} m",
            "ask for fewer of them or a larger side_m",
        )

    @property
    def now(self) -> float:
        """The time reached, s."""
        return (self._steps - 1) * ARENA_STEP_S

    def advance(self, until: float) -> None:
        """Move on to `until` seconds, in whole steps; never back."""
        while self.now < until:
            self._step()

    def poses(self, times: FloatArray) -> FloatArray:
        """Poses (k, n, 3): x, y (m), heading (rad, not wrapped) of every robot at `times` (k,).

        Before 0, or what is forgotten, the robots stand still; a later time than reached moves the
        arena on.
        """
        index = np.maximum(np.asarray(times, dtype=float) / ARENA_STEP_S, 0.0)
        if index.size:
            self.advance(float(index.max()) * ARENA_STEP_S)
        index = np.maximum(index, self._first)
        before = np.minimum(index.astype(np.intp), self._steps - 1)
        after = np.minimum(before + 1, self._steps - 1)
        share = (index - before)[:, None, None]
        begin, end = self._history[before - self._first], self._history[after - self._first]
        poses: FloatArray = (1.0 - share) * begin + share * end
        return poses

    def track(self, robot: int, first_step: int) -> FloatArray:
        """Poses (k, 3) of one robot at every step from `first_step` to the time reached."""
        return self._history[first_step - self._first : self._steps - self._first, robot]

    def forget(self, before: float) -> None:
        """Forget poses of times before `before` (s), now or later."""
        old = min(int(before / ARENA_STEP_S), self._steps - 1) - self._first
        if old >= FORGET_STEPS:
            self._history = self._history[old:].copy()
            self._first += old

    def _record(self) -> None:
        row = self._steps - self._first
        if row == len(self._history):
            self._history = np.concatenate((self._history, np.zeros_like(self._history)))
        self._history[row, :, :2] = self._position
        self._history[row, :, 2] = self._heading
        self._steps += 1

    def _step(self) -> None:
        offsets = self._offsets(self._position)
        self._decide(offsets)
        rotating = self.now < self._rotate_until
        speed = np.where(rotating, 0.0, self._speed)
        rate = np.where(rotating, self._rotation_sign * TURN_RATE_RADPS, 0.0)
        self._velocity += _limited(speed - self._velocity, ACCELERATION_MPS2 * ARENA_STEP_S)
        self._turn_rate += _limited(rate - self._turn_rate, TURN_ACCELERATION_RADPS2 * ARENA_STEP_S)

        middle = self._heading + 0.5 * ARENA_STEP_S * self._turn_rate
        move = (ARENA_STEP_S * self._velocity)[:, None] * np.stack(
            (np.cos(middle), np.sin(middle)), axis=1
        )
        stopped = self._would_touch(move, offsets)
        if stopped.any():
            move[stopped] = 0.0
            self._velocity[stopped] = 0.0
            self._start_rotation(stopped & ~rotating, self._random_signs())
        self._position = self._position + move
        self._heading = self._heading + ARENA_STEP_S * self._turn_rate
        self._record()

    def _decide(self, offsets: FloatArray) -> None:
        """Start a rotation away from whatever the front sensors of a robot going straight see."""
        left, right = self._proximity(offsets)
        alarmed = (left | right) & (self.now >= self._rotate_until)
        if alarmed.any():
            away = np.where(left, -1.0, 1.0)  # clockwise, away from what is on the left
            self._start_rotation(alarmed, np.where(left & right, self._random_signs(), away))

    def _random_signs(self) -> FloatArray:
        return self._random.choice(np.array([-1.0, 1.0]), self.count)

    def _start_rotation(self, which: BoolArray, signs: FloatArray) -> None:
        durations = self._random.uniform(*TURN_SECONDS, self.count)
        self._rotate_until = np.where(which, self.now + durations, self._rotate_until)
        self._rotation_sign = np.where(which, signs, self._rotation_sign)

    def _proximity(self, offsets: FloatArray) -> tuple[BoolArray, BoolArray]:
        """Whether the left and the right pair of front sensors of each robot (n,) see anything."""
        distance = np.hypot(offsets[..., 0], offsets[..., 1])
        bearing = np.arctan2(offsets[..., 1], offsets[..., 0]) - self._heading[:, None]
        near = distance - self._radii < SENSOR_RANGE_M
        cone = SENSOR_HALF_CONE + np.arcsin(np.minimum(self._radii / distance, 1.0))
        off_axis = np.abs(wrap(bearing[..., None] - SENSOR_BEARINGS))
        seen = np.any(near[..., None] & (off_axis < cone[..., None]), axis=1)

        angles = self._heading[:, None] + SENSOR_BEARINGS
        direction = np.stack((np.cos(angles), np.sin(angles)), axis=-1)
        gap = self.half_side_m - np.sign(direction) * self._position[:, None, :]
        wall = np.min(gap / np.maximum(np.abs(direction), 1e-9), axis=-1)
        seen |= wall < SENSOR_RANGE_M
        return seen[:, :2].any(axis=1), seen[:, 2:].any(axis=1)

    def _offsets(self, positions: FloatArray) -> FloatArray:
        """Return where every obstacle (robots, posts) is from every robot: (n, n + p, 2) m.

        A robot's offset to itself is far away.
        """
        offsets: FloatArray = np.concatenate((positions, self.posts)) - positions[:, None]
        offsets[self._each, self._each] = 1e3
        return offsets

    def _would_touch(self, move: FloatArray, offsets: FloatArray) -> BoolArray:
        """Which robots (n,) must not make their move (n, 2): it would end in an overlap.

        Of two robots only those that drive at the other are stopped, so that none is held for
        ever. Stopping one may leave it in a third one's way: repeat until nothing changes.
        """
        stopped: BoolArray = np.zeros(self.count, dtype=bool)
        approaching = np.einsum("ik,ijk->ij", move, offsets) > 0.0
        limit = self.half_side_m - BODY_RADIUS_M
        while True:
            tried = self._position + np.where(stopped[:, None], 0.0, move)
            outside = np.any((np.abs(tried) > limit) & (self._position * move > 0.0), axis=1)
            ahead = self._offsets(tried)
            touching = np.hypot(ahead[..., 0], ahead[..., 1]) < self._radii + BODY_RADIUS_M
            more = (outside | np.any(touching & approaching, axis=1)) & ~stopped
            if not more.any():
                return stopped
            stopped |= more


def _limited(change: FloatArray, most: float) -> FloatArray:
    return np.minimum(np.maximum(change, -most), most)
