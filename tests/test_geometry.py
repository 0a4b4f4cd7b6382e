"""Planar motions against complex numbers and 3x3 matrices; a path against its own steps."""

import cmath
import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from host.geometry import SECTORS, Path, polar, rotation, sector, to_frame, to_parent, wrap
from host.message_checks import fault
from host.messages import Displacement

angles = st.floats(-1000.0, 1000.0)
lengths = st.floats(-100.0, 100.0)
poses = st.tuples(lengths, lengths, angles)
steps = st.lists(
    st.tuples(st.floats(0.01, 1.0), lengths, lengths, st.floats(-3.0, 3.0)), min_size=1, max_size=12
)


def matrix(pose):
    """The homogeneous matrix that brings points of the frame at `pose` into its parent."""
    x, y, psi = pose
    return np.array(
        [[math.cos(psi), -math.sin(psi), x], [math.sin(psi), math.cos(psi), y], [0, 0, 1]]
    )


def path_of(moves, keep_seconds=5.0):
    """A path of (interval, dx, dy, dpsi), its times, and its poses by products of matrices."""
    path, time, pose = Path(keep_seconds), 10.0, np.eye(3)
    times, matrices = [time], [pose]
    for interval, dx, dy, dpsi in moves:
        time += interval
        path.append(Displacement(time, interval, dx, dy, dpsi, 0.01 * interval, 0.02 * interval))
        pose = pose @ matrix((dx, dy, dpsi))
        times.append(time)
        matrices.append(pose)
    return path, np.array(times), matrices


@given(angles)
def test_a_wrapped_angle_points_the_same_way_and_is_within_half_a_turn(angle):
    wrapped = float(wrap(angle))
    assert -math.pi <= wrapped <= math.pi
    assert abs(cmath.exp(1j * wrapped) - cmath.exp(1j * angle)) < 1e-11


def test_wrapping_keeps_the_shape_and_puts_half_a_turn_at_its_negative_end():
    assert wrap(np.zeros((2, 3))).shape == (2, 3)
    assert_allclose(wrap(np.array([math.pi, -math.pi, 3 * math.pi])), -math.pi)


@given(st.floats(-math.pi, math.pi))
def test_a_bearing_lies_in_its_sector(bearing):
    (index,) = sector(np.array([bearing]))
    assert 0 <= index < SECTORS
    width = 2.0 * math.pi / SECTORS
    assert index * width - 1e-9 <= bearing + math.pi <= (index + 1) * width + 1e-9


@given(angles, lengths, lengths)
def test_rotation_is_a_product_of_complex_numbers(angle, x, y):
    turned = cmath.rect(1.0, angle) * complex(x, y)
    assert_allclose(rotation(angle) @ (x, y), (turned.real, turned.imag), atol=1e-9)


@given(st.lists(st.tuples(lengths, lengths), max_size=5), poses)
def test_frames_change_as_by_homogeneous_matrices(points, pose):
    local = np.array(points).reshape(-1, 2)
    expected = (matrix(pose) @ np.column_stack((local, np.ones(len(local)))).T).T[:, :2]
    parent = to_parent(local, np.array(pose))
    assert_allclose(parent, expected, atol=1e-9)
    assert_allclose(to_frame(parent, np.array(pose)), local, atol=1e-9)


@given(st.lists(st.tuples(lengths, lengths, poses), min_size=1, max_size=5))
def test_every_point_may_have_its_own_frame(rows):
    points = np.array([(x, y) for x, y, _ in rows])
    frames = np.array([pose for _, _, pose in rows])
    for there in (to_parent, to_frame):
        one_by_one = [there(points[k : k + 1], frames[k])[0] for k in range(len(rows))]
        assert_allclose(there(points, frames), one_by_one, atol=1e-9)


@given(steps)
def test_poses_are_the_product_of_the_steps(moves):
    path, times, matrices = path_of(moves)
    assert path.end == times[-1]
    for (x, y, psi), expected in zip(path.poses(times), matrices, strict=True):
        assert_allclose(matrix((x, y, psi)), expected, atol=1e-8)


