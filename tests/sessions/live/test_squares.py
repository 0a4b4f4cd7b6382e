"""A square that cannot be driven ends in words, not never."""

import contextlib

import pytest

from host.config import RobotConfig
from host.errors import UserError
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
