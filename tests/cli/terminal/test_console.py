"""The screen: what stands on it, that it fits, and that it is drawn in place."""

import io
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

from host.cli.terminal import console
from host.cli.terminal.console import Console, State, coloured, frame, line
from host.evaluation.truth_scoring import errors_m
from host.messages import Estimate, Health, Named, Now, Truth

LONG_REASON = "cannot open /dev/ttyUSB0\nno such device is plugged in\n" + "check the plug " * 9


def an_estimate(positions, time=1.0, ages=None, labels=None, sigma=0.02):
    positions = np.array(positions, dtype=float).reshape(-1, 2)
    n = len(positions)
    return Estimate(
        time,
        positions,
        np.tile(sigma**2 * np.eye(2), (n, 1, 1)),
        np.full(n, 0.9),
        np.zeros(n) if ages is None else np.array(ages),
        np.arange(1, n + 1) if labels is None else np.array(labels),
    )


def now_known(positions, truth=None, measured=None, **about):
    estimate = an_estimate(positions, **about)
    return Now(estimate, estimate.time if measured is None else measured, truth)


def a_truth(positions, time=1.0):
    positions = np.array(positions, dtype=float).reshape(-1, 2)
    return Truth(time, np.arange(len(positions)), positions)


def a_state(*news):
    state = State("arena4 (simulated)", "phd", "lidar+camera")
    for each in news:
        if isinstance(each, Now):
            state.now = each
        else:
            state.devices[each.device] = each
    return state


def cells(text):
    return text.split()


class Output(io.StringIO):
    def __init__(self, terminal):
        super().__init__()
        self.terminal = terminal

    def isatty(self):
        return self.terminal

    def take(self):
        text = self.getvalue()
        self.seek(0)
        self.truncate()
        return text


def test_a_row_tells_place_distance_bearing_and_error_in_the_units_of_its_heading():
    state = a_state(now_known([[0.3, -0.4]], a_truth([[0.3, -0.38], [9.0, 0.0]]), ages=[0.25]))
    heading, row = (text for text in frame(state, 80)[3:5])
    assert heading.split("  ")[-1].strip() == "error mm"
    assert cells(row) == ["1", "+0.300", "-0.400", "0.500", "-53.1", "20", "0.90", "0.2", "20"]
    assert "1 teammate; within 2.0 m: 1 estimated, 1 true; mean error 20 mm" in frame(state, 80)


def test_without_truth_there_is_no_error():
    text = "\n".join(frame(a_state(now_known([[1.0, 0.0]])), 80))
    assert "error" not in text
    assert "1 teammate\n" in text + "\n"


def test_an_estimate_of_nobody_is_false():
    state = a_state(now_known([[1.0, 0.0], [0.0, 1.0]], a_truth([[1.0, 0.01]])))
    first, second = frame(state, 80)[4:6]
    assert cells(first)[-1] == "10"
    assert cells(second)[-1] == "false"
    errors = errors_m(state.now.estimate, state.now.truth)
    assert errors == pytest.approx([0.01, np.nan], nan_ok=True)


def test_rows_keep_their_order_while_teammates_move():
    state = a_state(now_known([[2.0, 0.0], [1.0, 0.0]], labels=[7, 3]))
    assert [cells(row)[0] for row in frame(state, 80)[4:6]] == ["3", "7"]


def test_both_counts_are_of_the_same_range():
    state = a_state(now_known([[1.0, 0.0], [2.4, 0.0]], a_truth([[1.0, 0.0], [2.41, 0.0]])))
    assert "2 teammates; within 2.0 m: 1 estimated, 1 true; mean error 5 mm" in frame(state, 80)


