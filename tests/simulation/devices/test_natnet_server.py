import random
import socket

import numpy as np
import pytest

from host.drivers.natnet import protocol as natnet
from host.drivers.natnet.frames import MocapFrame
from host.drivers.natnet.protocol import Echo, MocapDecoder, ServerInfo
from host.simulation.devices.natnet_server import CAMERA_S, CLOCK_HZ, SOLVING_S, NatNetServer


def poses(moment):
    return np.array([3]), np.array([[1.0, 2.0, 0.5]])


@pytest.fixture
def client():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as made:
        made.bind(("127.0.0.1", 0))
        made.settimeout(10.0)
        yield made


def ask(client, server, *packets):
    for packet in packets:
        client.sendto(packet, (server.config.server, server.config.command_port))


def test_it_answers_and_streams_to_who_connected(client):
    decoder = MocapDecoder()
    with NatNetServer(poses, 200.0) as server:
        ask(client, server, natnet.connect())
        assert decoder.feed(client.recv(9999)) == ServerInfo(
            "Motive", (3, 1, 0, 0), (4, 1), CLOCK_HZ, False, server.config.data_port, "0.0.0.0"
        )
        ask(client, server, natnet.keep_alive(), natnet.echo_request(77))
        values = [decoder.feed(client.recv(9999)) for _ in range(30)]
    (echo,) = [value for value in values if isinstance(value, Echo)]
    assert echo.asked == 77
    frames = [value for value in values if isinstance(value, MocapFrame)]
    assert len(frames) == 29
    for frame in frames:
        assert (frame.received - frame.exposed) / CLOCK_HZ == pytest.approx(CAMERA_S, abs=1e-6)
        assert (frame.transmitted - frame.received) / CLOCK_HZ >= SOLVING_S - 1e-4
        np.testing.assert_allclose(
            natnet.bodies_of(frame, 0.0, "y").poses, [[1.0, 2.0, 0.5]], atol=1e-6
        )
    steps = np.diff([frame.exposed for frame in frames]) / CLOCK_HZ * 200.0
    np.testing.assert_allclose(steps, np.round(steps), atol=0.01)  # frames are left out, not late


def test_garbage_does_not_disturb_it(client):
    rng = random.Random(4)
    with NatNetServer(poses) as server:
        ask(client, server, *(rng.randbytes(rng.randrange(50)) for _ in range(200)))
        ask(client, server, b"\x0c\0\x01\0\0", natnet.echo_request(5))
        assert MocapDecoder().feed(client.recv(9999)).asked == 5
