"""What readers are told: everything in the robot's frame of one moment, as the schema says."""

import json
import math
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.config import RobotConfig
from host.messages import Bearings, Displacement, Now, Positions, Scan
from host.sessions.offline.localizing import localize
from host.sessions.recordings.runs import simulate_scenario
from host.viewer.scene import ellipse
from tests.viewer import scenes

DOCS = Path(__file__).resolve().parents[2] / "docs"
SCHEMA = jsonschema.Draft202012Validator(json.loads((DOCS / "stream.schema.json").read_text()))


def test_what_was_seen_before_a_turn_stands_where_it_is_after_it() -> None:
    scene = scenes.a_scene()
    scene.take(scenes.a_step(1.0))
    scene.take(scenes.a_scan(1.0, (1.0, 0.0), (0.0, 2.0)))
    scene.take(scenes.candidates(1.0, (1.0, 0.0)))
    scene.take(scenes.bearings(1.0, 0.0))
    scene.take(scenes.a_step(1.2, dpsi=math.pi / 2))
    told = scene.message(scenes.now(1.2))
    lidar = RobotConfig().lidar
    assert (lidar.x_m, lidar.y_m) == (0.0, 0.0)
    ahead, beside = told["scan"]
    assert ahead == pytest.approx([0.0, -1.0], abs=2e-3)
    assert beside == pytest.approx([2.0, 0.0], abs=2e-3)
    assert told["candidates"][0] == pytest.approx([0.0, -1.0], abs=2e-3)
    (seen,) = told["bearings"]
    assert seen["directions"] == [pytest.approx(-math.pi / 2, abs=1e-3)]
    assert seen["view"]["centre"] == pytest.approx(-math.pi / 2, abs=1e-3)
    assert told["pose"]["heading"] == pytest.approx(math.pi / 2, abs=1e-3)


def test_what_is_old_is_not_shown() -> None:
    scene = scenes.a_scene()
    scene.take(scenes.a_scan(1.0, (1.0, 0.0)))
    scene.take(scenes.candidates(1.0, (1.0, 0.0)))
    scene.take(scenes.bearings(1.0, 0.0))
    told = scene.message(scenes.now(3.0))
    assert told["scan"] == told["candidates"] == told["bearings"] == []


def test_messages_of_a_whole_run_are_as_the_schema_says() -> None:
    run = simulate_scenario("arena4:seconds=6,seed=3", None)
    (*_, last) = localize(run.messages, run.config)
    scene = scenes.a_scene()
    for message in run.messages:
        scene.take(message)
        if isinstance(message, Scan):
            told = scene.message(Now(last, message.time))
            SCHEMA.validate(json.loads(json.dumps(told, allow_nan=False)))
    assert told["scan"]
    assert told["bearings"]
    scene.take(scenes.health(ok=False))
    SCHEMA.validate(scene.message(scenes.now(last.time, (1.0, 2.0), truth=True)))


@given(st.floats(0.001, 1.0), st.floats(0.001, 1.0), st.floats(-math.pi / 2, math.pi / 2))
def test_the_ellipse_is_that_of_the_covariance(a: float, b: float, angle: float) -> None:
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    major, minor, direction = ellipse(turn @ np.diag((a**2, b**2)) @ turn.T)
    assert (major, minor) == pytest.approx((max(a, b), min(a, b)), rel=1e-6)
    if abs(a - b) > 1e-3:
        expected = angle if a > b else angle + math.pi / 2
        assert abs(math.sin(direction - expected)) < 1e-3


def test_what_no_number_is_becomes_null() -> None:
    told = scenes.a_scene().message(Now(scenes.an_estimate(1.0), -math.inf))
    assert told["measured"] is None
    json.dumps(told, allow_nan=False)


def test_every_kind_of_message_may_come() -> None:
    scene = scenes.a_scene()
    for message in (
        Displacement(1.0, 0.1, 0.0, 0.0, 0.0),
        Positions(1.0, np.zeros((0, 2)), np.zeros((0, 2, 2))),
        Bearings(1.0, np.zeros(0), np.zeros(0)),
        scenes.a_scan(1.0, (1.0, 1.0)),
        scenes.an_estimate(1.0),
        scenes.health(),
    ):
        scene.take(message)
    SCHEMA.validate(scene.message(scenes.now(1.0)))
