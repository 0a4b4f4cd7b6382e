"""Rotation and translation between point sets, some of whose pairs are wrong."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from host.calibration.robust.rigid_alignment import align, align_robustly
from host.errors import UserError
from host.geometry import wrap
from host.messages import FloatArray


def moved(points: FloatArray, x: float, y: float, heading: float) -> FloatArray:
    turned = (points[:, 0] + 1j * points[:, 1]) * np.exp(1j * heading) + complex(x, y)
    return np.stack((turned.real, turned.imag), axis=1)


poses = st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-math.pi, math.pi))


@given(poses, st.integers(0, 2**32 - 1), st.integers(3, 40))
def test_any_rotation_and_translation_is_recovered(
    pose: tuple[float, float, float], seed: int, count: int
) -> None:
    points = np.random.default_rng(seed).normal(0.0, 1.0, (count, 2))
    found = align(points, moved(points, *pose))
    assert float(wrap(found.heading - pose[2])) == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(found.pose[:2], pose[:2], atol=1e-8)
    assert found.rms < 1e-8
    np.testing.assert_allclose(found.apply(points), moved(points, *pose), atol=1e-8)


def test_the_rotation_is_that_of_scipy() -> None:
    random = np.random.default_rng(3)
    for _ in range(20):
        source = random.normal(0.0, 1.0, (25, 2))
        target = moved(source, 0.0, 0.0, random.uniform(-3.0, 3.0))
        target += random.normal(0.0, 0.2, target.shape)
        weights = random.uniform(0.1, 2.0, 25)
        centred = [p - weights @ p / weights.sum() for p in (source, target)]
        flat = [np.column_stack((p, np.zeros(25))) for p in centred]
        turn = Rotation.align_vectors(flat[1], flat[0], weights=weights)[0]
        found = align(source, target, weights)
        assert float(wrap(found.heading - turn.as_rotvec()[2])) == pytest.approx(0.0, abs=1e-9)


def test_nearly_collinear_points_are_never_reflected() -> None:
    random = np.random.default_rng(11)
    reflections = 0
    for _ in range(1000):
        along = random.normal(0.0, 1.0, 12)
        source = moved(np.column_stack((along, np.zeros(12))), 0.3, -0.2, random.uniform(-3, 3))
        heading = random.uniform(-3.0, 3.0)
        target = moved(source, 0.1, 0.4, heading) + random.normal(0.0, 0.01, (12, 2))
        found = align(source, target)
        assert abs(float(wrap(found.heading - heading))) < 0.05
        corner = found.apply(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
        assert np.linalg.det(corner[1:] - corner[0]) == pytest.approx(1.0)
        # What the guard is for: the plain decomposition.
        u, _, v = np.linalg.svd((target - target.mean(0)).T @ (source - source.mean(0)))
        reflections += bool(np.linalg.det(u @ v) < 0.0)
    assert reflections > 100


def test_its_covariance_is_that_of_repeated_fits() -> None:
    random = np.random.default_rng(5)
    source = random.uniform(-1.0, 1.0, (30, 2)) + np.array([2.0, -1.0])
    pose = np.array([0.2, -0.1, 0.7])
    normalised = []
    for _ in range(400):
        target = moved(source, *pose) + random.normal(0.0, 0.02, source.shape)
        found = align(source, target)
        miss = found.pose - pose
        normalised.append(miss @ np.linalg.solve(found.covariance, miss) / 3.0)
    assert np.mean(normalised) == pytest.approx(1.0, abs=0.15)


def test_weights_say_how_much_a_pair_counts() -> None:
    random = np.random.default_rng(6)
    source = random.normal(0.0, 1.0, (10, 2))
    target = moved(source, 0.1, 0.2, 0.3) + random.normal(0.0, 0.1, source.shape)
    twice = align(np.vstack((source, source[:4])), np.vstack((target, target[:4])))
    weighted = align(source, target, np.array([2.0] * 4 + [1.0] * 6))
    np.testing.assert_allclose(weighted.pose, twice.pose, atol=1e-12)
    target[9] += 100.0
    without = align(source, target, np.array([1.0] * 9 + [0.0]))
    np.testing.assert_allclose(without.pose, align(source[:9], target[:9]).pose, atol=1e-12)
    assert without.inliers.tolist() == [True] * 9 + [False]


NEAR = np.array([0.02, -0.03, 0.05])  # how far off a start is


@pytest.mark.parametrize("wrong_share", [0.0, 0.3, 0.6])
def test_wrong_pairs_do_not_move_a_robust_alignment(wrong_share: float) -> None:
    random = np.random.default_rng(8)
    for _ in range(10):
        source = random.uniform(-2.0, 2.0, (300, 2))
        pose = np.array([*random.uniform(-0.5, 0.5, 2), random.uniform(-math.pi, math.pi)])
        target = moved(source, *pose) + random.normal(0.0, 0.005, source.shape)
        wrong = random.random(300) < wrong_share
        target[wrong] = random.uniform(-2.0, 2.0, (int(wrong.sum()), 2))
        found = align_robustly(source, target, 0.1, pose + NEAR)
        assert abs(float(wrap(found.heading - pose[2]))) < math.radians(0.1)
        assert np.hypot(*(found.pose - pose)[:2]) < 0.003
        assert np.mean(found.inliers[~wrong]) > 0.95
        assert np.mean(found.inliers[wrong]) < 0.02 if wrong.any() else True


def test_wrong_pairs_that_agree_among_themselves_are_outvoted() -> None:
    random = np.random.default_rng(9)
    source = random.uniform(-2.0, 2.0, (200, 2))
    target = moved(source, 0.1, 0.0, 0.5)
    target[:80] = moved(source[:80], -0.4, 0.3, -1.0)
    found = align_robustly(source, target, 0.05, np.array([0.1, 0.0, 0.5]) + NEAR)
    np.testing.assert_allclose(found.pose, (0.1, 0.0, 0.5), atol=1e-9)


def test_too_few_pairs_are_refused() -> None:
    points = np.array([[0.0, 0.0], [1.0, 0.0]])
    with pytest.raises(UserError, match="too few points"):
        align(points, points)


SOUND = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [2.0, 1.0]])


@pytest.mark.parametrize(
    ("source", "target", "weights", "words"),
    [
        (np.zeros((0, 2)), np.zeros((0, 2)), None, "there are no points to align"),
        (SOUND, SOUND[:3], None, r"partners are an array \(4, 2\), not \(3, 2\)"),
        (SOUND.T, SOUND.T, None, r"points are an array \(2, 2\), not \(2, 4\)"),
        (SOUND * [[1.0], [math.nan], [1.0], [1.0]], SOUND, None, "points are finite but row 1"),
        (SOUND, SOUND * [[1.0], [1.0], [1.0], [math.inf]], None, "partners are finite but row 3"),
        (SOUND, SOUND, np.array([1.0, 1.0, -1.0, 1.0]), "weights are finite, 0 or more, but row 2"),
        (SOUND, SOUND, np.array([math.nan, 1.0, 1.0, 1.0]), "weights are .* but row 0 is nan"),
        (SOUND, SOUND, np.ones(3), r"weights are an array \(4,\), not \(3,\)"),
    ],
)
def test_what_can_be_no_points_and_weights_is_refused_in_words(
    source: FloatArray, target: FloatArray, weights: FloatArray | None, words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        align(source, target, weights)
    with pytest.raises(ValueError, match=words):
        align_robustly(source, target, 0.1, np.zeros(3), weights)


@pytest.mark.parametrize("place", [(0.0, 0.0), (3.0, -7.0)])
def test_points_in_one_place_are_refused(place: tuple[float, float]) -> None:
    source = np.tile(place, (10, 1))
    with pytest.raises(UserError, match="do not determine a rotation"):
        align(source, np.random.default_rng(1).normal(0.0, 1.0, (10, 2)))
    with pytest.raises(UserError, match="do not determine a rotation"):
        align_robustly(source, source + 0.5, 1.0, np.zeros(3))


def test_points_on_one_line_tell_the_rotation() -> None:
    source = np.column_stack((np.linspace(-1.0, 1.0, 9), np.zeros(9)))
    np.testing.assert_allclose(
        align(source, moved(source, 1.0, 2.0, 2.5)).pose, (1.0, 2.0, 2.5), atol=1e-12
    )


def test_pairs_of_which_none_agree_are_refused() -> None:
    random = np.random.default_rng(12)
    source, target = random.uniform(-2.0, 2.0, (2, 40, 2))
    with pytest.raises(UserError, match="agree"):
        align_robustly(source, target, 0.0001, np.zeros(3))


@pytest.mark.parametrize("count", [3, 5, 12])
def test_the_covariance_is_the_scatter_over_draws_however_few_the_pairs(count: int) -> None:
    """With three pairs of six coordinates, three degrees of freedom are left: 2 n - 3."""
    random = np.random.default_rng([21, count])
    source = np.array([2.0, -1.0]) + random.normal(0.0, 1.0, (count, 2))
    fits = []
    for _ in range(1500):
        target = moved(source, 0.2, -0.1, 0.5) + random.normal(0.0, 0.01, (count, 2))
        fits.append(align(source, target))
    scatter = np.cov(np.array([fit.pose for fit in fits]).T)
    claimed = np.mean([fit.covariance for fit in fits], axis=0)
    np.testing.assert_allclose(np.diag(claimed), np.diag(scatter), rtol=0.15)
    sigmas = np.sqrt(np.diag(scatter))
    np.testing.assert_allclose(
        claimed / np.outer(sigmas, sigmas), scatter / np.outer(sigmas, sigmas), atol=0.15
    )
