"""Who a drive's wheels move, and how they count: which explanation holds from when to when.

An explanation says which body the wheels move, and what ways they truly went, given those that
were counted. With both wheels' gains known, each predicts its body's rotation in every window. The
sequence of explanations is the one that predicts best, at a price for each change (Viterbi's
algorithm); the gains, which are the robot's geometry, are fitted to it in turn.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from host.calibration.identity.windows import STRIDE_S, Moved
from host.messages import FloatArray, IntArray

LEAST_WINDOWS = 8  # of a spell that is to be believed, besides its edges
LEAST_ROTATION_RAD = 0.15  # in a window: less does not show who is who
_SIGMA, _LEAST_SIGMA_RAD = 0.1, 0.06  # of a prediction, as a share of the rms of rotations
_LEAST_WAY_M = 0.05
_WAY_SIGMA, _OFFSET_M, _LEAST_SIGMA_M = 0.2, 0.1, 0.02  # of a way; of where the body sits; floor
_MOST, _UNSEEN = 36.0, 9.0  # squared sigmas: that a window counts at most, and without its body
FAILS = 4.0  # squared sigmas where the sound explanation does not hold
_MOSTLY = 0.7  # quantile of an explanation's squared errors; the others are at its edges
_PASSES = 3
_FACTORS = (0.7, 1.4)  # by which the geometry may be off ...
_COUNTS = (0.25, 4.0)  # ... and counts per revolution, which are off by powers of two
_ABSURD_RAD = 10.0  # in a window: nan where a body's number goes to another
_HOLD = 0.05  # by which gains are held where a path does not show them


@dataclass(frozen=True, slots=True)
class Explanation:
    """body: that the wheels move. true_ways (2, 2): of the ways counted. words: "" if sound.
    wheel: the one that counts a share of its way, which is fitted. price: of going over to it;
    fits: what it may leave, both in squared sigmas. windows: a shorter spell may be chance."""

    body: int
    true_ways: FloatArray
    words: str = ""
    wheel: int | None = None
    price: float = 60.0
    fits: float = 2.0
    windows: int = LEAST_WINDOWS


@dataclass(frozen=True, slots=True)
class Spell:
    """Windows from begin to end (not included) that one explanation explains, and no sound one."""

    explanation: Explanation
    begin: int
    end: int


class Story:
    """The best sequence of explanations, and what it costs.

    moved: a drive. explanations: the first is the sound one. gains (2,) rad/m: a first guess of how
    each wheel's way rotates the robot.
    """

    def __init__(
        self,
        moved: Moved,
        explanations: Sequence[Explanation],
        track_m: float,
        gains: FloatArray,
    ) -> None:
        self._moved, self._explanations = moved, list(explanations)
        self._track_m, self._guess, self._gains = track_m, gains, gains
        bodies = np.stack([moved.bodies[each.body] for each in explanations], axis=1)
        self._rotations, self._went = bodies[:, :, 2], np.hypot(bodies[:, :, 0], bodies[:, :, 1])
        squares = np.minimum(self._rotations[:, 0] ** 2, _ABSURD_RAD**2)
        self._sigma = max(_SIGMA * math.sqrt(np.nanmean(squares)), _LEAST_SIGMA_RAD)
        self._choose()
        for _ in range(_PASSES):
            self._refit()
            self._choose()

    def _choose(self) -> None:
        """The explanations of the least cost with the present gains and shares."""
        ways = np.stack([self._moved.ways @ e.true_ways.T for e in self._explanations], axis=1)
        rotated = ways @ self._gains
        # Where the body sits on the robot is not known: where that rotates, it goes otherwise.
        went = np.abs(ways.mean(axis=2)) * float(np.abs(self._gains).mean()) * self._track_m
        sigmas = _WAY_SIGMA * went + _OFFSET_M * np.abs(rotated) + _LEAST_SIGMA_M
        squares = ((self._rotations - rotated) / self._sigma) ** 2
        squares += ((self._went - went) / sigmas) ** 2
        self.costs = np.where(np.isfinite(squares), np.minimum(squares, _MOST), _UNSEEN)
        prices = np.array([each.price for each in self._explanations])
        self.chosen, self.cost = _cheapest(self.costs, prices)
        self._moves = (np.abs(rotated) > LEAST_ROTATION_RAD) | (went > _LEAST_WAY_M)

    def _refit(self) -> None:
        """Gains, and shares of the counts, by least squares over the windows that are explained."""
        row = np.arange(len(self.chosen))
        good = self.costs[row, self.chosen] < _UNSEEN
        rotation = self._rotations[row, self.chosen]
        sound = np.full(len(row), True)
        for number, each in enumerate(self._explanations):
            own = good & (self.chosen == number)
            if each.wheel is None or np.count_nonzero(own) < LEAST_WINDOWS:
                continue
            sound[own] = False
            parts = self._moved.ways[own] * self._gains
            counted, gone = parts[:, each.wheel], rotation[own] - parts[:, 1 - each.wheel]
            longer = max(float(counted @ gone) / max(float(counted @ counted), 1e-12), 1.0)
            ways = np.where(np.arange(2) == each.wheel, longer, 1.0)
            self._explanations[number] = replace(each, true_ways=np.diag(ways))
        true_ways = np.stack([each.true_ways for each in self._explanations])[self.chosen]
        ways = np.einsum("wij,wj->wi", true_ways, self._moved.ways)[good & sound]
        if len(ways) >= LEAST_WINDOWS:
            self._gains = self._guess * np.clip(
                held(ways, rotation[good & sound], self._gains) / self._guess, *_FACTORS
            )

    def spells(self) -> list[Spell]:
        """The parts that another explanation than the sound one explains beyond doubt."""
        found = []
        edges = [0, *(np.flatnonzero(np.diff(self.chosen)) + 1).tolist(), len(self.chosen)]
        for begin, end in itertools.pairwise(edges):
            number = int(self.chosen[begin])
            sound, other = self.costs[begin:end, [0, number]][self._moves[begin:end, number]].T
            tells = sound > FAILS
            each = self._explanations[number]
            if (
                number
                and np.count_nonzero(tells) >= each.windows
                and np.quantile(other, _MOSTLY) < each.fits
                and np.quantile(other[tells], _MOSTLY) < each.fits
            ):
                found.append(Spell(each, begin, end))
        return found


def best_story(moved: Moved, explanations: Sequence[Explanation], track_m: float) -> Story:
    """The cheapest of the stories from several first guesses of the gains."""
    configured = np.array([-1.0, 1.0]) / track_m
    squares = np.minimum(moved.bodies[explanations[0].body][:, 2] ** 2, _ABSURD_RAD**2)
    by_wheels = (moved.ways @ configured)[np.isfinite(squares)] ** 2
    size = math.sqrt(float(np.nanmean(squares)) / max(float(np.mean(by_wheels)), 1e-9))
    guesses = {1.0, 2.0 ** round(math.log2(float(np.clip(size, *_COUNTS))))}
    stories = [
        Story(moved, explanations, track_m, factor * configured) for factor in sorted(guesses)
    ]
    return min(stories, key=lambda story: story.cost)


def held(ways: FloatArray, rotation: FloatArray, gains: FloatArray) -> FloatArray:
    """Gains (2,) rad/m by least squares, near those given where ways (w, 2) do not show them."""
    hold = _HOLD * math.sqrt(float(np.sum(ways**2))) + 1e-9
    rows = np.concatenate((ways, hold * np.eye(2)))
    values = np.concatenate((rotation, hold * gains))
    return np.asarray(np.linalg.lstsq(rows, values, rcond=None)[0])


def _cheapest(costs: FloatArray, prices: FloatArray) -> tuple[IntArray, float]:
    """The sequence (w,) of columns of costs (w, k) with the least sum, and the sum.

    prices (k,): of going over to each column, and of beginning with another one than the first.
    """
    total = costs[0] + np.where(np.arange(len(prices)) > 0, prices, 0.0)
    came = np.zeros(costs.shape, dtype=np.int64)
    for row, cost in enumerate(costs[1:], 1):
        best = int(np.argmin(total))
        goes_over = total > total[best] + prices
        came[row] = np.where(goes_over, best, np.arange(len(prices)))
        total = cost + np.where(goes_over, total[best] + prices, total)
    chosen = np.zeros(len(costs), dtype=np.int64)
    chosen[-1] = np.argmin(total)
    for row in range(len(costs) - 1, 0, -1):
        chosen[row - 1] = came[row, chosen[row]]
    return chosen, float(total.min())


def parts_of(spells: Sequence[Spell], moved: Moved) -> tuple[list[tuple[float, float]], float]:
    """From when to when (s) each holds, and how long the drive is.

    The first window reaches to the begin of the drive, the last one to its end.
    """
    starts, middle = moved.starts, 0.5 * (moved.length_s - STRIDE_S)
    last, whole = len(starts), float(starts[-1]) + moved.length_s
    parts = [
        (
            float(starts[s.begin]) + (middle if s.begin else 0.0),
            float(starts[s.end] + middle if s.end < last else whole),
        )
        for s in spells
    ]
    return parts, whole
