"""The joint fit on linear sensors, beside the formula of the chain and plain least squares."""

import numpy as np
import pytest

from host.calibration.chain import by_base, carried
from host.calibration.joint.fit import solve
from host.calibration.joint.unknowns import Unknowns
from host.calibration.robust.evidence import Evidence, Prior
from host.calibration.wheels.model import BODY
from host.messages import FloatArray

UNKNOWNS = Unknowns(6, [2, 3])
SIZE = len(UNKNOWNS)
BODY_AT, MOUNTED = np.array([0.02, -0.01]), np.array([0.05, 0.03])


class Linear:
    """Readings (n,) with slopes (n, p), whose noise is `noise` times what they are weighed by."""

    def __init__(self, rows: FloatArray, readings: FloatArray, noise: float) -> None:
        self.rows, self.readings, self.noise = rows, readings, noise

    def evidence(self, values: FloatArray) -> Evidence:
        information = self.rows.T @ self.rows
        gradient = self.rows.T @ (self.rows @ values - self.readings)
        return Evidence(information, gradient, self.noise**2 * information, np.zeros((SIZE, 0)))


def mounted(
    random: np.random.Generator, part: slice, pose: list[int]
) -> tuple[FloatArray, FloatArray]:
    """Slopes (n, p) of a sensor that sees all relative to the body, and its own alone (n, k)."""
    own = random.standard_normal((200, part.stop - part.start))
    rows = np.zeros((200, SIZE))
    rows[:, part] = own
    rows[:, BODY] = -own[:, pose] @ by_base(MOUNTED, BODY_AT)
    return rows, own


@pytest.mark.parametrize("seed", range(3))
def test_with_turrets_held_it_has_the_covariance_of_the_chain_and_the_cross_terms(
    seed: int,
) -> None:
    random = np.random.default_rng(seed)
    wheel_rows = np.zeros((60, SIZE))
    wheel_rows[:, :6] = random.standard_normal((60, 6))
    (lidar_rows, lidar_own), (camera_rows, camera_own) = (
        mounted(random, UNKNOWNS.lidar, [0, 1, 2]),
        mounted(random, UNKNOWNS.cameras, [8, 9, 5]),
    )
    sensors = [
        Linear(rows, random.standard_normal(len(rows)), noise)
        for rows, noise in ((wheel_rows, 1.0), (lidar_rows, 2.0), (camera_rows, 1.5))
    ]
    free = np.full(SIZE, True)
    free[UNKNOWNS.turrets] = False
    found = solve(sensors, Prior(np.zeros(SIZE), np.zeros((SIZE, SIZE)), free), np.zeros(SIZE))
    body = np.linalg.inv(wheel_rows[:, :6].T @ wheel_rows[:, :6])[BODY, BODY]
    slopes = {}
    for part, own, noise, pose in (
        (UNKNOWNS.lidar, lidar_own, 2.0, [0, 1, 2]),
        (UNKNOWNS.cameras, camera_own, 1.5, [8, 9, 5]),
    ):
        moves = np.zeros((own.shape[1], 3))
        moves[pose] = by_base(MOUNTED, BODY_AT)
        chain = noise**2 * np.linalg.inv(own.T @ own) + carried(moves, body)
        assert found.covariance[part, part] == pytest.approx(chain, rel=1e-6, abs=1e-12)
        slopes[part.start] = moves
    cross = slopes[UNKNOWNS.lidar.start] @ body @ slopes[UNKNOWNS.cameras.start].T
    assert found.covariance[UNKNOWNS.lidar, UNKNOWNS.cameras] == pytest.approx(cross, abs=1e-9)
    assert not found.covariance[UNKNOWNS.turrets].any()


def test_its_minimum_is_that_of_plain_least_squares_and_its_sigmas_are_honest() -> None:
    random = np.random.default_rng(5)
    rows = [random.standard_normal((80, SIZE)) for _ in range(2)]
    held = np.full(SIZE, 0.5)
    prior = Prior(np.zeros(SIZE), np.diag(held**-2.0), np.full(SIZE, True))
    squares = []
    for _ in range(200):
        true = held * random.standard_normal(SIZE)
        sensors = [Linear(part, part @ true + random.standard_normal(80), 1.0) for part in rows]
        found = solve(sensors, prior, np.zeros(SIZE))
        design = np.concatenate((*rows, np.diag(1.0 / held)))
        target = np.concatenate((*(sensor.readings for sensor in sensors), np.zeros(SIZE)))
        assert found.values == pytest.approx(np.linalg.lstsq(design, target, rcond=None)[0])
        squares.append((found.values - true) ** 2 / np.diag(found.covariance))
    assert np.mean(squares) == pytest.approx(1.0, abs=0.08)


def test_an_error_that_all_readings_have_in_common_moves_the_fit_as_a_whole() -> None:
    random = np.random.default_rng(7)
    rows = random.standard_normal((80, SIZE))
    common = random.standard_normal(80)

    class Shifted(Linear):
        def evidence(self, values: FloatArray) -> Evidence:
            plain = super().evidence(values)
            return Evidence(
                plain.information, plain.gradient, plain.scatter, (rows.T @ common)[:, None]
            )

    prior = Prior(np.zeros(SIZE), np.zeros((SIZE, SIZE)), np.full(SIZE, True))
    plain, shifted = (
        solve([kind(rows, readings, 1.0)], prior, np.zeros(SIZE))
        for kind, readings in ((Linear, common), (Shifted, np.zeros(80)))
    )
    extra = shifted.covariance - plain.covariance
    assert extra == pytest.approx(np.outer(plain.values, plain.values), abs=1e-9)
