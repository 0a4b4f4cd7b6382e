"""Lidar and cameras together, and the teammates' turrets that both see."""

import copy
from functools import cache

import numpy as np
import pytest

from host.calibration.chain import BODY, LIDAR, Chain, Entry
from host.calibration.gathered import Gathered
from host.calibration.joint.calibrate import calibrate
from host.calibration.result import Calibration
from host.config import Camera, Cameras, RobotConfig
from host.config.mocap import Mocap, Turret
from host.errors import UserError
from host.geometry import to_parent
from host.messages import Bodies, FloatArray
from tests.calibration.camera.camera_drive import FRONT, REAR, Drive, Ground, gather

PIVOTS = np.array([[0.009, -0.004], [-0.006, 0.008]])  # of bodies 2 and 3, on their robots


def near(ground: Ground) -> Camera:
    """A camera nearly as it truly is: what its own fit may have left."""
    heading, tilt, roll = np.radians(ground.mount_deg) + 0.003
    x, y, z = np.array(ground.place) + 0.002
    return Camera(
        lens="equidistant",
        focal_px=ground.focal,
        centre_x_px=ground.centre[0],
        centre_y_px=ground.centre[1],
        k1=ground.terms[0],
        k2=ground.terms[1],
        heading_rad=float(heading),
        tilt_rad=float(tilt),
        roll_rad=float(roll),
        x_m=float(x),
        y_m=float(y),
        z_m=float(z),
    )


CAMERAS = Cameras(delay_s=0.15, front=near(FRONT), rear=near(REAR))


@cache
def drive(seed: int) -> Gathered:
    """A drive whose motion capture has teammates' bodies at PIVOTS on their robots."""
    moved = gather(
        Drive(seconds=30.0), pairs=250, wrong=0.1, seed=seed, lidar_noise_m=0.004, camera=CAMERAS
    )
    moved.bodies = [
        Bodies(
            frame.time,
            frame.identities,
            np.column_stack(
                (
                    np.concatenate((frame.poses[:1, :2], to_parent(PIVOTS, frame.poses[1:]))),
                    frame.poses[:, 2],
                )
            ),
        )
        for frame in moved.bodies
    ]
    return moved


@cache
def fit(seed: int) -> Calibration:
    return calibrate(drive(seed), ["lidar", "camera"])


def turrets_of(found: Calibration) -> tuple[FloatArray, FloatArray]:
    rows = [row for row in found.fitted if row.name.startswith("turret of body")]
    return np.array([row.value for row in rows]), np.array([row.sigma for row in rows])


def test_pivots_beside_their_turrets_are_found_as_well_as_it_says() -> None:
    squares = []
    for seed in range(2):
        found = fit(seed)
        places, sigmas = turrets_of(found)
        assert (sigmas < 0.001).all(), seed
        squares.append(((places + PIVOTS.ravel()) / sigmas) ** 2)
        lidar = {row.key: row for row in found.fitted}
        for key in ("lidar.x_m", "lidar.y_m", "lidar.heading_rad", "lidar.delay_s"):
            assert abs(lidar[key].value) < 3.5 * lidar[key].sigma, (seed, key)
        assert not found.failures
        written = found.new_settings()["mocap.turrets"]
        assert [turret["body"] for turret in written] == [2, 3]
    assert np.max(squares) < 3.5**2
    assert np.mean(squares) < 2.5  # 8 of them, some alike: 1 ± 0.5


def test_teammates_are_where_the_configuration_has_their_turrets() -> None:
    gathered = drive(0)
    turrets = tuple(Turret(body=k + 2, x_m=-x, y_m=-y) for k, (x, y) in enumerate(PIVOTS.tolist()))
    mocap = Mocap(turrets=turrets)
    known = Gathered(gathered.config.model_copy(update={"mocap": mocap}))
    known.bodies = gathered.bodies
    times = np.array([3.0, 7.0])
    true = Drive(seconds=40.0).relative(times)
    tracks = known.tracks()
    for k, body in enumerate((2, 3)):
        assert tracks.relative(body, times) == pytest.approx(true[:, k], abs=1e-4)
        own = tracks.mounted(np.zeros(3), {}).relative(body, times)
        assert np.hypot(*(own - true[:, k]).T) == pytest.approx(np.hypot(*PIVOTS[k]), rel=0.05)


def test_all_delays_have_the_truth_s_own_uncertainty_in_common() -> None:
    gathered, plain = copy.copy(drive(0)), fit(0)
    gathered.truth_time_sigma = 0.004
    late = calibrate(gathered, ["lidar", "camera"])
    assert plain.joint is not None
    assert late.joint is not None
    keys = plain.joint[0]
    delays = np.array([key.endswith("delay_s") for key in keys])
    assert np.count_nonzero(delays) == 2
    added = late.joint[1] - plain.joint[1]
    assert added == pytest.approx(0.004**2 * np.outer(delays, delays), abs=1e-7)


def test_without_wheels_the_body_is_as_uncertain_as_the_wheels_fit_has_left_it() -> None:
    gathered, plain = copy.copy(drive(0)), calibrate(drive(0), ["lidar"])
    left = np.diag([2e-3, 1e-3, 1e-3]) ** 2
    gathered.chain = Chain({"wheels": Entry(BODY, np.zeros(3), left)})
    found = calibrate(gathered, ["lidar"])
    assert plain.joint is not None
    assert found.joint is not None
    assert found.joint[0] == plain.joint[0] == (*LIDAR, "lidar.delay_s")
    added = (found.joint[1] - plain.joint[1])[:3, :3]
    # The lidar is at the body's origin here, so that it is moved as the body is.
    assert added == pytest.approx(left, rel=0.03, abs=3e-8)
    kept = Chain()
    kept.take(found)
    assert list(kept.entries) == ["joint"]


def test_turrets_of_bodies_that_this_drive_lacks_stay_as_they_are_configured() -> None:
    gathered = copy.copy(drive(0))
    old = (Turret(body=2, x_m=0.02, y_m=0.02), Turret(body=9, x_m=0.001, y_m=0.002))
    gathered.config = gathered.config.model_copy(update={"mocap": Mocap(turrets=old)})
    first, *others = calibrate(gathered, ["lidar"]).settings["mocap.turrets"]
    assert (first["body"], first["x_m"]) == (2, pytest.approx(-PIVOTS[0, 0], abs=0.003))
    assert [turret["body"] for turret in others] == [9, 3]
    assert others[0]["x_m"] == 0.001


def test_without_a_teammate_there_is_nothing_that_sensors_share() -> None:
    gathered = Gathered(RobotConfig())
    gathered.bodies = [Bodies(t, np.array([1]), np.zeros((1, 3))) for t in (0.0, 1.0)]
    with pytest.raises(UserError, match="motion capture saw no teammate"):
        calibrate(gathered, ["lidar"])
