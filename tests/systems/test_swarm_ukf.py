"""Miller's joint map: against finite differences, recorded robots, and over seeds."""

import numpy as np
import pytest

from host.calibration.robust.rigid_alignment import align
from host.geometry import Path, to_frame
from host.messages import Displacement, Positions
from host.recording.elsewhere.mrclam import load_dataset
from host.systems.swarm_ukf.infrared import fit_infrared, read_infrared
from host.systems.swarm_ukf.joint_map import JointMap, Reading, aligned_with_truth
from host.systems.swarm_ukf.mrclam_swarm import mrclam_score
from host.systems.swarm_ukf.scoring import laid
from host.systems.swarm_ukf.simulated import SimulatedSwarm, SwarmScenario, simulated_score
from host.systems.swarm_ukf.start import Start, TimedReading, carried, find_start
from host.systems.swarm_ukf.swarm import SwarmUkf


def a_map(random, count=4):
    poses = random.normal(0.0, 1.0, (count, 3))
    root = random.normal(0.0, 0.05, (3 * count, 3 * count))
    return JointMap(poses, root @ root.T, (0.02, 0.05))


def sighting(poses, observer, seen, sigma=0.02):
    (position,) = to_frame(poses[[seen], :2], poses[observer])
    return Reading(observer, seen, position, np.diag((sigma**2, sigma**2)))


def everything(poses, sigma=0.02):
    pairs = [(a, b) for a in range(len(poses)) for b in range(len(poses)) if a != b]
    return [TimedReading(0.0, sighting(poses, a, b, sigma)) for a, b in pairs]


def standing(count):
    return {robot: Path() for robot in range(count)}


@pytest.mark.parametrize("seed", range(5))
def test_a_reading_changes_what_the_information_form_says(seed):
    """With little nonlinearity the update is that of the linear Kalman filter, over all states."""
    random = np.random.default_rng(seed)
    joint = a_map(random)
    before, covariance = joint.poses, joint._covariance.copy()
    covariance *= 1e-4
    joint._covariance = covariance.copy()
    reading = sighting(before + random.normal(0.0, 1e-3, before.shape), 1, 3)
    slopes = np.zeros((2, len(covariance)))
    for k in range(len(covariance)):
        shifted = np.hstack((before, np.ones((4, 2)))).ravel()
        shifted[k] += 1e-6
        moved = shifted.reshape(-1, 5)[:, :3]
        slopes[:, k] = (sighting(moved, 1, 3).position - sighting(before, 1, 3).position) / 1e-6
    information = np.linalg.inv(covariance + 1e-14 * np.eye(len(covariance)))
    information += slopes.T @ np.linalg.inv(reading.covariance) @ slopes
    assert joint.update(reading)
    assert joint._covariance == pytest.approx(np.linalg.inv(information), abs=1e-9)


def test_motion_moves_the_robot_and_nobody_else():
    joint = JointMap(np.array([[0.0, 0.0, np.pi / 2], [1.0, 0.0, 0.0]]), 1e-8 * np.eye(6))
    joint.predict(0, Displacement(1.0, 1.0, 0.5, 0.1, 0.2, 1e-4, 1e-3))
    assert joint.poses == pytest.approx(
        np.array([[-0.1, 0.5, np.pi / 2 + 0.2], [1.0, 0.0, 0.0]]), abs=1e-6
    )


@pytest.mark.parametrize("seed", range(5))
def test_what_is_left_is_what_kabsch_leaves(seed):
    random = np.random.default_rng(seed)
    poses = random.normal(0.0, 1.0, (6, 3))
    error = 1e-5 * random.normal(size=(6, 3))
    left = laid(poses + error, poses) - poses
    assert aligned_with_truth(poses) @ error.ravel() == pytest.approx(left.ravel(), abs=1e-8)
    fit = align((poses + error)[:, :2], poses[:, :2])
    assert laid(poses + error, poses)[:, :2] == pytest.approx(fit.apply((poses + error)[:, :2]))


def test_it_is_laid_without_reflection():
    truth = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 2.0, 0.0]])
    mirrored = truth * (1.0, -1.0, 1.0)
    assert np.abs(laid(mirrored, truth)[:, :2] - truth[:, :2]).max() > 0.3


