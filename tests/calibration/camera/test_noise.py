"""Errors of strips: each one's own, and the rotation that all of one instant have in common."""

import dataclasses
import math

import numpy as np
import pytest

from host.calibration.camera.model import NAMES, Pairs, draw, errors
from host.calibration.camera.noise import Noise, Whitening, likely, measured
from host.calibration.camera.pairs import Strips
from host.calibration.camera.uncertainty import common_errors
from host.geometry import to_parent
from host.messages import FloatArray

CAMERA = np.array([610.0, 960.0, 540.0, 0.0, 0.0, 0.0, 0.7, 0.0, 0.03, 0.0, 0.25])
REAR = np.where(np.array(NAMES) == "heading_rad", math.pi, CAMERA)
VALUES = np.array([*CAMERA, *REAR, 0.0])
NONE_FREE = np.zeros(len(VALUES), dtype=bool)


def drawn(points: FloatArray, cameras: FloatArray) -> FloatArray:
    front, rear = (draw(camera, points)[0] for camera in (CAMERA, REAR))
    return np.where((cameras == 0)[:, None], front, rear)


def seen(
    instants: int, each: int, strip: float, rotation_rad: float, seed: int = 0
) -> tuple[Pairs, FloatArray]:
    """Pairs, `each` at an instant, with such noise; and where they would be without (n, 2)."""
    random = np.random.default_rng(seed)
    count = instants * each
    times = np.repeat(0.2 * np.arange(instants), each)
    around, away = random.uniform(-math.pi, math.pi, count), random.uniform(0.5, 2.0, count)
    points = np.column_stack((away * np.cos(around), away * np.sin(around), np.full(count, 0.2)))
    cameras = (np.abs(around) > 0.5 * math.pi).astype(int)
    sigmas = np.hypot(1.0, 1.8 / away)
    turned = points.copy()
    angles = np.repeat(rotation_rad * random.standard_normal(instants), each)
    for k, angle in enumerate(angles):
        turned[k, :2] = to_parent(points[k : k + 1, :2], np.array([0.0, 0.0, angle]))[0]
    noise = strip * sigmas[:, None] * random.standard_normal((count, 2))
    strips = Strips(times, cameras, drawn(turned, cameras) + noise)
    every = np.full(count, True)
    pairs = Pairs(
        strips, points, np.zeros((count, 3)), sigmas, every, cameras, 0.3 * times, delay=0.0
    )
    return pairs, drawn(points, cameras)


def test_whitened_errors_have_the_identity_for_covariance() -> None:
    """Against the covariance matrix, made of rotations of the points by their definition."""
    pairs, middle = seen(3, 4, 0.0, 0.0)
    noise, used = Noise(0.2, 0.002), np.full(12, True)
    used[5] = False
    points = pairs.points.copy()
    points[:, :2] = to_parent(points[:, :2], np.array([0.0, 0.0, 1e-4]))
    moved = ((drawn(points, pairs.strips.cameras) - middle) / 1e-4)[used]
    same = pairs.strips.times[used][:, None] == pairs.strips.times[used]
    covariance = noise.rotation_rad**2 * np.outer(moved, moved) * np.kron(same, np.ones((2, 2)))
    covariance += np.diag(np.repeat((noise.strip * pairs.sigmas[used]) ** 2, 2))
    root = Whitening(VALUES, pairs, used, noise)(np.eye(22).reshape(11, 2, 22)).reshape(22, 22)
    assert root @ covariance @ root.T == pytest.approx(np.eye(22), abs=0.01)
    # A vector is a row of derivatives.
    off = errors(VALUES, pairs)[used]
    assert Whitening(VALUES, pairs, used, noise)(off).ravel() == pytest.approx(root @ off.ravel())


@pytest.mark.parametrize("rotation_rad", [0.0, 0.0017])
def test_both_kinds_of_noise_are_measured(rotation_rad: float) -> None:
    pairs, _ = seen(300, 3, 0.2, rotation_rad, seed=4)
    noise, used = Noise(1.0), np.full(900, True)
    for _ in range(4):
        noise = measured(VALUES, pairs, used, NONE_FREE, noise)
    assert noise.strip == pytest.approx(0.2, rel=0.1)
    assert noise.rotation_rad == pytest.approx(rotation_rad, rel=0.15, abs=3e-4)


def test_strips_that_were_alone_show_no_common_rotation() -> None:
    pairs, _ = seen(300, 1, 0.2, 0.0017)
    assert measured(VALUES, pairs, np.full(300, True), NONE_FREE, Noise(0.5)).rotation_rad == 0.0


def test_a_strip_hidden_in_part_is_left_out_though_all_may_rotate_by_more() -> None:
    pairs, _ = seen(100, 3, 0.1, 0.002, seed=2)
    pixels = pairs.strips.pixels.copy()
    hidden = np.arange(0, 300, 30)
    pixels[hidden, 0] += 12.0 * 0.1 * pairs.sigmas[hidden]
    pairs = dataclasses.replace(pairs, strips=dataclasses.replace(pairs.strips, pixels=pixels))
    noise = Noise(0.1, 0.002)
    assert (np.hypot(*errors(VALUES, pairs)[hidden].T) < 3.0 * 0.002 * 610.0).sum() > 5
    used = likely(VALUES, pairs, noise)
    assert not used[hidden].any()
    assert np.mean(used) > 0.9


def test_light_moves_strips_aside_by_where_in_the_room_they_are_seen() -> None:
    pairs, middle = seen(1, 40, 0.0, 0.0)
    pairs = dataclasses.replace(pairs, headings=np.full(40, 0.4))
    low, *waves = common_errors(VALUES, pairs).transpose(2, 0, 1)
    around = np.arctan2(pairs.points[:, 1], pairs.points[:, 0]) + 0.4
    higher = drawn(pairs.points + np.array([0.0, 0.0, 1e-3]), pairs.strips.cameras) - middle
    assert np.sum(low * higher, axis=1) == pytest.approx(0.1 * np.hypot(*higher.T), rel=0.01)
    for wave, share in zip(waves, (np.cos(around), np.sin(around)), strict=False):
        assert np.hypot(*wave.T) == pytest.approx(0.08 * np.abs(share))
    total = sum(np.sum(wave**2, axis=1) for wave in waves)
    assert total == pytest.approx(2.0 * 0.08**2)
