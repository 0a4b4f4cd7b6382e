"""Tables of a recording hold what is in it, with every digit."""

import csv
import json

import numpy as np
import pytest

from host.errors import UserError
from host.messages import (
    Bearings,
    Displacement,
    Estimate,
    Health,
    Names,
    Scan,
    TeammateOdometry,
)
from host.recording.tables import Tables


def read(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_each_number_comes_back(tmp_path):
    third = 1.0 / 3.0
    covariance = np.array([[[1e-4, 2e-5], [2e-5, third]]])
    messages = [
        Scan(1.0, np.array([0.9, 1.0]), np.array([-third, 3.0]), np.array([0.0, 2.00025])),
        Displacement(1.5, 0.02, third, 0.0, -third, 1e-5, 1e-6, (3, -4)),
        Displacement(1.6, 0.02, third, 0.0, -third),
        Bearings(2.0, np.array([third]), np.array([1e-4]), (0.1, 0.2), camera="rear"),
        Estimate(
            2.0,
            np.array([[third, -1.0]]),
            covariance,
            np.array([0.75]),
            np.array([0.125]),
            np.array([7]),
        ),
        TeammateOdometry(2.5, 4, 0.1, third, 0.0, -third, 1e-5, 1e-6, restarted=True),
        Names(2.5, np.array([7]), np.array([4]), np.array([0.75]), np.array([-third])),
        Health(3.0, "lidar", False, 'gone, "really"\nü', {"frames": 3}),
    ]
    with Tables(tmp_path / "a") as tables:
        for message in messages:
            tables.write(message)
    names = {path.stem for path in (tmp_path / "a").iterdir()}
    assert names == {
        *("scan", "displacement", "bearings", "estimate", "health"),
        *("teammate_odometry", "names"),
    }
    scan = read(tmp_path / "a/scan.csv")
    assert [float(row["angle_rad"]) for row in scan] == [-third, 3.0]
    assert [float(row["range_m"]) for row in scan] == [0.0, 2.00025]
    steps = read(tmp_path / "a/displacement.csv")
    assert [row["left_ticks"] for row in steps] == ["3", ""]
    assert float(steps[0]["dpsi_rad"]) == -third
    (bearing,) = read(tmp_path / "a/bearings.csv")
    assert (bearing["camera"], float(bearing["bearing_rad"])) == ("rear", third)
    assert (bearing["range_m"], bearing["origin_y_m"]) == ("", "0.2")
    (estimate,) = read(tmp_path / "a/estimate.csv")
    assert (estimate["label"], float(estimate["x_m"])) == ("7", third)
    assert [float(estimate[key]) for key in ("xx_m2", "xy_m2", "yy_m2")] == [1e-4, 2e-5, third]
    (heard,) = read(tmp_path / "a/teammate_odometry.csv")
    assert (heard["identity"], heard["restarted"], float(heard["dx_m"])) == ("4", "True", third)
    (named,) = read(tmp_path / "a/names.csv")
    assert (named["label"], named["identity"], named["probability"]) == ("7", "4", "0.75")
    assert float(named["heading_rad"]) == -third
    (health,) = read(tmp_path / "a/health.csv")
    assert health["reason"] == messages[-1].reason
    assert json.loads(health["counts"]) == {"frames": 3}
    with pytest.raises(UserError, match="exists already"):
        Tables(tmp_path / "a")
