import random

import pytest

from host.drivers.natnet.echo_clock import EchoClock

HZ = 10_000_000
AHEAD_S = 123_456.7


class Server:
    """A clock that drifts, asked over a network that delays either way."""

    def __init__(self, drift=0.0, seed=1, fastest_s=0.0002, delay_s=0.002):
        self.drift, self.fastest_s, self.delay_s = drift, fastest_s, delay_s
        self.rng = random.Random(seed)
        self.clock = EchoClock(HZ)

    def ticks(self, host):
        return round((AHEAD_S + host * (1.0 + self.drift)) * HZ)

    def ask(self, host):
        there, back = (self.fastest_s + self.rng.expovariate(1.0 / self.delay_s) for _ in range(2))
        self.clock.update(self.ticks(host + there), host, host + there + back)

    def ask_until(self, end, period=0.25):
        for k in range(round(end / period)):
            self.ask(k * period)

    def error(self, host):
        return self.clock.host_time(self.ticks(host)) - host


def test_one_answer_is_right_to_half_the_round_trip():
    server = Server()
    assert not server.clock.ready
    server.ask(5.0)
    assert server.clock.ready
    assert abs(server.error(5.0)) <= server.clock.uncertainty_s


@pytest.mark.parametrize("drift", [-1e-4, 0.0, 3e-5, 2e-4])
def test_drifting_clock_is_followed(drift):
    for seed in range(5):
        server = Server(drift, seed)
        server.ask_until(60.0)
        errors = [server.error(host) for host in (55.0, 58.0, 60.0)]
        assert max(map(abs, errors)) < 0.0005, f"seed {seed}"


def test_an_answer_that_was_delayed_one_way_does_not_matter():
    server = Server(delay_s=1e-5)
    server.ask_until(2.0)
    before = server.error(3.0)
    server.clock.update(server.ticks(2.0), 2.0, 2.5)  # 0.5 s on its way back
    assert server.error(3.0) == pytest.approx(before, abs=1e-4)
    assert server.clock.restarts == 0


def test_a_restarted_server_is_noticed():
    server = Server()
    server.ask_until(30.0)
    server.clock.update(0, 30.0, 30.001)
    assert server.clock.restarts == 1
    assert server.clock.host_time(0) == pytest.approx(30.0005)
