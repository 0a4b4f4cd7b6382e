"""Driving by the live page: who may, one at a time, and what stops the robot."""

import json
import socket
import time
import urllib.parse

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from host.behaviour.interface import STILL
from host.behaviour.stick import FASTEST_MPS, FASTEST_RADPS, SILENT_S, Stick
from tests.behaviour.situations import situation

LONG_S = 20.0  # a bound on waiting, not on speed


class Noting(Stick):
    """A stick that notes what was done with it."""

    def __init__(self) -> None:
        super().__init__()
        self.moves: list[tuple[float, float, float]] = []
        self.released = 0

    def move(self, ahead: float, left: float, time: float) -> None:
        self.moves.append((ahead, left, time))
        super().move(ahead, left, time)

    def release(self) -> None:
        self.released += 1
        super().release()

    @property
    def wanted(self):
        return self.command(situation(time=time.monotonic()))


def wait_for(true) -> None:
    end = time.monotonic() + LONG_S
    while not true():
        assert time.monotonic() < end
        time.sleep(0.005)


def drive(running, origin=None):
    address = running.stream.replace("/stream", "/drive")
    return connect(address, origin=origin)


def held(ahead, left=0.0) -> str:
    return json.dumps({"ahead": ahead, "left": left})


def test_the_robot_drives_while_a_page_says_so_and_stops_with_its_connection(served) -> None:
    stick = Noting()
    running = served(stick=stick)
    with drive(running) as page:
        page.send(held(0.5, -1))
        wait_for(lambda: stick.moves)
        assert stick.moves[-1][:2] == (0.5, -1.0)
        # Long silent by now, or not: it stops in any case.
        assert stick.command(situation(time=stick.moves[-1][2] + SILENT_S)) == STILL
        page.send(held(0, 0))
        wait_for(lambda: stick.released == 1)
        assert stick.wanted == STILL
        page.send(held(1))
        wait_for(lambda: len(stick.moves) == 2)
    wait_for(lambda: stick.released == 2)  # the socket was closed, with the stick held
    with drive(running) as page:
        page.send(held(1))
        wait_for(lambda: len(stick.moves) == 3)
        page.socket.shutdown(socket.SHUT_RDWR)  # no goodbye
        wait_for(lambda: stick.released == 3)
        assert stick.wanted == STILL


@pytest.mark.parametrize(
    "wrong",
    ["", "[]", "{}", "drive", '{"ahead": 1}', '{"ahead": "1", "left": 0}', held(float("nan")),
     held(float("inf")), held(1.01), held(True), '{"ahead": 1e999, "left": 0}', "[" * 1000,
     '{"ahead": null, "left": 0}'],
)  # fmt: skip
def test_what_is_no_place_of_a_stick_lets_go_of_it(served, wrong: str) -> None:
    stick = Noting()
    with drive(served(stick=stick)) as page:
        page.send(held(1))
        page.send(wrong)
        assert json.loads(page.recv(timeout=LONG_S))["error"].startswith("not done")
        assert stick.wanted == STILL
        assert stick.released == 1
        assert len(stick.moves) == 1


def test_one_page_steers_until_it_lets_go(served) -> None:
    stick = Noting()
    running = served(stick=stick)
    with drive(running) as first, drive(running) as second:
        for _ in range(3):  # a busy computer may be slower than a stick is silent
            first.send(held(1))
            wait_for(lambda: stick.moves and stick.moves[-1][0] == 1.0)
            second.send(held(-1))
            if "another page steers" in second.recv(timeout=LONG_S):
                break
        assert stick.moves[-1][0] == 1.0
        first.send(held(0))
        wait_for(lambda: stick.released)
        second.send(held(-1))
        wait_for(lambda: stick.moves[-1][0] == -1.0)
        released = stick.released
        first.send(held(0))  # what it does not hold it cannot release
        first.ping().wait(LONG_S)
        assert stick.released == released