@pytest.mark.parametrize(("count", "seed"), [(2, 1), (5, 2), (20, 3)])
def test_from_nothing_it_finds_robots_that_see_each_other(count, seed):
    truth = np.random.default_rng(seed).uniform(-3.0, 3.0, (count, 3))
    found = find_start(everything(truth), standing(count), 0.0)
    assert isinstance(found, Start)
    assert laid(found.poses, truth)[:, :2] == pytest.approx(truth[:, :2], abs=1e-4)


def test_slopes_are_those_of_small_steps():
    poses = np.random.default_rng(5).normal(0.0, 1.0, (4, 3))
    sight = carried(everything(poses), standing(4), 0.0)
    flat, step = poses.ravel() + 0.1, 1e-6
    numeric = [
        (sight.residuals(flat + step * unit) - sight.residuals(flat - step * unit)) / (2 * step)
        for unit in np.eye(len(flat))
    ]
    assert sight.jacobian(flat) == pytest.approx(np.array(numeric).T, abs=1e-5)


def test_what_cannot_be_known_is_refused_in_words():
    truth = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.5], [0.0, 1.0, -1.0], [2.0, 2.0, 1.0]])
    readings = everything(truth)
    without = [r for r in readings if 3 not in (r.reading.observer, r.reading.seen)]
    assert find_start(without, standing(4), 0.0) == "no reading links robot 4 to the others"
    assert find_start([], standing(1), 0.0) == "one robot alone has nothing to be placed by"
    chain = [TimedReading(0.0, sighting(truth, a, a + 1)) for a in range(3)]
    assert "too few for 4 robots (eq. 3)" in find_start(chain, standing(4), 0.0)
    one_way = [r for r in readings if r.reading.observer != 3][:-1] + 3 * chain
    found = find_start(one_way, standing(4), 0.0)
    assert isinstance(found, str)
    assert "free to move or rotate" in found


@pytest.mark.parametrize(("robots", "seeds"), [(5, 4), (20, 1)])
def test_simulated_swarms_are_known_to_a_few_centimetres(robots, seeds):
    for seed in range(1, 1 + seeds):
        swarm = SimulatedSwarm(SwarmScenario(robots=robots, seconds=10.0, seed=seed))
        figures = simulated_score(swarm, "joint")
        assert figures["error_m"] < 0.02, seed
        assert 0.5 < figures["nees"] < 2.0, (seed, figures)
        assert figures["error_m"] < 0.8 * swarm.direct_score()["error_m"], seed


def test_ranges_that_are_all_too_long_cost_a_line_most():
    errors = {
        gain: simulated_score(
            SimulatedSwarm(SwarmScenario(formation="line", range_gain=gain, seconds=10.0)), "joint"
        )["error_m"]
        for gain in (1.0, 1.1)
    }
    assert errors[1.1] > 3.0 * errors[1.0]


@pytest.mark.slow
def test_five_recorded_robots(recorded):
    dataset = load_dataset(recorded("mrclam6"))
    joint, exact = (
        mrclam_score(dataset, kind, until_s=200.0).figures() for kind in ("joint", "exact")
    )
    assert joint["error_m"] < 0.11
    assert joint["heading_deg"] < 5.0
    assert 0.5 < joint["nees"] < 2.0
    assert joint["started_s"] < 40.0
    assert exact["error_m"] > 1.5 * joint["error_m"]
    assert exact["nees"] > 1.5 * joint["nees"]


def test_strength_of_a_return_gives_range(recorded):
    distances, strengths = read_infrared(recorded("ir_range") / "calib.csv")
    fit = fit_infrared(distances, strengths)
    assert fit.scale_m == pytest.approx(0.298, abs=0.01)
    assert fit.exponent == pytest.approx(-0.53, abs=0.02)
    assert fit.rms_m < 0.013
    assert 0.25 < fit.nearest_m < 0.32
    assert np.isnan(fit.ranges(np.array([1.2, 0.0]))).all()


def test_identities_that_nobody_has_are_left_out():
    swarm = SwarmUkf(2)
    both = Positions(
        0.5, np.ones((3, 2)), np.tile(np.eye(2), (3, 1, 1)), identities=np.array([-1, 7, 0])
    )
    swarm.take(0, both)
    swarm.run_until(1.0)
    assert swarm.map is None
    assert set(swarm.why) == {"no reading links robot 1 to the others"}
