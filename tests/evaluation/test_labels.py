import itertools
import math

import numpy as np
import pytest

from host.evaluation.labels import TruthTrack, label
from host.messages import Bearings, Positions, Truth


def some_positions(points, time=0.0):
    points = np.array(points, dtype=float).reshape(-1, 2)
    return Positions(time, points, np.tile(0.01 * np.eye(2), (len(points), 1, 1)))


TRUTH = Truth(0.0, np.array([7, 3]), np.array([[1.0, 0.0], [0.0, 2.0]]))


def test_positions_get_the_robot_within_the_gate_and_each_robot_once():
    seen = label(some_positions([[0.1, 2.0], [1.2, 0.0], [1.1, 0.0], [0.0, 2.26]]), TRUTH)
    assert seen.identities.tolist() == [3, -1, 7, -1]


def test_bearings_get_the_robot_within_four_sigma_across_the_cut_at_pi():
    behind = Truth(0.0, np.array([4]), np.array([[-2.0, -0.01]]))
    inside, outside = math.pi - 0.19, math.pi - 0.21
    for bearing, wanted in ((inside, 4), (outside, -1), (0.0, -1)):
        seen = label(Bearings(0.0, np.array([bearing]), np.array([0.05**2])), behind)
        assert seen.identities.tolist() == [wanted]


def test_bearings_start_at_their_origin():
    truth = Truth(0.0, np.array([4]), np.array([[1.0, 1.0]]))
    ahead = Bearings(0.0, np.array([0.0]), np.array([0.01**2]), origin=(0.0, 1.0))
    assert label(ahead, truth).identities.tolist() == [4]


def test_the_pairing_has_the_least_total_cost():
    generator = np.random.default_rng(3)
    for _ in range(50):
        truth = Truth(0.0, np.arange(3), generator.uniform(0, 0.4, (3, 2)))
        readings = generator.uniform(0, 0.4, (3, 2))
        found = label(some_positions(readings), truth).identities
        cost = np.linalg.norm(readings[:, None] - truth.positions, axis=2) / 0.25
        cost = np.minimum(cost, 1.0) ** 2
        least = min(cost[range(3), order].sum() for order in itertools.permutations(range(3)))
        paid = sum(1.0 if who < 0 else cost[k, who] for k, who in enumerate(found))
        assert paid == pytest.approx(least)


def test_nothing_seen_or_nobody_there():
    nobody = Truth(0.0, np.zeros(0, dtype=np.int64), np.zeros((0, 2)))
    assert label(some_positions([]), TRUTH).identities.shape == (0,)
    assert label(some_positions([[1, 0]]), nobody).identities.tolist() == [-1]


def test_truth_is_interpolated_for_those_known_on_both_sides():
    later = Truth(2.0, np.array([3, 9]), np.array([[1.0, 3.0], [5.0, 5.0]]))
    track = TruthTrack([TRUTH, later])
    between = track.at(0.5)
    assert between.identities.tolist() == [3]
    assert between.positions == pytest.approx(np.array([[0.25, 2.25]]))
    assert track.at(2.0) is later
    assert track.at(0.0) is TRUTH
    assert track.at(-0.1) is None
    assert track.at(2.1) is None
