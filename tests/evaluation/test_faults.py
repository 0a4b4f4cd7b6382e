"""Faults of sensors: what they change, how much of it, and what stays as it was."""

import math

import numpy as np
import pytest

from host.errors import UserError
from host.evaluation.faults import NONE, Faults, split
from host.messages import Bearings, Displacement, Scan
from host.sessions.recordings import runs

SAMPLES = 720


def a_scan(time):
    angles = np.linspace(-math.pi, math.pi, SAMPLES, endpoint=False)
    return Scan(time, np.full(SAMPLES, time), angles, np.full(SAMPLES, 2.0))


def a_picture(time, **changes):
    known = {"identities": np.array([3]), "pixels": np.zeros((1, 2))} | changes
    return Bearings(time, np.array([0.5]), np.array([0.01]), **known)


def test_faults_are_split_from_any_source():
    assert split("arena4") == ("arena4", NONE)
    assert split("arena4:seed=1,seconds=9") == ("arena4:seed=1,seconds=9", NONE)
    assert split("a/b:c.mcap") == ("a/b:c.mcap", NONE)
    assert split("a.mcap:camera_false=5") == ("a.mcap", Faults(camera_false=5.0))
    assert split("arena4:seed=1, lidar_garbage=.2,seconds=9,camera_dead=20-40") == (
        "arena4:seed=1,seconds=9",
        Faults(lidar_garbage=0.2, camera_dead=(20.0, 40.0)),
    )


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("camera_false=-1", "a number from 0 to 100"),
        ("camera_false=many", "a number from 0 to 100"),
        ("camera_false=nan", "a number from 0 to 100"),
        ("lidar_garbage=20", "a share from 0 to 1"),
        ("lidar_garbage=", "a share from 0 to 1"),
        ("camera_dead=20", "from when to when"),
        ("camera_dead=40-20", "from when to when"),
        ("camera_dead=1-2-3", "from when to when"),
        ("camera_dead=nan-3", "from when to when"),
        ("camera_false=1,camera_false=2", "twice"),
    ],
)
def test_what_cannot_be_is_refused_in_words(setting, words):
    with pytest.raises(UserError, match=words):
        split(f"arena4:{setting}")


def test_the_share_of_garbage_is_as_asked_and_the_rest_stays():
    scans = Faults(lidar_garbage=0.2).applied([a_scan(0.1 * k) for k in range(50)], 1)
    changed = np.concatenate([scan.ranges != 2.0 for scan in scans])
    # Binomial: 36,000 samples have a standard deviation of 0.2 %.
    assert np.mean(changed) == pytest.approx(0.2, abs=0.01)
    garbage = np.concatenate([scan.ranges for scan in scans])[changed]
    assert 0.12 <= garbage.min() < 0.5
    assert 9.5 < garbage.max() <= 10.0


@pytest.mark.parametrize("half_width", [math.pi, math.pi / 2])
def test_false_robots_are_anywhere_in_view_and_as_many_as_asked_all_around(half_width):
    view = (3.0, half_width)
    shown = Faults(camera_false=5.0).applied([a_picture(k, view=view) for k in range(400)], 2)
    counts = [len(each.bearings) - 1 for each in shown]
    expected = 5.0 * half_width / math.pi
    assert np.mean(counts) == pytest.approx(expected, abs=4 * math.sqrt(expected / 400))
    false = np.concatenate([each.bearings[1:] for each in shown])
    off = np.angle(np.exp(1j * (false - 3.0)))
    assert np.all(np.abs(off) <= half_width + 1e-9)
    assert abs(np.mean(off)) < 4 * half_width / math.sqrt(3 * len(off))
    for each in shown:
        assert each.bearings[0] == 0.5
        n = len(each.bearings)
        assert len(each.variances) == len(each.identities) == n
        assert each.identities.tolist() == [3, *[-1] * (n - 1)]


def test_false_robots_have_ranges_where_true_ones_have():
    picture = a_picture(0.0, ranges=np.array([1.0]), range_variances=np.array([0.01]))
    (shown,) = Faults(camera_false=20.0).applied([picture], 0)
    assert len(shown.ranges) == len(shown.range_variances) == len(shown.bearings) > 5
    assert np.all(shown.range_variances > 0.0)
    empty = Bearings(0.0, np.zeros(0), np.zeros(0))
    (shown,) = Faults(camera_false=20.0).applied([empty], 0)
    assert np.all(shown.variances > 0.0)
    assert shown.identities is None


def test_a_dead_camera_gives_nothing_from_when_to_when_after_the_beginning():
    begin = 1000.0
    messages = [Displacement(begin, 0.1, 0.0, 0.0, 0.0)]
    messages += [a_picture(begin + k) for k in range(60)] + [a_scan(begin + 30.0)]
    left = Faults(camera_dead=(20.0, 40.0)).applied(messages, 0)
    times = [each.time - begin for each in left if isinstance(each, Bearings)]
    assert times == [*range(20), *range(40, 60)]
    assert len(left) == len(messages) - 20


def test_the_same_seed_gives_the_same_faults_and_another_others():
    faults = Faults(camera_false=3.0, lidar_garbage=0.1)
    messages = [a_picture(1.0), a_scan(1.1), a_picture(1.2)]
    one, again, other = (faults.applied(messages, seed) for seed in (1, 1, 2))
    for first, second in zip(one, again, strict=True):
        for name in ("bearings", "ranges"):
            np.testing.assert_array_equal(getattr(first, name, 0), getattr(second, name, 0))
    assert not np.array_equal(one[1].ranges, other[1].ranges)


def test_a_source_with_faults_is_the_same_run_but_for_what_they_change():
    sound = runs.load_run("arena4:seconds=2,seed=3", None)
    faulty = runs.load_run("arena4:seconds=2,seed=3,camera_false=4", None)
    assert faulty.name == "arena4:seconds=2,seed=3,camera_false=4"
    assert faulty.scenario == sound.scenario
    assert len(faulty.messages) == len(sound.messages)
    extra = 0
    for before, after in zip(sound.messages, faulty.messages, strict=True):
        assert type(before) is type(after)
        if isinstance(before, Bearings):
            extra += len(after.bearings) - len(before.bearings)
    assert extra > 20
