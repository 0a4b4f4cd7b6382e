"""The filter's steps against docs/filters.md, recomputed in scalars from public settings."""

import math

import numpy as np
import pytest

from host.config import Cameras, FilterSettings, Lidar
from host.estimator.gaussians.gaussian_mixture import PXX, WEIGHT, X, Y
from host.estimator.phd import PhdFilter
from host.estimator.things.kinds import OBSTACLE, TEAMMATE, rows_of
from host.messages import Bearings, Displacement, Positions

P_LIDAR, CLUTTER, BIRTH, OBSTACLES = 0.9, 0.02, 0.05, 0.4
Q, GROWTH, SURVIVAL_S = 0.1**2, 0.5, 20.0
VARIANCE = 0.01
SETTINGS = FilterSettings(
    motion_noise_m=math.sqrt(Q),
    motion_growth_per_s=GROWTH,
    survival_s=SURVIVAL_S,
    survival_range_m=50.0,
    birth_per_m2=BIRTH,
    obstacle_share=OBSTACLES,
    prune_weight=1e-6,
    gate=25.0,
)
LIDAR = Lidar(
    target_diameter_m=0.011,
    min_range_m=0.0,
    detection_probability=P_LIDAR,
    half_range_m=999.0,
    clutter_per_m2=CLUTTER,
    blind_sectors=(),
)
CAMERA = Cameras(use_ranges=False)


def readings(time, points, lags=None):
    points = np.array(points, dtype=float)
    return Positions(time, points, np.tile(VARIANCE * np.eye(2), (len(points), 1, 1)), lags=lags)


def never_ruled_out(teammate, obstacle):
    """Half a per cent of the whole goes over to either kind."""
    total = teammate + obstacle
    return 0.99 * teammate + 0.005 * total, 0.99 * obstacle + 0.005 * total


def born():
    """The weights of a thing after its first reading."""
    share = BIRTH / (CLUTTER + BIRTH)
    return never_ruled_out(share * (1.0 - OBSTACLES), share * OBSTACLES)


def normal(square, variance):
    """N of two dimensions at the squared distance, round covariance."""
    return math.exp(-0.5 * square / variance) / (2.0 * math.pi * variance)


@pytest.mark.parametrize("lag", [0.0, 0.4])
def test_a_lidar_update_is_the_equation(lag):
    phd = PhdFilter(SETTINGS, LIDAR, CAMERA)
    phd.predict(Displacement(1.0, 0.0, 0.0, 0.0, 0.0))
    phd.update(readings(1.0, [[1.0, 0.0]]))
    weights = rows_of(phd._state)[WEIGHT, :, 0]
    assert weights == pytest.approx(born(), rel=1e-9)

    phd.predict(Displacement(1.5, 0.5, 0.0, 0.0, 0.0))
    spread = Q * 0.5 * (1.0 + GROWTH * 0.25)  # unseen for 0.25 s in the middle of the interval
    predicted = rows_of(phd._state)[:, :, 0]
    assert predicted[PXX] == pytest.approx([VARIANCE + spread, VARIANCE], rel=1e-9)
    w_t, w_o = (w * math.exp(-0.5 / SURVIVAL_S) for w in born())
    assert predicted[WEIGHT] == pytest.approx([w_t, w_o], rel=1e-9)

    place = np.array([1.1, 0.05])
    phd.update(readings(1.5, [place], lags=np.array([lag]) if lag else None))
    square = 0.1**2 + 0.05**2
    q_o = normal(square, 2.0 * VARIANCE)
    q_t = 0.5 * q_o + 0.5 * normal(square, 2.0 * VARIANCE + spread + Q * lag)
    denominator = CLUTTER + BIRTH + P_LIDAR * (w_t * q_t + w_o * q_o)
    seen_t, seen_o = (P_LIDAR * w * q / denominator for w, q in ((w_t, q_t), (w_o, q_o)))
    missed = (1.0 - P_LIDAR) * (1.0 - seen_t - seen_o)
    new = BIRTH / denominator
    parts = {
        TEAMMATE: (seen_t, w_t * missed, new * (1.0 - OBSTACLES), VARIANCE + spread),
        OBSTACLE: (seen_o, w_o * missed, new * OBSTACLES, VARIANCE),
    }
    sums = [sum(parts[kind][:3]) for kind in (TEAMMATE, OBSTACLE)]
    assert sum(sums) < 1.0
    rows = rows_of(phd._state)
    assert rows.shape[2] == 1
    assert rows[WEIGHT, :, 0] == pytest.approx(never_ruled_out(*sums), rel=1e-6)
    for kind, (seen, left, birth, prior) in parts.items():
        noise = VARIANCE + (Q * lag if kind == TEAMMATE else 0.0)
        gain = prior / (prior + noise)
        x = (seen * (1.0 + 0.1 * gain) + left * 1.0 + birth * 1.1) / (seen + left + birth)
        y = (seen * 0.05 * gain + birth * 0.05) / (seen + left + birth)
        assert rows[[X, Y], kind, 0] == pytest.approx([x, y], rel=1e-6)


@pytest.mark.parametrize(("blobs", "lag"), [((0.06,), 0.0), ((0.06,), 2.0), ((0.06, -2.0), 0.0)])
def test_a_camera_update_is_the_equation(blobs, lag):
    """Two things in almost one direction; of the blobs, the second is nobody's."""
    things = np.array([[1.5, 0.0], [1.6, 0.35]])
    phd = PhdFilter(SETTINGS, LIDAR, CAMERA)
    phd.predict(Displacement(1.0, 0.0, 0.0, 0.0, 0.0))
    phd.update(readings(1.0, things))
    w_t, w_o = born()
    half, variance = 1.7, 0.05**2
    view = (0.0, half) if len(blobs) == 1 else (0.0, math.pi)
    phd.update(Bearings(1.0, np.array(blobs), np.full(len(blobs), variance), lag=lag, view=view))
    distance = np.hypot(*things.T)
    bend = CAMERA.range_steepness_per_m * (distance - CAMERA.half_range_m)
    detected = CAMERA.detection_probability / (1.0 + np.exp(bend))
    s = variance + (VARIANCE + Q * lag) / distance**2
    off = blobs[0] - np.arctan2(things[:, 1], things[:, 0])
    likelihood = np.exp(-0.5 * off**2 / s) / np.sqrt(2.0 * math.pi * s)
    unknown = max(0.0, len(blobs) - detected.sum() * w_t) / (2.0 * view[1])
    for k, (one, other) in enumerate(((0, 1), (1, 0))):
        others = detected[other] * w_t * likelihood[other] + CAMERA.clutter_per_rad + unknown
        ratio = 1.0 - detected[one] + detected[one] * likelihood[one] / others
        teammate = w_t * ratio**0.3
        scale = (w_t + w_o) / (teammate + w_o)  # how surely it is there stays
        found = rows_of(phd._state)[WEIGHT, :, np.argsort(rows_of(phd._state)[X, 0])[k]]
        assert found == pytest.approx(never_ruled_out(scale * teammate, scale * w_o), rel=1e-6)
