"""What one fit leaves uncertain, in the next."""

import math

import numpy as np
import pytest

from host.calibration import chain
from host.calibration.chain import BODY, Chain, by_base
from host.calibration.result import Calibration, Fitted
from host.config import Mocap, RobotConfig
from host.errors import UserError
from host.geometry import to_frame, to_parent

COVARIANCE = np.diag([1e-3, 2e-3, 4e-3]) ** 2


def fit(**values):
    rows = tuple(
        Fitted(key=f"mocap.{key}", name=key, value=value, sigma=1.0, limit=1.0)
        for key, value in values.items()
    )
    return Calibration(
        kind="wheels", fitted=rows, checks=(), residuals="", joint=(BODY, COVARIANCE)
    )


WHEELS = fit(x_m=0.02, y_m=-0.01, heading_rad=0.1)
CONFIG = RobotConfig(mocap=Mocap(x_m=0.02, y_m=-0.01, heading_rad=0.1))


def test_what_is_fixed_to_a_base_moves_with_it():
    base, mounted = np.array([0.02, -0.01, 0.1]), np.array([0.05, 0.03, 0.4])
    place = to_frame(mounted[None, :2], base)
    found = by_base(mounted[:2], base[:2])
    for k in range(3):
        moved = base.copy()
        moved[k] += 1e-6
        now = np.append(to_parent(place, moved)[0], mounted[2] + moved[2] - base[2])
        assert (now - mounted) / 1e-6 == pytest.approx(found[:, k], abs=1e-5)


def test_covariances_stand_beside_the_file_and_hold_for_their_values_only(tmp_path):
    robot = tmp_path / "robot.toml"
    known = Chain()
    known.take(WHEELS)
    chain.save(robot, known)
    read = chain.load(robot)
    assert read.covariance(CONFIG, BODY) == pytest.approx(COVARIANCE)
    assert read.covariance(CONFIG, BODY[2:]) == pytest.approx(COVARIANCE[2:, 2:])
    by_hand = RobotConfig(mocap=CONFIG.mocap.model_copy(update={"heading_rad": 0.11}))
    assert not read.covariance(by_hand, BODY).any()
    assert not read.covariance(CONFIG, ("lidar.x_m",)).any()
    assert not chain.load(tmp_path / "other.toml").entries
    assert not chain.load(None).entries


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        '{"schema": "swarmloc.covariance", "version": 2, "fits": {}}',
        '{"schema": "swarmloc.covariance", "version": 1, "fits": {"wheels": {"keys": ["a"]}}}',
    ],
)
def test_a_damaged_file_is_refused_in_words(tmp_path, text):
    robot = tmp_path / "robot.toml"
    chain.file_of(robot).write_text(text)
    with pytest.raises(UserError, match="does not hold what a calibration wrote"):
        chain.load(robot)


def test_a_fit_that_is_not_finite_is_not_kept():
    vague = Calibration(
        kind="wheels",
        fitted=WHEELS.fitted,
        checks=(),
        residuals="",
        joint=(BODY, np.full((3, 3), math.inf)),
    )
    known = Chain()
    known.take(vague)
    assert not known.entries


def test_a_joint_fit_takes_the_place_of_the_fits_of_its_values():
    known = Chain()
    known.take(WHEELS)
    lidar = Fitted(key="lidar.x_m", name="x", value=0.01, sigma=1.0, limit=1.0)
    both = Calibration(
        kind="joint",
        fitted=(*WHEELS.fitted, lidar),
        checks=(),
        residuals="",
        joint=((*BODY, "lidar.x_m"), np.full((4, 4), 1e-6) + 1e-6 * np.eye(4)),
    )
    known.take(both)
    assert list(known.entries) == ["joint"]
    moved = CONFIG.model_copy(update={"lidar": CONFIG.lidar.model_copy(update={"x_m": 0.01})})
    assert known.covariance(moved, (BODY[0], "lidar.x_m"))[0, 1] == pytest.approx(1e-6)
    known.take(WHEELS)
    assert set(known.entries) == {"joint", "wheels"}
