"""Which of the anonymous teammates is the one that a formation is about, and how it moves.

The team stands and watches: whoever moves is the target. Then it is whoever is where the target
should be by now; its label may change. Who did not see it move, or lost it, sees it by the
formation: most of the others stand at the radius around it.
"""

import math
from collections import deque

import numpy as np

from host.behaviour.interface import Situation
from host.geometry import to_frame, to_parent
from host.messages import FloatArray

_WATCH_S = 3.0
_MOVED_M = 0.2  # while it was watched: more than a standing teammate's estimate wanders
_LATEST_S = 0.5  # after the watch; from then on the team moves, too
_JUMP_M = 0.15  # between two estimates: the label has passed to another one
_GATE_M, _GATE_MPS = 0.25, 0.3  # from where the target should be, and more for each second unseen
_SLOPE_S = 1.2  # over which its velocity is taken
_SAMPLE_S = 0.1
_COAST_S = 2.0  # unseen for longer it is taken to stand
_RING_M, _MANY = 0.25, 3  # so many others so well at the radius: they stand around it
_CLEARLY = 2  # who stands on the ring has three at the radius itself: two beside it and the middle
_DOUBT_S = 2.0


class Target:
    """Follows one of the teammates. radius_m: at which the others will stand around it, or None.

    All in the robot's own odometry, where what stands still stays.
    """

    def __init__(self, radius_m: float | None = None) -> None:
        self._radius_m = radius_m
        self._until_s = math.inf if radius_m is None else _WATCH_S + _LATEST_S
        self._began = math.inf
        self._seen: dict[int, tuple[FloatArray, FloatArray]] = {}  # a label's first, last place
        self._track: deque[tuple[float, float, float]] = deque()  # time, x, y
        self._doubted = math.inf  # since when another one is in the middle

    def watching(self, now: Situation) -> bool:
        """Whether the team is to stand."""
        return now.time - self._began < _WATCH_S

    def find(self, now: Situation) -> int | None:
        """The row of the target among the teammates; None: not known, or not seen now."""
        if now.estimate is None or not len(now.teammates):
            return None
        places = to_parent(now.teammates, np.array(now.pose))
        row = self._continued(now.time, places)
        if not self._track:
            row = self._mover(now.time, places, now.estimate.labels.tolist())
        row = self._middle(now, row)
        if row is not None:
            self._note(now.time, places[row])
        return row

    def velocity(self, now: Situation) -> FloatArray:
        """How it moves (2,) m/s, in the robot's frame of this moment."""
        times, x, y = np.array(self._track).T if self._track else np.zeros((3, 0))
        if len(times) < 4 or times[-1] - times[0] < 0.5 * _SLOPE_S:
            return np.zeros(2)
        since = times - times.mean()
        slope = np.array([since @ x, since @ y]) / (since @ since)
        return to_frame(slope, np.array([0.0, 0.0, now.pose[2]]))

    def place(self, now: Situation) -> FloatArray | None:
        """Where it is taken to be (2,) m in the robot's frame, seen or not; None: not known."""
        if not self._track:
            return None
        unseen = min(now.time - self._track[-1][0], _COAST_S)
        last = to_frame(np.array(self._track[-1][1:]), np.array(now.pose))
        return last + unseen * self.velocity(now)

    def _mover(self, time: float, places: FloatArray, labels: list[int]) -> int | None:
        """Who has moved most since the watch began; None: it goes on."""
        self._began = min(self._began, time)
        for label, place in zip(labels, places, strict=True):
            first, last = self._seen.get(label, (place, place))
            jumped = float(np.hypot(*(place - last))) > _JUMP_M
            self._seen[label] = (place if jumped else first, place)
        if not _WATCH_S <= time - self._began < self._until_s:
            return None
        moved = [float(np.hypot(*(self._seen[k][1] - self._seen[k][0]))) for k in labels]
        most = int(np.argmax(moved))
        return most if moved[most] > _MOVED_M else None

    def _continued(self, time: float, places: FloatArray) -> int | None:
        """Who is where the target should be; None: nobody."""
        if not self._track:
            return None
        last, *place = self._track[-1]
        off = np.hypot(*(places - np.array(place)).T)
        nearest = int(np.argmin(off))
        return nearest if off[nearest] < _GATE_M + _GATE_MPS * (time - last) else None

    def _middle(self, now: Situation, row: int | None) -> int | None:
        """Another one, where clearly more of the others stand around that one for a while."""
        if self._radius_m is None or self.watching(now):
            return row
        mates = now.teammates
        apart = np.hypot(*(mates[:, None] - mates).transpose(2, 0, 1))
        around = np.sum(np.abs(apart - self._radius_m) < _RING_M, axis=1)
        best = int(np.argmax(around))
        others = int(np.delete(around, best).max(initial=0)) if row is None else int(around[row])
        lead = 1 if row is None else _CLEARLY
        if best == row or around[best] < max(_MANY, others + lead):
            self._doubted = math.inf
            return row
        self._doubted = min(self._doubted, now.time)
        if now.time - self._doubted < _DOUBT_S:
            return row
        self._track.clear()
        return best

    def _note(self, time: float, place: FloatArray) -> None:
        if self._track and time - self._track[-1][0] < _SAMPLE_S:
            return
        self._track.append((time, float(place[0]), float(place[1])))
        while time - self._track[0][0] > _SLOPE_S:
            self._track.popleft()