@pytest.mark.parametrize(
    ("change", "origin"),
    [
        (lambda address: address.partition("?")[0], None),
        (lambda address: address[:-1] + ("A" if address[-1] != "A" else "B"), None),
        (lambda address: address.replace("127.0.0.1", "robot.localhost"), None),
        (lambda address: address, "http://evil.example"),
        (lambda address: address, "null"),
    ],
)
def test_only_who_holds_the_token_drives_on_this_computer_too(served, change, origin) -> None:
    running = served(stick=Stick())
    address = running.stream.replace("/stream", "/drive")
    assert "token=" in address
    there = socket.create_connection(("127.0.0.1", urllib.parse.urlsplit(address).port))
    with there, pytest.raises(InvalidStatus) as refused:
        connect(change(address), origin=origin, sock=there)
    assert refused.value.response.status_code == 403


def test_without_drive_there_is_no_stick(served) -> None:
    running = served()
    assert "token" not in running.viewer.url
    with pytest.raises(InvalidStatus) as refused:
        drive(running)
    assert refused.value.response.status_code == 404


@pytest.fixture
def page(served, browser):
    """A page with a stick: the stick it moves, its middle in pixels, the browser's protocol."""
    stick = Noting()
    browser.driver.get(served(stick=stick).viewer.url)
    middle = browser.wait_for(
        "(() => { const r = document.getElementById('stick').getBoundingClientRect();"
        " return scene && [r.left + r.width / 2, r.top + r.height / 2, r.height / 2]; })()"
    )
    return stick, middle, lambda command, **values: browser.driver.execute_cdp_cmd(command, values)


def still(stick: Noting) -> bool:
    return stick.wanted == STILL and stick.released > 0


def test_the_mouse_holds_the_stick_and_lets_go(page) -> None:
    stick, (x, y, radius), ask = page
    mouse = {"button": "left", "buttons": 1, "clickCount": 1}
    ask("Input.dispatchMouseEvent", type="mousePressed", x=x, y=y - 0.5 * radius, **mouse)
    # A held mouse tells nothing: the page says it again.
    wait_for(lambda: len(stick.moves) >= 3)
    assert stick.moves[-1][:2] == pytest.approx((0.5, 0.0), abs=0.05)
    ask("Input.dispatchMouseEvent", type="mouseMoved", x=x - 3 * radius, y=y, **mouse)
    wait_for(lambda: stick.moves[-1][:2] == pytest.approx((0.0, 1.0), abs=0.05))
    ask("Input.dispatchMouseEvent", type="mouseReleased", x=0, y=0, button="left", buttons=0)
    wait_for(lambda: still(stick))


def test_a_finger_holds_it_and_a_hidden_page_lets_go(page, browser) -> None:
    stick, (x, y, radius), ask = page
    ask(
        "Input.dispatchTouchEvent", type="touchStart", touchPoints=[{"x": x, "y": y + 0.8 * radius}]
    )
    wait_for(lambda: stick.moves and stick.moves[-1][:2] == pytest.approx((-0.8, 0.0), abs=0.05))
    before = browser.driver.current_window_handle
    browser.driver.switch_to.new_window("tab")
    try:
        wait_for(lambda: still(stick))
    finally:
        browser.driver.close()
        browser.driver.switch_to.window(before)
        ask("Input.dispatchTouchEvent", type="touchCancel", touchPoints=[])


def test_arrow_keys_hold_it_where_it_has_the_focus(page, browser) -> None:
    stick, _, ask = page
    browser.driver.execute_script("document.getElementById('stick').focus()")
    key = {"key": "ArrowUp", "code": "ArrowUp", "windowsVirtualKeyCode": 38}
    ask("Input.dispatchKeyEvent", type="keyDown", **key)
    wait_for(lambda: stick.moves and stick.moves[-1][:2] == (1.0, 0.0))
    assert browser.driver.execute_script("return view.y") == 0  # the map stays
    ask("Input.dispatchKeyEvent", type="keyUp", **key)
    wait_for(lambda: still(stick))


def test_speeds_are_what_the_documentation_says() -> None:
    assert (FASTEST_MPS, FASTEST_RADPS) == (0.2, 1.5)
