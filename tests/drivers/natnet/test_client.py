import ipaddress
import os
import socket
import threading
import time

import numpy as np
import pytest

from host.config import NatNet
from host.drivers.natnet import client as driver
from host.drivers.natnet import network as natnet_network
from host.drivers.natnet.client import NatNetClient
from host.drivers.natnet.network import Interface, Link
from host.messages import Bodies, Health
from host.simulation.devices.natnet_server import NatNetServer


class Robots:
    """Two bodies on known paths; the first one's x tells when it was looked at."""

    def __init__(self):
        self.start = time.monotonic()
        self.lost = set()

    def __call__(self, moment):
        identities = np.array([1, 7])
        poses = np.array([[moment - self.start, 0.5, 0.3], [2.0, -1.0, -3.0]])
        poses[[number in self.lost for number in identities]] = np.nan
        return identities, poses


def nobody(moment):
    return np.zeros(0, dtype=np.int64), np.zeros((0, 3))


class Running:
    """A client in its thread; `until` waits for a message of its."""

    def __init__(self, config):
        self.messages = []
        self.new = threading.Condition()
        self.stop = threading.Event()
        self.thread = threading.Thread(
            target=NatNetClient(config).run, args=(self.emit, self.stop), daemon=True
        )

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.stop.set()
        self.thread.join(10.0)
        assert not self.thread.is_alive()

    def emit(self, message):
        with self.new:
            self.messages.append(message)
            self.new.notify_all()

    def until(self, wanted):
        with self.new:
            assert self.new.wait_for(lambda: any(map(wanted, self.messages)), 20.0), [
                message for message in self.messages if isinstance(message, Health)
            ]
            return next(message for message in self.messages if wanted(message))

    def until_says(self, *words, ok=False):
        return self.until(
            lambda message: (
                isinstance(message, Health)
                and message.ok == ok
                and all(word in message.reason for word in words)
            )
        )

    def bodies(self, count, after=0):
        with self.new:
            assert self.new.wait_for(lambda: len(self._bodies(after)) >= count, 20.0)
            return self._bodies(after)

    def _bodies(self, after):
        return [message for message in self.messages[after:] if isinstance(message, Bodies)]

    def stamped(self, robots, count):
        """Bodies stamped with their exposure, as well as the clock is said to be known."""
        said = self.until_says("2 bodies", "clock known to", ok=True)
        known_ms = float(said.reason.partition("clock known to ")[2].split()[0])
        heard = self.bodies(count, after=self.messages.index(said))
        for each in heard:
            off_s = robots.start + each.poses[0, 0] - each.time
            assert abs(off_s) < 1e-3 * (known_ms + 0.1)  # said to 0.1 ms
        return heard


@pytest.fixture(autouse=True)
def quick(monkeypatch, device_blamed):
    """Says soon what it is about; but a server that a busy computer holds up is not silent."""
    monkeypatch.setattr(driver, "_HEALTH_PERIOD_S", 0.2)
    monkeypatch.setattr(driver, "_ANSWER_WAIT_S", 0.1)
    monkeypatch.setattr(driver, "_SILENCE_S", 100.0)


@pytest.fixture(scope="module")
def multicast():
    """Skips where the loopback interface passes no multicast on."""
    group, local = "239.255.42.98", socket.inet_aton("127.0.0.1")
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as hears,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as says,
    ):
        try:
            hears.bind((group, 0))
            hears.setsockopt(
                socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(group) + local
            )
            hears.settimeout(2.0)
            says.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, local)
            says.sendto(b"hello", (group, hears.getsockname()[1]))
            hears.recv(10)
        except OSError as error:
            if os.environ.get("CI") == "true":
                raise
            pytest.skip(f"no multicast on the loopback interface: {error}")


def test_a_computer_that_stood_still_is_not_taken_for_a_silent_server():
    """The clock leaps by 200 s with each frame that is taken in, as if nothing had run for so long.

    What came meanwhile waits in the socket: the server was never silent, and the connection stays.
    """
    leap = [0.0]
    messages, stop, enough = [], threading.Event(), threading.Event()

    def emit(message):
        messages.append(message)
        if isinstance(message, Bodies):
            leap[0] += 200.0
        if sum(isinstance(each, Bodies) for each in messages) > 20:
            enough.set()

    with NatNetServer(Robots()) as server:
        client = NatNetClient(server.config, lambda: time.monotonic() + leap[0])
        thread = threading.Thread(target=client.run, args=(emit, stop), daemon=True)
        thread.start()
        came = enough.wait(20.0)
        stop.set()
        thread.join(10.0)
    health = [each for each in messages if isinstance(each, Health)]
    assert came, health
    assert not any("stopped answering" in each.reason for each in health), health
    assert health[-1].counts["connections"] == 1


@pytest.mark.parametrize("version", [(3, 0), (4, 0), (4, 1)])
def test_bodies_are_stamped_with_the_middle_of_their_exposure(version):
    robots = Robots()
    with NatNetServer(robots, 200.0, version=version) as server, Running(server.config) as client:
        latest = client.stamped(robots, 50)
    for each in latest:
        assert each.identities.tolist() == [1, 7]
        np.testing.assert_allclose(each.poses[0, 1:], [0.5, 0.3], atol=1e-6)
        np.testing.assert_allclose(each.poses[1], [2.0, -1.0, -3.0], atol=1e-6)


