"""A monitored filter: everything goes through, timed, labelled and kept as asked."""

import numpy as np
import pytest

from host.evaluation.labels import TruthTrack
from host.evaluation.monitored import MonitoredFilter
from host.messages import Bearings, Displacement, Positions, Truth

STEP = Displacement(0.0, 0.1, 0.0, 0.0, 0.0)


class Inbox:
    """A filter that keeps what it gets, and numbers its estimates."""

    def __init__(self):
        self.got = []
        self.estimates = 0

    def predict(self, motion):
        self.got.append(motion)

    def update(self, measurement):
        self.got.append(measurement)

    def estimate(self):
        self.estimates += 1
        return self.estimates


def positions(time=0.0, identities=None):
    return Positions(time, np.array([[1.0, 0.0]]), np.eye(2)[None], identities=identities)


def test_messages_and_estimates_go_through_unchanged():
    inbox = Inbox()
    monitored = MonitoredFilter(inbox, [])
    sent = [STEP, positions(), Bearings(0.1, np.zeros(1), np.ones(1))]
    monitored.predict(sent[0])
    monitored.update(sent[1])
    monitored.update(sent[2])
    assert [id(message) for message in inbox.got] == [id(message) for message in sent]
    assert monitored.estimate() == 1


def test_each_update_is_timed_with_its_predict(monkeypatch):
    """On a clock that advances by the calls: 1 s for each predict, 10 s for each update."""
    now = [0.0]

    class Slow(Inbox):
        def predict(self, motion):
            now[0] += 1.0

        def update(self, measurement):
            now[0] += 10.0

    monkeypatch.setattr("host.evaluation.monitored.perf_counter", lambda: now[0])
    spent = []
    monitored = MonitoredFilter(Slow(), spent)
    monitored.predict(STEP)
    monitored.predict(STEP)
    monitored.update(positions())
    now[0] += 100.0  # what passes in between is not the filter's
    monitored.update(positions())
    assert spent == pytest.approx([12.0, 10.0])


def test_readings_are_labelled_from_truth_where_nobody_knows_them():
    inbox = Inbox()
    track = TruthTrack([Truth(0.0, np.array([7]), np.array([[1.0, 0.1]]))])
    monitored = MonitoredFilter(inbox, [], track=track)
    for reading in (positions(), positions(time=9.0), positions(identities=np.array([3]))):
        monitored.update(reading)
    assert [m.identities.tolist() for m in inbox.got] == [[7], [-1], [3]]


def test_estimates_are_kept_after_positions_alone():
    kept = []
    monitored = MonitoredFilter(Inbox(), [], kept)
    monitored.update(positions())
    assert monitored.estimate() == 1  # kept
    monitored.predict(STEP)
    monitored.update(Bearings(1.1, np.zeros(1), np.ones(1)))
    assert monitored.estimate() == 2
    monitored.update(positions())
    assert monitored.estimate() == 3  # kept
    monitored.predict(STEP)
    assert monitored.estimate() == 4  # nothing was measured since
    assert kept == [1, 3]


def test_estimates_are_kept_after_bearings_where_these_are_asked_for():
    kept = []
    monitored = MonitoredFilter(Inbox(), [], kept, kept_after=Bearings)
    for update in (positions(), Bearings(0.1, np.zeros(1), np.ones(1)), positions(0.2)):
        monitored.predict(STEP)
        monitored.update(update)
        monitored.estimate()
    assert kept == [2]