@given(steps, st.data())
def test_the_motion_between_two_times_is_the_product_of_the_steps_between(moves, data):
    path, times, matrices = path_of(moves)
    first = data.draw(st.integers(0, len(moves)))
    last = data.draw(st.integers(first, len(moves)))
    motion = path.between(times[first], times[last])
    expected = np.linalg.inv(matrices[first]) @ matrices[last]
    assert_allclose(matrix((motion.dx, motion.dy, motion.dpsi)), expected, atol=1e-7)
    seconds = times[last] - times[first]
    assert (motion.time, motion.interval) == (times[last], pytest.approx(seconds))
    assert motion.translation_variance == pytest.approx(0.01 * seconds)
    assert motion.heading_variance == pytest.approx(0.02 * seconds)


@given(steps, st.tuples(lengths, lengths))
def test_a_thing_that_stands_still_is_carried_to_where_it_is_seen_later(moves, thing):
    path, times, matrices = path_of(moves)
    seen = np.array([(np.linalg.inv(pose) @ (*thing, 1.0))[:2] for pose in matrices])
    assert_allclose(path.carry(seen, times, times[-1]), [seen[-1]] * len(seen), atol=1e-7)


def test_between_two_displacements_the_pose_is_in_between():
    path, times, _ = path_of([(1.0, 2.0, 0.0, 0.0), (1.0, 0.0, 4.0, 1.0)])
    assert_allclose(path.poses(times[0] + np.array([0.25, 1.5])), [(0.5, 0, 0), (2.0, 2.0, 0.5)])


def test_the_heading_does_not_jump_where_it_passes_half_a_turn():
    path, times, _ = path_of([(1.0, 0.0, 0.0, 3.0), (1.0, 0.0, 0.0, 1.0)])
    assert_allclose(path.poses(times[:1] + 1.5)[:, 2], 3.5)


def test_the_robot_stands_still_where_its_odometry_says_nothing():
    path, times, _ = path_of([(1.0, 1.0, 0.0, 0.5)])
    assert_allclose(path.poses(np.array([0.0, 99.0])), path.poses(times))
    assert path.between(times[1], 99.0).dx == 0.0
    empty = Path()
    points = np.array([[1.0, 2.0]])
    assert empty.end == -math.inf
    assert_allclose(empty.carry(points, np.zeros(1), 9.0), points)
    assert empty.between(1.0, 2.0) == Displacement(2.0, 1.0, 0.0, 0.0, 0.0)


def test_a_displacement_that_ends_no_later_than_the_last_is_ignored():
    path, times, _ = path_of([(1.0, 1.0, 0.0, 0.5)])
    before = path.poses(times)
    path.append(Displacement(times[1], 1.0, 5.0, 5.0, 5.0))
    path.append(Displacement(times[1] - 0.5, 1.0, 5.0, 5.0, 5.0))
    assert path.end == times[1]
    assert_allclose(path.poses(times), before)


@pytest.mark.parametrize("rate_hz", [50.0, 500.0])
def test_a_long_path_keeps_its_last_seconds_exactly_and_little_else(rate_hz):
    random = np.random.default_rng(7)
    count = int(60.0 * rate_hz)
    moves = [(1.0 / rate_hz, *row) for row in random.normal(0.0, 0.01, (count, 3))]
    kept, times, matrices = path_of(moves, keep_seconds=2.0)
    recent = len(times) - int(2.0 * rate_hz) - 1
    motion = kept.between(times[recent], times[-1])
    expected = np.linalg.inv(matrices[recent]) @ matrices[-1]
    assert_allclose(matrix((motion.dx, motion.dy, motion.dpsi)), expected, atol=1e-9)
    # What it has forgotten it takes for standing still: the oldest pose it knows is a recent one.
    oldest = np.flatnonzero((np.diff(kept.poses(times), axis=0) != 0.0).any(axis=1))[0]
    assert times[-1] - times[oldest] < 2.0 * (2.0 + 256 / rate_hz)


def test_the_sum_of_sound_displacements_is_a_sound_one():
    """Or a filter would refuse what the localizer makes of them, and the run would end."""
    path = Path()
    for k in range(1, 4):
        path.append(Displacement(0.1 * k, 0.1, 900.0, -900.0, 900.0))
    assert fault(path.between(0.0, 0.3)) is None


