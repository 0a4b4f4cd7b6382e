"""The server: newest first, slow readers skip, strangers stay out, and it ends at once."""

import contextlib
import dataclasses
import json
import re
import socket
import threading
import time
import urllib.error
import urllib.parse
import urllib.request
from pathlib import Path

import numpy as np
import pytest
from websockets.asyncio.server import serve
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from host.errors import UserError
from host.viewer import server
from host.viewer.server import Viewer
from tests.viewer import scenes

LONG_S, PING_S = 30.0, 60.0  # bounds on waiting; readers that say nothing are let go after PING_S
LIBRARY_S = 2 * PING_S  # see `patient`
DOC = (Path(__file__).resolve().parents[2] / "docs" / "stream.md").read_text()


HANDSHAKE = (
    "GET /stream HTTP/1.1\r\nHost: {}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
)


def address_of(running):
    return "127.0.0.1", urllib.parse.urlsplit(running.viewer.url).port


def get(url, **headers):
    request = urllib.request.Request(url, headers={k.title(): v for k, v in headers.items()})
    with urllib.request.urlopen(request, timeout=LONG_S) as answer:
        return answer.status, dict(answer.headers), answer.read().decode()


@pytest.fixture
def patient(monkeypatch):
    """The library itself waits for readers longer than tests do: what lets go of them is ours."""
    waits = {"open_timeout": LIBRARY_S, "close_timeout": LIBRARY_S, "ping_timeout": LIBRARY_S}
    monkeypatch.setattr(server, "serve", lambda *args, **how: serve(*args, **{**how, **waits}))


def test_a_reader_gets_what_is_known_now(served):
    with connect(served(scenes.a_scan(1.0, (1.0, 0.0))).stream) as stream:
        told = json.loads(stream.recv(timeout=LONG_S))
    assert told["schema"] == "swarmloc.stream/1"
    assert [(each["x"], each["y"]) for each in told["estimates"]] == [(1.0, 0.5)]
    assert len(told["scan"]) == 1


def test_the_page_loads_nothing_from_elsewhere(served):
    status, headers, text = get(served().viewer.url)
    assert status == 200
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert "page.css" not in text
    assert "page.js" not in text
    assert not re.search(r"(src|href)=\"(?!data:,)", text)
    assert "http" not in text


@pytest.mark.parametrize(
    "headers", [{"host": "evil.example:80"}, {"origin": "http://evil.example"}]
)
def test_strangers_are_refused_in_words(served, headers):
    with pytest.raises(urllib.error.HTTPError) as refused:
        get(served().viewer.url, **headers)
    assert refused.value.code == 403
    assert len(refused.value.read()) > 10


def test_a_page_from_elsewhere_cannot_read_the_stream(served):
    with pytest.raises(InvalidStatus) as refused:
        connect(served().stream, origin="http://evil.example")
    assert refused.value.response.status_code == 403


def test_a_shared_robot_asks_for_its_token(served):
    running = served(address="0.0.0.0")
    assert "?token=" in running.viewer.url
    port = running.viewer.url.split(":")[2].split("/")[0]
    known = running.stream.split("?")[1]
    with pytest.raises(InvalidStatus):
        connect(f"ws://127.0.0.1:{port}/stream?token=wrong")
    with connect(f"ws://127.0.0.1:{port}/stream?{known}") as stream:
        assert stream.recv(timeout=LONG_S)
    with pytest.raises(urllib.error.HTTPError):
        get(f"http://127.0.0.1:{port}/")
    assert get(f"http://127.0.0.1:{port}/?{known}")[0] == 200


def test_twenty_readers_and_one_that_reads_nothing(patient, served):
    running = served(scenes.a_scan(1.0, *((0.001 * k + 1.0, 1.0) for k in range(700))))
    asleep = socket.create_connection(address_of(running))
    asleep.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    asleep.sendall(HANDSHAKE.format(f"127.0.0.1:{address_of(running)[1]}").encode())
    with contextlib.ExitStack() as stack:
        readers = [stack.enter_context(connect(running.stream)) for _ in range(20)]
        end = time.monotonic() + 3.0  # long enough to fill every buffer of who sleeps
        while time.monotonic() < end:
            for reader in readers:
                assert reader.recv(timeout=LONG_S)
        running.viewer.look(running.now)  # the localizer's thread is not held, or this never ends
    begin = time.monotonic()
    running.stop()
    assert time.monotonic() - begin < PING_S
    asleep.close()


def test_it_ends_at_once_whoever_reads(patient):
    with contextlib.ExitStack() as stack:
        with Viewer(scenes.a_scene(), port=0) as viewer:
            stream = viewer.url.replace("http:", "ws:") + "stream"
            for _ in range(3):
                stack.enter_context(connect(stream))
            begin = time.monotonic()
        assert time.monotonic() - begin < PING_S


def test_without_readers_nothing_is_told(monkeypatch):
    scene = scenes.a_scene()
    monkeypatch.setattr(scene, "message", lambda now: pytest.fail("sent to nobody"))
    with Viewer(scene, port=0) as viewer:
        viewer.look(scenes.now(1.0))


def test_a_port_that_is_taken_is_told():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(UserError, match=rf"127\.0\.0\.1:{port}"):
            Viewer(scenes.a_scene(), port=port)


def test_the_python_of_the_documentation_runs(served, capsys):
    (example,) = re.findall(r"```python\n(.*?)```", DOC, re.DOTALL)
    running = served()
    exec(example.replace("ws://127.0.0.1:8737/stream", running.stream), {})
    assert capsys.readouterr().out == 3 * "1: +1.00 +0.50 m, 0.1 s ago\n"


def test_pictures_are_for_who_asks_and_few_a_second():
    scene = scenes.a_scene(pictures=["front", "rear"])
    seen = dataclasses.replace(
        scenes.bearings(1.0, 0.5), ranges=np.array([1.5]), pixels=np.array([[100.0, 50.0]])
    )
    with Viewer(scene, port=0) as viewer:
        stream = viewer.url.replace("http:", "ws:") + "pictures/front"
        viewer.show(b"to nobody", seen)
        with connect(stream) as reader:
            begin, over = time.monotonic(), threading.Event()

            def take_pictures():
                while not over.wait(0.01):
                    viewer.show(b"a jpeg", seen)
                    viewer.show(b"of the other camera", dataclasses.replace(seen, camera="rear"))

            camera = threading.Thread(target=take_pictures)
            camera.start()
            for _ in range(4):
                told = json.loads(reader.recv(timeout=LONG_S))
                assert reader.recv(timeout=LONG_S) == b"a jpeg"
            over.set()
            camera.join()
        assert time.monotonic() - begin > 0.5
    assert told["camera"] == "front"
    assert told["blobs"] == [{"x": 100.0, "y": 50.0, "direction": 0.5, "range": 1.5}]


def test_a_connection_that_says_nothing_does_not_hold_the_end(patient, served):
    running = served()
    silent = socket.create_connection(address_of(running))  # as browsers open some to have them
    with silent, connect(running.stream) as stream:
        stream.recv(timeout=LONG_S)
        begin = time.monotonic()
        running.stop()
    assert time.monotonic() - begin < PING_S
