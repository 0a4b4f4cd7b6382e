"""True paths from motion capture: interpolated where seen, nan where not, in the robot's frame."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.calibration.gathered import Gathered, Tracks
from host.config import Mocap, RobotConfig
from host.errors import UserError
from host.messages import Bodies

angles = st.floats(-math.pi, math.pi)
metres = st.floats(-3.0, 3.0)


def frame(time: float, **poses: tuple[float, float, float]) -> Bodies:
    """A frame of bodies b1, b2, ..."""
    numbers = [int(name[1:]) for name in poses]
    return Bodies(time, np.array(numbers), np.array(list(poses.values())).reshape(-1, 3))


def matrix(pose: np.ndarray | tuple[float, float, float]) -> np.ndarray:
    """The pose as a homogeneous matrix: the oracle for chains of frames."""
    x, y, psi = pose
    c, s = math.cos(psi), math.sin(psi)
    return np.array([[c, -s, x], [s, c, y], [0.0, 0.0, 1.0]])


@settings(derandomize=True, max_examples=100)
@given(metres, metres, angles, st.floats(-0.9, 0.9), st.floats(-0.9, 0.9), angles, metres, metres)
def test_the_robot_is_where_its_body_says_and_a_teammate_beside_it(
    x: float, y: float, psi: float, bx: float, by: float, turn: float, tx: float, ty: float
) -> None:
    mocap = Mocap(body=1, x_m=bx, y_m=by, heading_rad=turn)
    body = matrix((x, y, psi)) @ matrix((bx, by, turn))
    pose = (body[0, 2], body[1, 2], math.atan2(body[1, 0], body[0, 0]))
    frames = [frame(t, b1=pose, b2=(tx, ty, 0.3)) for t in (0.0, 0.01)]
    tracks = Tracks(frames, mocap)
    own = tracks.own(np.array([0.005]))[0]
    assert own[:2] == pytest.approx([x, y], abs=1e-9)
    assert math.cos(own[2] - psi) == pytest.approx(1.0)
    expected = np.linalg.inv(matrix((x, y, psi))) @ [tx, ty, 1.0]
    assert tracks.relative(2, np.array([0.005]))[0] == pytest.approx(expected[:2], abs=1e-9)


def test_paths_are_interpolated_and_headings_do_not_jump() -> None:
    turning = [
        frame(0.05 * k, b1=(0.1 * k, 0.0, math.remainder(0.3 * k, math.tau))) for k in range(60)
    ]
    own = Tracks(turning, Mocap()).own(np.array([0.025, 1.525]))
    assert own[:, 0] == pytest.approx([0.05, 3.05])
    assert own[:, 2] == pytest.approx([0.15, 9.15])


def test_what_nobody_saw_is_not_made_up() -> None:
    times = [*np.arange(0.0, 1.0, 0.01), *np.arange(1.5, 2.0, 0.01)]
    tracks = Tracks([frame(t, b1=(t, 0.0, 0.0)) for t in times], Mocap())
    found = tracks.own(np.array([-0.1, 0.5, 1.2, 1.7, 3.0]))[:, 0]
    assert np.isnan(found).tolist() == [True, False, True, False, True]
    assert tracks.span == (0.0, pytest.approx(1.99))


def test_a_body_seen_now_and_then_is_known_when_it_was_seen() -> None:
    times = 0.3 * np.arange(5.0)
    tracks = Tracks([frame(t, b1=(t, 0.0, 4.0 * t)) for t in times], Mocap())
    assert tracks.own(times)[:, 0] == pytest.approx(times)
    assert np.isnan(tracks.own(times[:-1] + 0.1)).all()


def test_a_body_seen_once_is_known_at_that_time_only() -> None:
    tracks = Tracks([frame(1.0, b1=(0.0, 0.0, 0.0), b5=(1.0, 2.0, 0.0))], Mocap())
    assert tracks.identities.tolist() == [5]
    found = tracks.relative(5, np.array([0.9, 1.0, 1.1]))
    assert np.isnan(found[[0, 2]]).all()
    assert found[1].tolist() == [1.0, 2.0]


def test_truths_leave_out_teammates_that_were_lost() -> None:
    frames = [frame(0.0, b1=(0, 0, 0), b2=(1, 0, 0), b3=(0, 1, 0))]
    frames += [frame(0.01 * k, b1=(0, 0, 0), b2=(1, 0, 0)) for k in range(1, 50)]
    truths = Tracks(frames, Mocap()).truths(np.array([0.0, 0.3, 9.0]))
    assert [truth.time for truth in truths] == [0.0, 0.3]
    assert truths[0].identities.tolist() == [2, 3]
    assert truths[1].identities.tolist() == [2]
    alone = Tracks([frame(0.0, b1=(0, 0, 0))], Mocap())
    assert alone.truths(np.array([0.0])) == []


def test_a_robot_that_was_never_seen_is_told_with_what_was() -> None:
    gathered = Gathered(RobotConfig())
    with pytest.raises(UserError, match="no motion capture"):
        gathered.tracks()
    gathered.take(frame(0.0, b7=(0, 0, 0), b8=(0, 0, 0)))
    with pytest.raises(UserError, match=r"never saw body 1(.|\n)*bodies seen: 7, 8"):
        gathered.tracks()
