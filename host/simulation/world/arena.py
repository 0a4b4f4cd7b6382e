"""The arena: a square room with posts and furniture, in which differential-drive robots walk.

The random walk is that of Belaroussi 2024, appendix A.1: straight on until one of four front
proximity sensors reads less than 0.4 m, then away from it for a random 0.2 to 0.8 s. The reading is
taken from the robot's centre, so that robots do come near each other. Bodies are discs that never
overlap; what would make them touch is stopped as a bumper would. A pair that drives side by side
walks as one body, which rotates about its middle: one robot then drives backwards. A robot that is
handed over does not walk: its own wheels move it, until something is in its way.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from host.errors import UserError
from host.geometry import to_parent, wrap
from host.messages import BoolArray, FloatArray
from host.simulation.world.furniture import furnish, nearest_points
from host.simulation.world.scenarios import Scenario
from host.simulation.world.staged import PAIR, SquarePath, edge_pose, walkers_of

ARENA_STEP_S = 0.02
FORGET_STEPS = 512  # to be forgotten at once, since the rest is moved
BODY_RADIUS_M = 0.143  # the circle around a Cherokey of 22.5 x 17.5 cm
TURRET_RADIUS_M = 0.0325  # a post is as thick as a turret
_START_CLEARANCE_M = 0.4  # from furniture; more than a pair's reach
SENSOR_BEARINGS = np.radians([60.0, 20.0, -20.0, -60.0])  # the left two come first
SENSOR_HALF_CONE = math.radians(20.0)
SENSOR_RANGE_M = 0.4
TURN_RATE_RADPS = 3.0
TURN_SECONDS = (0.2, 0.8)
ACCELERATION_MPS2 = 1.0
TURN_ACCELERATION_RADPS2 = 20.0

# How far a robot's wheels carried it up to a time (s), since it was last asked: m, rad.
Wheelwork = Callable[[float], tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Contact:
    """A robot drove against something. time s; robot: who moved; other: whom it met, -1: a thing.

    A robot that stays pressed against the same thing has one contact with it.
    """

    time: float
    robot: int
    other: int


class Arena:
    """Robots on the move; time starts at 0 and the room's centre is the origin.

    posts (p, 2) m and furniture stand still. The motion is a function of the scenario alone: it is
    computed in fixed steps, when someone asks for a time not reached yet. With robots handed over
    it waits for `advance` instead. contacts: of all robots, in order.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.half_side_m = scenario.side_m / 2.0
        self._half_m = (scenario.fence_m or scenario.side_m) / 2.0  # where robots drive
        self.count = scenario.robots
        self.furniture = furnish(scenario)
        self._closed = self.furniture.closed
        self._random = scenario.generator("arena")
        self._pair_m = scenario.pair_m
        walkers = walkers_of(scenario)
        places = self._place(scenario, walkers)
        self.posts: FloatArray = places[walkers:]
        self._round = np.concatenate((self.posts, self.furniture.legs))
        self._reach = np.full(walkers, BODY_RADIUS_M)
        if self._pair_m:
            self._reach[PAIR] += 0.5 * self._pair_m
        self._radii = np.concatenate(
            (
                self._reach,
                np.full(scenario.posts, TURRET_RADIUS_M),
                self.furniture.leg_radii,
                np.zeros(len(self._closed)),
            )
        )
        self._each = np.arange(walkers)
        self._position = places[:walkers]
        self._heading = self._random.uniform(-math.pi, math.pi, walkers)
        self._drives = self._each < walkers - scenario.standing
        self._square = SquarePath(scenario) if scenario.square_m else None
        if scenario.at_edge:
            self._position[0], self._heading[0] = edge_pose(scenario)
            self._drives[0] = False
        self._speed = np.where(self._drives, scenario.speed_mps, 0.0)
        self._velocity = np.zeros(walkers)
        self._turn_rate = np.zeros(walkers)
        self._rotate_until = np.zeros(walkers)
        self._rotation_sign = np.ones(walkers)
        self._wheelworks: dict[int, Wheelwork] = {}
        self.contacts: list[Contact] = []
        self._held: set[tuple[int, int]] = set()  # who is pressed against whom
        self._history = np.zeros((512, self.count, 3))
        self._first = 0  # the step of the history's first row
        self._steps = 0
        self._record()

    def _place(self, scenario: Scenario, walkers: int) -> FloatArray:
        """Walkers, then posts, at random and apart from each other, furniture and walls."""
        room = self._half_m - 0.35
        places = np.empty((0, 2))
        for _ in range(400 * (scenario.robots + scenario.posts) if room > 0.0 else 0):
            candidate = self._random.uniform(-room, room, 2)
            apart = np.all(np.hypot(*(places - candidate).T) > 0.5)
            if apart and self.furniture.clearance(candidate) > _START_CLEARANCE_M:
                places = np.vstack((places, candidate))
            if len(places) == walkers + scenario.posts:
                return places
        raise UserError(
            f"no room for {scenario.robots} robots and {scenario.posts} posts",
            f"they start 0.5 m apart in a square of {2.0 * self._half_m} m, off furniture",
            "ask for fewer of them, less furniture or a larger side_m (or fence_m)",
        )

    def hand_over(self, robot: int, wheelwork: Wheelwork) -> None:
        """Let its wheels move a robot from now on. Raises UserError where it is one of a pair."""
        if self._pair_m and robot in (PAIR, PAIR + 1):
            raise UserError(
                f"robot {robot} cannot drive on its own",
                "it is one of a pair that drives side by side",
                "leave pair_m out, or stacks=all",
            )
        walker = robot if not self._pair_m or robot == 0 else robot - 1
        self._wheelworks[walker] = wheelwork
        self._drives[walker] = False
        self._speed[walker] = 0.0

    def take_away(self, robot: int) -> None:
        """Carry a robot that was handed over far out of the room, where it stays."""
        del self._wheelworks[robot]
        self._velocity[robot] = self._turn_rate[robot] = 0.0
        self._position[robot] = 1e3

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
        arena on or, with robots handed over, is foreseen by their last motion.
        """
        index = np.maximum(np.asarray(times, dtype=float) / ARENA_STEP_S, 0.0)
        if index.size and not self._wheelworks:
            self.advance(float(index.max()) * ARENA_STEP_S)
        index = np.maximum(index, self._first)
        last = self._steps - 1
        before = np.minimum(index.astype(np.intp), max(last - 1, 0) if self._wheelworks else last)
        after = np.minimum(before + 1, last)
        begin, end = (self._history.take(rows - self._first, axis=0) for rows in (before, after))
        poses: FloatArray = begin + (index - before)[:, None, None] * (end - begin)
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
        poses = np.column_stack((self._position, self._heading))
        if self._pair_m:
            beside = np.array([[0.0, 0.5 * self._pair_m], [0.0, -0.5 * self._pair_m]])
            pair = np.tile(poses[PAIR], (2, 1))
            pair[:, :2] = to_parent(beside, poses[PAIR])
            poses = np.concatenate((poses[:PAIR], pair, poses[PAIR + 1 :]))
        self._history[row] = poses
        self._steps += 1

    def _step(self) -> None:
        offsets = self._offsets(self._position)
        self._decide(offsets)
        rotating = self.now < self._rotate_until
        speed = np.where(rotating, 0.0, self._speed)
        rate = np.where(rotating, self._rotation_sign * TURN_RATE_RADPS, 0.0)
        self._velocity += _limited(speed - self._velocity, ACCELERATION_MPS2 * ARENA_STEP_S)
        self._turn_rate += _limited(rate - self._turn_rate, TURN_ACCELERATION_RADPS2 * ARENA_STEP_S)

        for robot, wheelwork in self._wheelworks.items():
            way, rotation = wheelwork(self._steps * ARENA_STEP_S)
            self._velocity[robot] = way / ARENA_STEP_S
            self._turn_rate[robot] = rotation / ARENA_STEP_S

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
        if self._square is not None:
            self._position[1], self._heading[1] = self._square.at(self._steps * ARENA_STEP_S)
        self._record()

    def _decide(self, offsets: FloatArray) -> None:
        """Start a rotation away from whatever the front sensors of a robot going straight see."""
        left, right = self._proximity(offsets)
        alarmed = (left | right) & self._drives & (self.now >= self._rotate_until)
        if alarmed.any():
            away = np.where(left, -1.0, 1.0)  # clockwise, away from what is on the left
            self._start_rotation(alarmed, np.where(left & right, self._random_signs(), away))

    def _random_signs(self) -> FloatArray:
        return self._random.choice(np.array([-1.0, 1.0]), len(self._each))

    def _start_rotation(self, which: BoolArray, signs: FloatArray) -> None:
        durations = self._random.uniform(*TURN_SECONDS, len(self._each))
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
        gap = self._half_m - np.sign(direction) * self._position[:, None, :]
        wall = np.min(gap / np.maximum(np.abs(direction), 1e-9), axis=-1)
        seen |= wall < SENSOR_RANGE_M
        return seen[:, :2].any(axis=1), seen[:, 2:].any(axis=1)

    def _offsets(self, positions: FloatArray) -> FloatArray:
        """Return where every obstacle is from every walker: (n, n + m, 2) m.

        Obstacles are the walkers, posts and legs, then what is closed, by its nearest point. A
        walker's offset to itself is far away.
        """
        offsets: FloatArray = np.concatenate((positions, self._round)) - positions[:, None]
        if len(self._closed):
            nearest = nearest_points(self._closed, positions) - positions[:, None]
            offsets = np.concatenate((offsets, nearest), axis=1)
        offsets[self._each, self._each] = 1e3
        return offsets

    def _would_touch(self, move: FloatArray, offsets: FloatArray) -> BoolArray:
        """Which robots (n,) must not make their move (n, 2): it would end in an overlap.

        Of two robots only those that drive at the other are stopped, so that none is held for
        ever. Stopping one may leave it in a third one's way: repeat until nothing changes.
        """
        stopped: BoolArray = np.zeros(len(move), dtype=bool)
        held: set[tuple[int, int]] = set()
        approaching = np.einsum("ik,ijk->ij", move, offsets) > 0.0
        limit = (self._half_m - self._reach)[:, None]
        while True:
            tried = self._position + np.where(stopped[:, None], 0.0, move)
            outside = np.any((np.abs(tried) > limit) & (self._position * move > 0.0), axis=1)
            ahead = self._offsets(tried)
            distance = np.hypot(ahead[..., 0], ahead[..., 1])
            touching = (distance < self._radii + self._reach[:, None]) & approaching
            more = (outside | np.any(touching, axis=1)) & ~stopped
            if not more.any():
                self._note_contacts(held)
                return stopped
            stopped |= more
            held |= {(int(k), -1) for k in np.flatnonzero(outside & more)}
            held |= {
                (int(k), int(other) if other < len(move) else -1)
                for k, other in zip(*np.nonzero(touching & more[:, None]), strict=True)
            }

    def _note_contacts(self, held: set[tuple[int, int]]) -> None:
        for robot, other in sorted(held - self._held):
            self.contacts.append(Contact(self._steps * ARENA_STEP_S, robot, other))
        self._held = held


def _limited(change: FloatArray, most: float) -> FloatArray:
    return np.minimum(np.maximum(change, -most), most)
