"""Lee's particle filter beside trilateration and a Kalman filter on the same distances."""

import numpy as np
import pytest
from click.testing import CliRunner

from host.cli.main import main
from host.systems.particles.particle_filter import ParticleFilter, ParticleSettings
from host.systems.particles.simulated import IntruderScenario, tracked
from host.systems.particles.start import bounding_box, trilaterate

PLACES = np.array([[1.0, 0.0], [0.0, 1.2], [-1.0, -0.3], [0.2, -1.0]])


def distances(point, places=PLACES):
    return np.hypot(*(places - point).T)


@pytest.mark.parametrize("seed", range(20))
def test_exact_distances_give_the_place(seed):
    point = np.random.default_rng(seed).uniform(-0.8, 0.8, 2)
    assert trilaterate(PLACES, distances(point)) == pytest.approx(point, abs=1e-5)
    low, high = bounding_box(PLACES, distances(point))
    assert np.all(low <= point + 1e-9)
    assert np.all(point <= high + 1e-9)


def test_two_places_or_a_line_of_them_leave_a_mirror_image():
    line = np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]])
    assert trilaterate(line, distances(np.ones(2), line)) is None
    assert trilaterate(PLACES[:2], distances(np.ones(2), PLACES[:2])) is None


def test_the_mean_is_that_of_the_posterior():
    """One step from a known spread, against a sum over a grid."""
    sigma = 0.2
    measured = distances(np.array([0.3, 0.2])) + np.array([0.1, -0.05, 0.1, 0.0])
    filter_ = ParticleFilter(ParticleSettings(count=100_000, outlier=0.0), seed=4)
    found = filter_.step(0.1, PLACES, measured, sigma)
    low, high = bounding_box(PLACES, measured)
    axes = [np.linspace(a - 0.5, b + 0.5, 400) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    errors = (np.hypot(*(grid[:, None] - PLACES).transpose(2, 0, 1)) - measured) / sigma
    weights = np.exp(-np.sum(errors**2, axis=1) / 2.0)
    assert found == pytest.approx(weights @ grid / weights.sum(), abs=0.005)


def test_half_the_error_of_trilateration_and_a_tenth_with_outliers():
    for outlier, most in ((0.0, 0.6), (0.1, 0.15)):
        ratios = [
            tracked(IntruderScenario(seed=seed, seconds=15.0, outlier=outlier))["particles"][
                "ratio"
            ]
            for seed in range(4)
        ]
        assert np.mean(ratios) < most, ratios


def test_evaluate_has_one_table_and_the_reason_where_there_is_nothing(tmp_path):
    done = CliRunner().invoke(
        main, ["evaluate", "intruder:seconds=5", "--json", str(tmp_path / "f")]
    )
    assert done.exit_code == 0, done.output
    assert "particles         trilateration" in done.output
    words = " ".join(done.output.split())
    assert "it needs odometry and sightings with identities" in words
    wrong = CliRunner().invoke(main, ["evaluate", "intruder:colour=red"])
    assert wrong.exit_code != 0