def test_a_hole_in_the_odometry_is_not_taken_for_standstill():
    whole, holed = Path(), Path()
    for k in range(1, 101):
        step = Displacement(0.02 * k, 0.02, 0.005, 0.0, 0.0, 1e-6, 1e-6)
        whole.append(step)
        if not 40 <= k < 90:
            holed.append(step)
    known, unsure = whole.between(0.0, 2.0), holed.between(0.0, 2.0)
    assert known.translation_variance == pytest.approx(1e-4)
    assert unsure.translation_variance > 100 * known.translation_variance
    assert unsure.heading_variance > 100 * known.heading_variance
    # Outside the hole nothing is less sure.
    before = holed.between(0.0, 0.7)
    assert before.heading_variance == pytest.approx(whole.between(0.0, 0.7).heading_variance)


def test_beyond_its_end_the_path_is_known_less_by_the_second():
    path = Path()
    path.append(Displacement(1.0, 1.0, 0.3, 0.0, 0.0, 1e-4, 1e-4))
    late, later = path.between(1.0, 1.5), path.between(1.0, 2.0)
    assert (late.dx, late.dpsi) == (0.0, 0.0)
    assert 0.0 < 2.0 * late.translation_variance == pytest.approx(later.translation_variance)
    assert 0.0 < 2.0 * late.heading_variance == pytest.approx(later.heading_variance)


@pytest.mark.parametrize("seconds", [0.02, 0.1, 0.5, 3.0])
def test_a_hole_adds_variance_by_the_second_as_the_end_does(seconds):
    """A random walk: n intervals of one second are as uncertain as one of n seconds."""
    holed, ended = Path(), Path()
    for path in (holed, ended):
        path.append(Displacement(1.0, 1.0, 0.0, 0.0, 0.0))
    holed.append(Displacement(2.0 + seconds, 1.0, 0.0, 0.0, 0.0, 0.5, 0.25))
    unsure = holed.between(1.0, 2.0 + seconds)
    a_second = ended.between(1.0, 2.0)
    assert unsure.translation_variance - 0.5 == pytest.approx(seconds * 0.015)
    assert unsure.heading_variance - 0.25 == pytest.approx(seconds * 0.1)
    assert (a_second.translation_variance, a_second.heading_variance) == (0.015, 0.1)


def test_a_path_that_forgets_still_knows_every_time_within_what_it_keeps():
    """At the border, too: between the last step that is forgotten and the first that is kept."""
    path = Path(keep_seconds=1.9)
    for k in range(1, 1001):
        path.append(Displacement(0.25 * k, 0.25, 0.5, 0.0, 0.0))
        oldest = max(0.0, path.end - 1.9)
        times = np.linspace(oldest, path.end, 17)
        assert_allclose(path.poses(times)[:, 0], 2.0 * times, atol=1e-9)


@given(st.complex_numbers(max_magnitude=100.0))
def test_ranges_and_bearings_are_those_of_complex_numbers(point):
    ranges, bearings = polar(np.array([[point.real, point.imag]]))
    assert_allclose((ranges[0], bearings[0]), cmath.polar(point), atol=1e-12)


def test_the_ends_of_the_circle_lie_in_the_outer_sectors():
    ends = np.array([-math.pi, np.nextafter(math.pi, 0.0), math.pi])
    assert sector(ends).tolist() == [0, SECTORS - 1, SECTORS - 1]


def test_an_extended_path_goes_on_as_the_robot_drove_and_leaves_the_first_alone() -> None:
    """On a circle, whose continuation is known; and no further than the coast."""
    speed, rate, dt = 0.3, 1.2, 0.02
    path = Path()
    step = Displacement(0.0, dt, speed * dt, 0.0, rate * dt)
    for k in range(1, 101):
        path.append(dataclasses.replace(step, time=k * dt))
    end, heading = path.end, 100 * rate * dt
    longer = path.extended(end + 0.2)
    assert path.end == end == pytest.approx(2.0)
    x, y, psi = longer.poses(np.array([end + 0.2]))[0]
    radius = speed / rate
    assert psi == pytest.approx(heading + 0.2 * rate)
    expected = (radius * math.sin(psi), radius * (1.0 - math.cos(psi)))
    assert (x, y) == pytest.approx(expected, abs=0.01)
    stands = path.extended(end + 5.0)
    assert stands.end < end + 0.5
    assert (
        stands.between(end, end + 5.0).heading_variance
        > longer.between(end, end + 0.2).heading_variance
    )
    assert Path().extended(3.0).end == -math.inf
