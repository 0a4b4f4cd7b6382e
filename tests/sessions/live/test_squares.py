"""A square that cannot be driven ends in words, not never."""

import contextlib

import numpy as np
import pytest

from host.calibration.gathered import Gathered
from host.config import RobotConfig
from host.errors import UserError
from host.messages import Bodies, Displacement
from host.sessions.live import squares
from host.sessions.live.squares import Standing, drive_square, square_rig


def test_the_robot_has_stood_since_it_last_drove() -> None:
    standing = Standing()
    for halt, now, seconds in (
        ("", 1.0, 0.0),
        ("something is in the way", 2.0, 0.0),
        ("the lidar is lost", 5.0, 3.0),
        ("", 6.0, 0.0),
        ("something is in the way", 7.0, 0.0),
    ):
        standing.note(halt, now)
        assert (standing.halt, standing.seconds) == (halt, seconds)


def test_a_side_longer_than_the_room_is_given_up_with_the_next_step(monkeypatch) -> None:
    monkeypatch.setattr(squares, "PATIENCE_S", 1.0)
    with contextlib.ExitStack() as stack:
        rig = square_rig(stack, RobotConfig(), "arena4:robots=1,posts=0,side_m=1.4,seed=3")
        with pytest.raises(UserError) as error:
            drive_square(rig, 5.0, True, watch=lambda halt: None)
    if "something is in the way" in str(error.value):  # else this computer was too busy to drive
        assert "give it 5 m" in error.value.next_step


def test_a_square_whose_end_motion_capture_did_not_see_is_refused_in_words() -> None:
    gathered = Gathered(RobotConfig())
    for step in range(200):
        time = 0.05 * step
        gathered.take(Displacement(time, 0.05, dx=0.01, dy=0.0, dpsi=0.0))
        if step < 100:
            gathered.take(Bodies(time, np.array([1]), np.array([[0.01 * step, 0.0, 0.0]])))
    gathered.take(Bodies(9.99, np.array([1]), np.zeros((1, 3))))
    with pytest.raises(UserError, match="motion capture did not see the robot"):
        squares.return_error(gathered)
