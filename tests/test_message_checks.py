"""What is refused, in words; that nothing sound is; that no garbage breaks the check itself."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from host.config import RobotConfig
from host.estimator.profiles import filter_entry
from host.message_checks import check, fault
from host.messages import Bearings, Displacement, Positions, TeammateOdometry
from host.registry import FILTERS
from host.simulation.offline import Simulation
from host.simulation.world.scenarios import parse_scenario
from tests.malformed import all_malformed, sound

FILTER_NAMES = sorted(FILTERS.names())


def test_sound_messages_pass() -> None:
    simulation = Simulation(parse_scenario("arena4:seconds=3,seed=1,rendered=1"), RobotConfig())
    for message in [*simulation.messages(), *sound(1.0)]:
        assert fault(message) is None
        check(message)


@pytest.mark.parametrize("kind", [type(message).__name__ for message in sound(1.0)])
def test_each_way_to_spoil_a_message_is_reported(kind: str) -> None:
    spoilt = [message for message in all_malformed(1.0) if type(message).__name__ == kind]
    assert len(spoilt) > 30
    for message in spoilt:
        wrong = fault(message)
        assert wrong is not None, message
        assert wrong.startswith(f"{kind}: ")
        with pytest.raises(ValueError, match=kind):
            check(message)


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        ([[1e-4, 1e-5], [0.0, 2e-4]], "covariance of reading 1 is not symmetric"),
        ([[1e-4, 2e-4], [2e-4, 1e-4]], "covariance of reading 1 is not positive definite"),
        ([[0.0, 0.0], [0.0, 0.0]], "variances of reading 1 are not all at least"),
        ([[math.nan, 0.0], [0.0, 1e-4]], "covariances holds nan"),
    ],
)
def test_the_words_name_the_reading_and_what_is_wrong_with_it(matrix: object, words: str) -> None:
    covariances = np.stack((np.eye(2), np.array(matrix)))
    assert words in str(fault(Positions(0.0, np.zeros((2, 2)), covariances)))


@pytest.mark.parametrize("field", ["time", "interval", "dx", "dpsi", "heading_variance"])
def test_what_a_teammate_sends_is_checked_as_a_displacement(field: str) -> None:
    heard = TeammateOdometry(1.0, 3, 0.1, 0.02, 0.0, 0.01, 1e-6, 1e-6)
    assert fault(heard) is None
    wrong = fault(dataclasses.replace(heard, **{field: math.nan}))
    assert wrong is not None
    assert wrong.startswith(f"TeammateOdometry: {field} is nan")


_ANYTHING = st.one_of(
    st.none(),
    st.booleans(),
    st.floats(),
    st.integers(),
    st.text(max_size=3),
    st.tuples(st.floats(), st.floats()),
    st.lists(st.floats(), max_size=3),
    arrays.arrays(
        st.sampled_from([np.float64, np.int64, np.bool_, np.complex128, "U3", "O", "M8[s]"]),
        arrays.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=3),
    ),
)


@given(st.data())
def test_no_garbage_breaks_the_check_and_what_it_lets_pass_is_harmless(data: st.DataObject) -> None:
    message = data.draw(st.sampled_from(sound(1.0)))
    names = [field.name for field in dataclasses.fields(message)]
    changes = data.draw(st.dictionaries(st.sampled_from(names), _ANYTHING, min_size=1, max_size=2))
    message = dataclasses.replace(message, **changes)
    if fault(message) is not None:
        return
    for name in FILTER_NAMES:
        filter_ = filter_entry(name).make(RobotConfig())
        filter_.update(sound(1.0)[1])
        if isinstance(message, Displacement):
            filter_.predict(message)
        elif type(message).__name__ != "Scan" and message.identities is not None:
            filter_.update(message)
        estimate = filter_.estimate()
        assert np.all(np.isfinite(estimate.positions))
        assert np.all(np.isfinite(estimate.covariances))


@pytest.mark.parametrize("name", FILTER_NAMES)
def test_a_filter_refuses_what_is_malformed_and_stays_as_it_was(name: str) -> None:
    filter_ = filter_entry(name).make(RobotConfig())
    for step in range(5):
        filter_.predict(Displacement(0.1 * step, 0.1, 0.0, 0.0, 0.0))
        filter_.update(sound(0.1 * step)[1])
    before = filter_.estimate()
    for message in all_malformed(0.5):
        takes = filter_.predict if isinstance(message, Displacement) else filter_.update
        with pytest.raises(ValueError, match=r"^\w+: "):
            takes(message)
    after = filter_.estimate()
    for field in dataclasses.fields(before):
        assert np.array_equal(getattr(before, field.name), getattr(after, field.name))


def _extreme(random: np.random.Generator, time: float, interval: float) -> list[Any]:
    """A message of each kind with values from all over what is let pass."""
    n, scale = random.integers(0, 4), random.choice([0.0, 1e-9, 1.0, 1e3])
    variances = 10.0 ** random.uniform(-10.0, 4.0, n)
    covariances = np.zeros((n, 2, 2))
    covariances[:, 0, 0] = variances
    covariances[:, 1, 1] = np.clip(variances * 10.0 ** random.uniform(-4.0, 4.0, n), 1e-10, 1e4)
    noise = random.choice([0.0, 1e-10, 1e-4, 100.0], 2).tolist()
    dx, dy, dpsi = (random.uniform(-1.0, 1.0, 3) * random.choice([0.01, 1e3])).tolist()
    lags, who = 10.0 ** random.uniform(-9.0, 2.0, n), random.integers(-1, 3, n)
    points, scores = random.uniform(-scale, scale, (n, 2)), random.uniform(-500.0, 500.0, n)
    clearance = random.choice([0.0, 0.1, 3.0, math.inf], 360)
    view = float(random.uniform(-1e3, 1e3)), float(random.choice([0.0, 1e-9, 1.0, 1e3]))
    seen = random.uniform(-1e3, 1e3, n), 10.0 ** random.uniform(-10.0, 4.0, n)
    origin = (float(random.uniform(-scale, scale)), 0.0)
    return [
        Displacement(time, interval, dx, dy, dpsi, *noise),
        Positions(time, points, covariances, lags, clearance, who, scores),
        Bearings(time, *seen, origin, 100.0, who, view, np.abs(points[:, 0]), variances),
    ]


@pytest.mark.parametrize("name", FILTER_NAMES)
@pytest.mark.parametrize("seed", range(25))
def test_what_is_just_let_pass_leaves_finite_estimates(name: str, seed: int) -> None:
    random = np.random.default_rng(seed)
    filter_, time = filter_entry(name).make(RobotConfig()), 0.0
    for _ in range(12):
        interval = float(random.choice([0.0, 1e-9, 0.1, 1e9]))
        time += interval
        motion, positions, bearings = _extreme(random, time, interval)
        filter_.predict(motion)
        for measured in (positions, bearings):
            filter_.update(measured)
            estimate = filter_.estimate()
            for values in (estimate.positions, estimate.covariances, estimate.weights):
                assert np.all(np.isfinite(values))