def test_multicast(multicast):
    robots = Robots()
    with (
        NatNetServer(robots, connection="multicast", up="z") as server,
        Running(server.config) as client,
    ):
        heard = client.stamped(robots, 20)
    np.testing.assert_allclose(heard[-1].poses[1], [2.0, -1.0, -3.0], atol=1e-6)


@pytest.mark.parametrize("version", [(2, 7), (2, 9), (2, 11)])
def test_a_server_without_a_clock_is_stamped_by_arrival(version):
    robots = Robots()
    with NatNetServer(robots, version=version) as server, Running(server.config) as client:
        heard = client.bodies(30)
        client.until_says("stamped on arrival", ok=True)
    for each in heard[10:]:
        assert robots.start + each.poses[0, 0] < each.time <= time.monotonic()


def test_bodies_out_of_sight_are_left_out_and_named():
    robots = Robots()
    with NatNetServer(robots) as server, Running(server.config) as client:
        robots.lost = {7}
        client.until_says("1 bodies", "not tracked: 7", ok=True)
        robots.lost = {1, 7}
        client.until_says("no rigid body is tracked (streaming ids 1, 7)")
        assert len(client.bodies(1)[-1].identities) == 0


def test_frames_without_bodies_are_explained():
    with NatNetServer(nobody) as server, Running(server.config) as client:
        client.until_says("without rigid bodies", "streaming pane")


def test_no_frames_by_multicast_names_the_interface_and_the_group(multicast):
    with NatNetServer(Robots(), connection="multicast") as server:
        server.streaming = False
        with Running(server.config) as client:
            client.until_says(
                "connected to Motive 3.1 at 127.0.0.1, but no frames come",
                f"joined 239.255.42.99:{server.config.data_port} by lo (127.0.0.1/8)",
                "Broadcast Frame Data",
                'connection = "unicast"',
            )
            server.streaming = True
            assert client.bodies(1)


def test_packets_from_another_address_are_not_taken_but_named(multicast):
    with NatNetServer(Robots(), connection="multicast") as server:
        server.streaming = False
        with (
            Running(server.config) as client,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
        ):
            other.bind(("127.0.0.2", 0))
            other.setsockopt(
                socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1")
            )
            where = server.config.multicast_group, server.config.data_port
            said = threading.Event()

            def disturb():
                while not said.wait(0.05):
                    other.sendto(b"frame of another", where)

            disturber = threading.Thread(target=disturb)
            disturber.start()
            try:
                client.until_says("come from 127.0.0.2 instead", 'set server = "127.0.0.2"')
            finally:
                said.set()
                disturber.join()


def test_unicast_where_the_server_streams_by_multicast():
    with NatNetServer(Robots(), connection="multicast") as server:
        config = server.config.model_copy(update={"connection": "unicast"})
        with Running(config) as client:
            client.until_says("no frames", "streams by multicast", 'connection = "multicast"')


def test_multicast_where_the_server_streams_by_unicast():
    with NatNetServer(Robots()) as server:
        config = server.config.model_copy(update={"connection": "multicast"})
        with Running(config) as client:
            client.until_says("streams by unicast", 'set connection = "unicast"')


def test_a_server_that_does_not_answer_and_comes_later(monkeypatch):
    monkeypatch.setattr(driver, "_SILENCE_S", 0.6)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with Running(NatNet(server="127.0.0.1", command_port=port, connection="unicast")) as client:
        client.until_says("does not answer", f"port {port} by lo", "Local Interface", "firewall")
        with NatNetServer(Robots(), command_port=port):
            assert client.bodies(5)
        client.until_says("stopped answering")


def test_a_server_whose_playback_stands_still_is_named():
    with NatNetServer(Robots()) as server, Running(server.config) as client:
        assert client.bodies(5)
        frame = server._frame
        server._frame = lambda number, exposed, timestamp: frame(7, exposed, timestamp)
        client.until_says("sends one frame again and again", "Live mode")


def test_an_old_server_is_refused():
    with (
        NatNetServer(Robots(), version=(2, 5)) as server,
        Running(server.config) as client,
    ):
        client.until_says("speaks NatNet 2.5", "2.7", "update Motive")


def test_a_name_that_nobody_has():
    with Running(NatNet(server="no..name")) as client:
        client.until_says("no computer is known by the name no..name", "server in [mocap.natnet]")


def test_the_way_to_the_server_in_words(monkeypatch):
    def at(name, address, subnet):
        return Interface(name, address, ipaddress.IPv4Network(subnet))

    link = Link(NatNet(server="127.0.0.1", command_port=1))
    link.close()
    link.server, link.local = "192.168.0.106", "192.168.0.5"
    cable, radio = (
        at("eth0", "192.168.0.5", "192.168.0.0/24"),
        at("wlan0", "192.168.0.9", "192.168.0.0/24"),
    )
    monkeypatch.setattr(natnet_network, "interfaces", lambda: [cable])
    assert link.way() == ("eth0 (192.168.0.5/24)", "")
    monkeypatch.setattr(natnet_network, "interfaces", lambda: [radio, cable])
    assert link.way()[1] == "wlan0 (192.168.0.9/24) is in the same subnet: switch one off"
    link.server = "10.1.2.3"
    assert "10.1.2.3 is not in its subnet" in link.way()[1]
    monkeypatch.setattr(natnet_network, "interfaces", list)
    assert link.way() == ("192.168.0.5", "")


def test_interfaces_of_this_computer():
    assert Interface("lo", "127.0.0.1", ipaddress.IPv4Network("127.0.0.0/8")) in (
        natnet_network.interfaces()
    )
