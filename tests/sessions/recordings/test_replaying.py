"""What a replay calls different."""

import dataclasses

import numpy as np
import pytest

from host.config import RobotConfig
from host.errors import UserError
from host.estimator import profiles
from host.geometry import to_frame, to_parent
from host.localizer import Localizer
from host.messages import Displacement, Estimate, Names, Positions, TeammateOdometry
from host.pipeline import Pipeline
from host.recording.log import Recorder, Recording, RecordingHeader
from host.sessions.recordings.replaying import Comparison, replay_recording
from host.systems.id_phd.naming import Naming
from tests.test_pipeline import Emits, Inbox


def an_estimate(time):
    none = np.zeros(0)
    return Estimate(
        time, np.zeros((0, 2)), np.zeros((0, 2, 2)), none, none, np.zeros(0, dtype=np.int64)
    )


def test_estimates_too_many_or_too_few_are_different():
    step = Displacement(1.0, 0.1, 0.0, 0.0, 0.0)
    a, b = an_estimate(1.0), an_estimate(2.0)
    for fed, equal, different in (
        ([(step, [a]), (a, []), (step, [b]), (b, []), (None, [])], 2, 0),
        ([(step, [a]), (step, [b]), (b, []), (None, [])], 1, 1),  # one was not recorded
        ([(step, []), (a, []), (step, [b]), (b, []), (None, [])], 1, 1),  # one is not made
        ([(step, [a]), (b, []), (None, [])], 0, 1),
        ([(step, [a, b]), (a, []), (None, [])], 1, 0),  # the run was killed
        ([(step, []), (a, []), (None, [a])], 1, 0),  # made at the end
        ([(step, []), (a, []), (None, [])], 0, 1),
    ):
        comparison = Comparison()
        for message, made in fed:
            comparison.take(message, made)
        assert (comparison.equal, comparison.different) == (equal, different)


def what_a_robot_hears_and_sees(seconds=8.0, step_s=0.1):
    """Of two teammates that drive arcs: what the lidar finds, and what they send. In order."""
    random = np.random.default_rng(1)
    poses = np.array([[1.0, 0.0, 0.3], [-0.3, 1.0, 2.0]])
    for time in np.arange(step_s, seconds, step_s).tolist():
        yield Displacement(time, step_s, 0.0, 0.0, 0.02, 1e-7, 1e-6)
        for robot, turned in enumerate((0.08, -0.1)):
            place = to_parent(np.array([[0.02, 0.0]]), poses[robot])[0]
            poses[robot] = [*place, poses[robot, 2] + turned]
            yield TeammateOdometry(time, robot + 5, step_s, 0.02, 0.0, turned, 1e-6, 1e-6)
        seen = to_frame(poses[:, :2], np.array([0.0, 0.0, 0.2 * time]))
        covariances = np.tile(1e-4 * np.eye(2), (2, 1, 1))
        yield Positions(time, seen + random.normal(0.0, 0.01, (2, 2)), covariances)


def recorded_run(path, messages):
    """The same as of a live run: a pipeline's sinks write it."""
    robot = RobotConfig()
    localizer = Localizer(robot, profiles.make("pmb", robot))
    inbox = Inbox()
    with (
        Recorder(path, RecordingHeader(robot, "lidar")) as recorder,
        Pipeline(
            localizer,
            {"robot": Emits(*messages)},
            {"recording": recorder.write, "inbox": inbox},
            followers={"naming": Naming()},
        ),
    ):
        last = messages[-1].time
        inbox.wait_for(lambda each: isinstance(each, Estimate) and each.time == last)
    return Recording(path)


def test_a_replay_finds_the_names_of_the_run_again(tmp_path):
    messages = list(what_a_robot_hears_and_sees())
    replayed = replay_recording(recorded_run(tmp_path / "a.mcap", messages))
    replayed.check()
    assert replayed.comparisons["names"].equal > 25
    assert replayed.comparisons["names"].different == 0
    assert replayed.figures["recognized"] == [5, 6]
    assert replayed.figures["named_share"] > 0.5


def test_names_that_differ_are_said(tmp_path):
    recording = recorded_run(tmp_path / "a.mcap", list(what_a_robot_hears_and_sees()))
    with Recorder(tmp_path / "b.mcap", recording.header) as other:
        for message in recording.messages():
            if isinstance(message, Names):
                headings = np.nextafter(message.headings, 9.0)
                message = dataclasses.replace(message, headings=headings)
            other.write(message)
    replayed = replay_recording(Recording(tmp_path / "b.mcap"))
    assert replayed.comparisons["estimates"].different == 0
    with pytest.raises(UserError, match="names differ from the recorded"):
        replayed.check()