def test_names_stand_beside_their_rows_and_in_the_count():
    named = {7: Named(2, 0.97, np.radians(35.0)), 3: Named(1, 0.6, -1.0), 99: Named(5, 1.0, 0.0)}
    known = replace(now_known([[2.0, 0.0], [1.0, 0.0], [0.0, 1.0]], labels=[7, 3, 8]), names=named)
    heading, *rows = frame(a_state(known), 100)[3:7]
    assert heading.endswith("heading deg")
    assert [cells(row)[8:] for row in rows] == [["1?", "-57"], ["2", "+35"], []]
    assert "3 teammates (robot 1?, 2)" in line(a_state(known))
    # With the truth beside it a terminal of 80 columns has no room for their headings.
    known = replace(known, truth=a_truth([[2.0, 0.0]]))
    assert [cells(row)[8:] for row in frame(a_state(known), 80)[4:7]] == [
        *(["false", "1?"], ["0", "2"], ["false"])
    ]
    assert max(map(len, frame(a_state(known), 80))) <= 80


def test_silence_is_said_on_the_screen_and_on_a_line():
    state = a_state(now_known([[1.0, 0.0]], time=7.5, measured=6.5))
    state.real_time_factor = 0.3
    assert any("nothing was measured for 1.0 s" in row for row in frame(state, 80))
    assert "real time" not in "".join(frame(state, 80))
    assert "nothing measured for 1.0 s" in line(state)
    state.now = now_known([[1.0, 0.0]], time=7.6, measured=7.4)
    assert "measured" not in "".join([*frame(state, 80), line(state)])


@pytest.mark.parametrize("width", [80, 100, 250])
def test_everything_fits_and_no_word_of_a_reason_is_lost(width):
    positions = np.random.default_rng(1).uniform(-9, 9, (20, 2))
    state = a_state(
        now_known(positions, a_truth(positions), ages=np.full(20, 99.9), sigma=1.5),
        Health(1.0, "localizer", True, "17 updates/s", {}),
        Health(1.0, "lidar", False, LONG_REASON, {}),
    )
    state.seconds, state.real_time_factor = 5999.0, 1.0
    state.title = "a_name_" * 20
    lines = frame(state, width)
    assert max(map(len, lines)) <= min(width, 100)
    told = " ".join(" ".join(lines[-5:]).split())
    assert "lidar FAIL " + "; ".join(LONG_REASON.splitlines()).strip() in told


def test_before_the_first_estimate_it_says_so():
    assert "no estimate yet" in "\n".join(frame(a_state(), 80))
    assert "no teammate in sight" in "\n".join(frame(a_state(now_known([])), 80))
    assert "no estimate yet" in line(a_state())


def test_colours_change_nothing_but_colour():
    state = a_state(
        now_known([[1.0, 0.0], [0.0, 1.0]], a_truth([[1.0, 0.0]]), ages=[0.0, 3.0]),
        Health(1.0, "lidar", False, "gone", {}),
    )
    bright = "\n".join(frame(state, 80, coloured))
    assert "\x1b[31;1m" in bright
    assert re.sub(r"\x1b\[[\d;]*m", "", bright) == "\n".join(frame(state, 80))


@pytest.fixture
def screen_size(monkeypatch):
    def set_size(columns, rows):
        monkeypatch.setenv("COLUMNS", str(columns))
        monkeypatch.setenv("LINES", str(rows))

    set_size(80, 30)
    return set_size


def test_on_a_terminal_it_is_drawn_in_place(screen_size, shown):
    out = Output(terminal=True)
    drawn = Console(State("a title", "phd", "lidar"), out)
    drawn.look(now_known([[1.0, 0.0], [2.0, 0.0]]))
    drawn.take(Health(1.0, "lidar", False, LONG_REASON, {}))
    drawn.draw()
    drawn.look(now_known([[1.5, 0.0]], time=2.0))
    drawn.take(Health(1.0, "lidar", True, "scanning", {}))
    drawn.draw()
    drawn.close()
    text = out.getvalue()
    assert text.count("\x1b[2J") == 1
    assert text.rindex("\x1b[?25h") > text.rindex("\x1b[?25l")
    lines = shown(text)
    assert lines[0] == "swarmloc   a title"
    assert lines[4].startswith("  1  +1.500")
    assert "".join(lines).count("teammate") == 1
    assert "plug" not in "".join(lines)


