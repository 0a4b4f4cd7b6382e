"""What a client of Foxglove's protocol gets: the topics of a recording, as ROS 2 messages."""

import contextlib
import json
import socket
import struct
import sys
import time

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from host.config import RobotConfig
from host.errors import UserError
from host.viewer.foxglove_server import FoxgloveServer
from tests.viewer import scenes

ROS = get_typestore(Stores.ROS2_HUMBLE)


class Client:
    """Speaks foxglove.sdk.v1: subscribes to every channel that is advertised."""

    def __init__(self, socket):
        self._socket = socket
        self._types, self._topics = {}, {}

    def messages(self, tell, wanted):
        """(topic, message, log time in s), by topic, once all that are wanted came."""
        found, end = {}, time.monotonic() + 30.0
        while not wanted <= set(found):
            assert time.monotonic() < end, found
            tell()
            try:
                frame = self._socket.recv(timeout=0.05)
            except TimeoutError:
                continue
            if isinstance(frame, str):
                self._subscribe(json.loads(frame))
            elif frame[0] == 1:
                subscription, stamp = struct.unpack_from("<IQ", frame, 1)
                kind, topic = self._types[subscription], self._topics[subscription]
                found[topic] = ROS.deserialize_cdr(frame[13:], kind), stamp / 1e9
        return found

    def _subscribe(self, told):
        if told["op"] != "advertise":
            return
        for channel in told["channels"]:
            assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg")
            assert "MSG: " in channel["schema"]
            self._types[channel["id"]] = channel["schemaName"]
            self._topics[channel["id"]] = channel["topic"]
        wishes = [{"id": each["id"], "channelId": each["id"]} for each in told["channels"]]
        self._socket.send(json.dumps({"op": "subscribe", "subscriptions": wishes}))


def test_a_client_of_its_protocol_gets_the_topics_of_a_recording():
    begin = time.monotonic()
    with (
        FoxgloveServer(RobotConfig(), "127.0.0.1", 0) as server,
        connect(server.url, subprotocols=["foxglove.sdk.v1"]) as stream,
    ):

        def tell():
            moment = time.monotonic()
            server.take(scenes.a_scan(moment, (1.0, 1.0)))
            server.take(scenes.a_step(moment, dx=0.01))
            server.take(scenes.an_estimate(moment - 5.0, (9.0, 9.0)))  # of the past
            server.look(scenes.now(moment, (1.0, 0.5), truth=True))

        wanted = {"/scan", "/odom", "/tf", "/tf_static", "/teammates", "/teammates/markers"}
        found = Client(stream).messages(tell, wanted | {"/teammates/truth"})
    poses, stamp = found["/teammates"]
    assert [(pose.position.x, pose.position.y) for pose in poses.poses] == [(1.0, 0.5)]
    assert poses.header.frame_id == "base_link"
    assert begin - 1.0 < stamp - (time.time() - time.monotonic()) < time.monotonic() + 1.0
    ranges = found["/scan"][0].ranges
    assert ranges[np.isfinite(ranges)] == pytest.approx([np.sqrt(2.0)], rel=1e-6)
    assert len(found["/teammates/markers"][0].markers) == 2  # an ellipse and its label


@pytest.mark.parametrize("origin", [None, "https://app.foxglove.dev", "file://"])
def test_programs_and_its_app_may_read(origin):
    with FoxgloveServer(RobotConfig(), "127.0.0.1", 0) as server:
        assert "serverInfo" in greeting(server.url, origin)


@pytest.mark.parametrize(
    "origin", ["https://evil.example", "null", "http://app.foxglove.dev", "https://foxglove.dev"]
)
def test_a_page_from_elsewhere_may_not_read(origin):
    with FoxgloveServer(RobotConfig(), "127.0.0.1", 0) as server:
        with pytest.raises(InvalidStatus) as refused:
            greeting(server.url, origin)
        assert refused.value.response.status_code == 403
        with pytest.raises(InvalidStatus):
            greeting(server.url.replace("127.0.0.1", "localhost.evil.example"), None, server)


def greeting(url, origin, server=None):
    """The first message of a server; with `server`, asked for by the other name in `url`."""
    there = None
    if server is not None:
        port = int(server.url.rpartition(":")[2])
        there = socket.create_connection(("127.0.0.1", port))
    with connect(url, origin=origin, subprotocols=["foxglove.sdk.v1"], sock=there) as stream:
        return stream.recv(timeout=30.0)


def test_where_others_reach_it_the_token_is_asked_for():
    with FoxgloveServer(RobotConfig(), "0.0.0.0", 0) as server:
        address, _, token = server.url.partition("/?token=")
        assert len(token) >= 20
        assert "serverInfo" in greeting(server.url, "https://app.foxglove.dev")
        for wrong in (address, f"{address}/?token=wrong"):
            with pytest.raises(InvalidStatus) as refused:
                greeting(wrong, None)
            assert refused.value.response.status_code == 403


def test_who_sends_no_request_is_let_go_and_the_end_waits_for_nobody():
    with contextlib.ExitStack() as readers:
        with FoxgloveServer(RobotConfig(), "127.0.0.1", 0) as server:
            there = ("127.0.0.1", int(server.url.rpartition(":")[2]))
            with socket.create_connection(there, timeout=30.0) as garbage:
                garbage.sendall(b"hello\r\n\r\n")
                assert garbage.recv(10) == b""
            silent = readers.enter_context(socket.create_connection(there, timeout=30.0))
            readers.enter_context(connect(server.url, subprotocols=["foxglove.sdk.v1"]))
        assert silent.recv(10) == b""


def refuse(**_):
    raise RuntimeError("no server")


def test_a_port_that_is_taken_and_an_sdk_that_is_missing_are_told(monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(UserError, match=rf"Foxglove at 127\.0\.0\.1:{port}"):
            FoxgloveServer(RobotConfig(), "127.0.0.1", port)
    with monkeypatch.context() as refused:
        refused.setattr("foxglove.start_server", refuse)
        with pytest.raises(
            UserError, match=rf"Foxglove at 127\.0\.0\.1:{port}\nno server"
        ) as failed:
            FoxgloveServer(RobotConfig(), "127.0.0.1", port)
    socket.create_server(("127.0.0.1", port)).close()  # it is free again
    assert failed.traceback  # which keeps alive what is not closed
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(UserError, match="not installed"):
        FoxgloveServer(RobotConfig(), "127.0.0.1", 0)