def test_a_low_window_is_not_scrolled(screen_size, shown):
    screen_size(80, 10)
    out = Output(terminal=True)
    drawn = Console(State("a title", "phd", "lidar"), out)
    drawn.look(now_known(np.random.default_rng(1).uniform(-2, 2, (20, 2))))
    drawn.draw()
    drawn.draw()
    lines = shown(out.getvalue(), rows=10)
    assert lines[0] == "swarmloc   a title"
    assert "make the window taller" in lines[8]


def test_no_colour_where_it_is_not_wanted(screen_size, monkeypatch):
    for value, coloured_ in (("", True), ("1", False)):
        monkeypatch.setenv("NO_COLOR", value)
        out = Output(terminal=True)
        Console(State("a title", "phd", "lidar"), out).draw()
        assert ("\x1b[1m" in out.getvalue()) == coloured_


def test_elsewhere_it_is_a_line_a_second_and_one_a_change():
    now = [100.0]
    out = Output(terminal=False)
    drawn = Console(State("a title", "phd", "lidar"), out, clock=lambda: now[0])
    drawn.look(now_known([[1.0, 0.0]]))
    drawn.take(Health(1.0, "lidar", True, "scanning at 7.0 revolutions/s", {}))
    drawn.draw()
    assert out.take() == "swarmloc   a title\n    0.0 s  lidar ok: scanning at 7.0 revolutions/s\n"
    drawn.take(Health(1.0, "lidar", True, "scanning at 7.1 revolutions/s", {}))
    drawn.draw()
    assert out.take() == ""
    now[0] = 101.0
    drawn.draw()
    assert out.take() == "    1.0 s  1 teammate\n"
    drawn.take(Health(1.0, "lidar", False, "gone\nplug it in", {}))
    drawn.draw()
    assert out.take() == "    1.0 s  lidar FAIL: gone; plug it in\n"
    drawn.close()
    assert out.take() == ""


def test_after_a_standstill_there_is_one_line_not_one_for_each_second_missed():
    now = [0.0]
    out = Output(terminal=False)
    drawn = Console(State("a title", "phd", "lidar"), out, clock=lambda: now[0])
    for now[0] in (1.0, 100.0, 100.2, 100.4, 101.0):
        drawn.draw()
    assert [text.split()[0] for text in out.take().splitlines()[1:]] == ["1.0", "100.0", "101.0"]


def test_the_pace_is_measured_time_over_the_clocks(screen_size, shown):
    now = [0.0]
    out = Output(terminal=True)
    state = State("a title", "phd", "lidar")
    drawn = Console(state, out, clock=lambda: now[0])
    for k in range(20):
        now[0] = 0.5 * k
        drawn.look(now_known([[1.0, 0.0]], time=0.25 * k))
        drawn.draw()
    assert state.real_time_factor == pytest.approx(0.5)
    assert "real time x0.50" in "\n".join(shown(out.getvalue()))
    assert console.FRAME_S <= 0.2


def test_a_shared_address_is_a_code_that_a_phone_reads():
    address = "http://192.168.4.7:8737/?token=Kq3_x-9"
    lines = frame(State("a title", "phd", "lidar", address), 80)
    halves = {"█": (255, 255), "▀": (255, 0), "▄": (0, 255), " ": (0, 0)}
    code = [line for line in lines if line and set(line) <= set(halves)]
    modules = np.array([[halves[letter] for letter in line] for line in code], dtype=np.uint8)
    picture = modules.transpose(0, 2, 1).reshape(2 * len(code), -1).repeat(8, 0).repeat(8, 1)
    assert cv2.QRCodeDetector().detectAndDecode(picture)[0] == address
    local = frame(State("a title", "phd", "lidar", "http://127.0.0.1:8737/"), 80)
    assert not any("█" in line for line in local)
