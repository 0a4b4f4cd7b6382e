"""`swarmloc run` as a person meets it: real processes, real terminals, simulated devices."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner

from host import pipeline
from host.cli.main import main
from host.cli.terminal.signals import signals_caught, signals_end, signals_interrupt
from host.messages import (
    Bearings,
    DeviceBytes,
    DeviceIdentity,
    Displacement,
    Health,
    Scan,
    Truth,
)
from host.recording.content import RecordedEstimate
from host.recording.log import Recording
from host.viewer import server

COMMAND = [sys.executable, "-c", "from host.cli.main import main; main()"]
LONG_S = 40.0  # a bound on waiting, not on speed


def test_without_a_lidar_the_reason_is_on_the_screen_until_it_comes_and_ctrl_c_ends_it(
    on_screen, tmp_path
):
    path = tmp_path / "run.mcap"
    arguments = ("--simulate", "arena4", "--unplug", "lidar=0-1", "--record", str(path))
    screen = on_screen("run", *arguments)
    screen.wait_for(lambda text: "lidar" in text and "no such device is plugged in" in text)
    screen.wait_for(lambda text: re.search(r"lidar +ok +scanning", text))
    screen.wait_for(lambda text: re.search(r"board +ok", text) and re.search(r"camera +ok", text))
    screen.wait_for(lambda text: re.search(r"[1-9] teammates?.*; within 2.0 m: \d estimated", text))
    assert all(len(line) <= 80 for line in screen.lines)
    screen.type(b"\x03")
    assert screen.end() == 0
    assert "Summary" in screen.text
    assert "Traceback" not in screen.written
    assert screen.written.rindex("\x1b[?25h") > screen.written.rindex("\x1b[?25l")

    recording = Recording(path)
    kinds = {type(message) for message in recording.messages()}
    assert kinds == {
        *(Scan, Displacement, Bearings, RecordedEstimate, Truth, Health),
        *(DeviceBytes, DeviceIdentity),
    }
    assert not recording.remarks
    replayed = CliRunner().invoke(main, ["replay", str(path)])
    assert replayed.exit_code == 0, replayed.output
    assert re.search(r"[1-9]\d* bit-identical, 0 different", replayed.output)


def test_a_run_that_is_starved_says_so_instead_of_blaming_devices_and_goes_on(on_screen):
    screen = on_screen("run", "--simulate", "arena4")
    running = re.compile(r"[1-9] teammates?.*; within.* lidar +ok +scanning")
    screen.wait_for(running.search)
    for stopped_s in (0.4, 0.4, 0.4, 0.4, 0.4, 2.0):
        screen.send(signal.SIGSTOP)
        time.sleep(stopped_s)
        screen.send(signal.SIGCONT)
        time.sleep(0.1)
    screen.wait_for(lambda text: "this computer is too slow: swarmloc was paused" in text)
    screen.wait_for(lambda text: running.search(text) and "localizer FAIL" not in text)
    for words in ("check the", "check its", "unplugged", "another model", "cable"):
        assert words not in screen.written
    screen.type(b"\x03")
    assert screen.end() == 0


def test_a_lidar_pulled_out_comes_back(tmp_path):
    figures_path = tmp_path / "figures.json"
    # Again and again: on a busy computer it may not run yet, or stand still until it is back.
    absent = [f"--unplug=lidar={first}-{first + 1.5}" for first in range(4, 50, 6)]
    arguments = [*absent, "--seconds", "60", "--json", str(figures_path)]
    wanted = ["lidar ok: scanning", "lidar FAIL: the connection was lost", "lidar ok: scanning"]
    lines = []
    with subprocess.Popen(
        [*COMMAND, "run", "--simulate", "arena4", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            lines.append(line)
            if wanted and wanted[0] in line:
                wanted.pop(0)
                if not wanted:
                    process.send_signal(signal.SIGTERM)
    assert process.wait(LONG_S) == 0, lines
    assert not wanted, lines
    assert "Summary\n" in lines
    figures = json.loads(figures_path.read_text())["result"]
    # More where a busy computer starves the simulated lidar for a second: silence, to its driver.
    assert figures["devices"]["lidar"]["counts"]["connections"] >= 2
    assert figures["updates"] > 0
    assert figures["teammates_in_range"] <= 3.0


def test_killed_it_leaves_a_recording_that_replays(tmp_path):
    path = tmp_path / "run.mcap"
    process = subprocess.Popen(
        [*COMMAND, "run", "--simulate", "arena4", "--sensors", "lidar", "--record", str(path)],
        stdout=subprocess.DEVNULL,
    )
    end = time.monotonic() + LONG_S
    while not (path.exists() and b"/teammates/markers" in path.read_bytes()):
        assert time.monotonic() < end
        time.sleep(0.05)
    process.kill()
    process.wait(LONG_S)
    assert not any(isinstance(message, Bearings) for message in Recording(path).messages())
    replayed = CliRunner().invoke(main, ["replay", str(path)])
    assert replayed.exit_code == 0, replayed.output
    assert re.search(r"[1-9]\d* bit-identical, 0 different", replayed.output)


@pytest.fixture
def handlers():
    """Gives what handles the signals to end; puts it back."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(number) for number in numbers]
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # tests may run under nohup
    yield lambda: [signal.getsignal(number) for number in numbers]
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)


def test_the_first_signal_is_noted_and_nobody_catches_a_second(handlers):
    before = handlers()
    with signals_caught() as signalled:
        assert not signalled()
    assert handlers() == before
    with signals_caught() as signalled:
        signal.raise_signal(signal.SIGINT)
        assert signalled()
        assert handlers() == 3 * [signal.SIG_DFL]
    # What is left to do after the run may be ended at once, too.
    assert handlers() == 3 * [signal.SIG_DFL]


def test_before_and_after_a_run_each_signal_is_as_ctrl_c(handlers):
    before, numbers = handlers(), (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    for number in numbers:
        with pytest.raises(KeyboardInterrupt), signals_interrupt():
            signal.raise_signal(number)
        assert handlers() == 3 * [signal.SIG_DFL]
        for each, handler in zip(numbers, before, strict=True):
            signal.signal(each, handler)


def test_what_runs_under_nohup_goes_on_without_its_terminal(handlers):
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    for handled in (signals_interrupt, signals_end, signals_caught):
        with handled():
            signal.raise_signal(signal.SIGHUP)
            assert handlers()[2] is signal.SIG_IGN
        assert handlers()[2] is signal.SIG_IGN


def test_while_a_command_is_loaded_each_signal_ends_it(handlers):
    before = handlers()
    with signals_interrupt():
        interrupting = handlers()
        with signals_end():
            assert handlers() == 3 * [signal.SIG_DFL]
        assert handlers() == interrupting
    assert handlers() == before


# Loading, building the simulated board, opening devices, the first pictures, in full swing.
@pytest.mark.parametrize("after_s", [0.1, 0.8, 1.4, 2.0, 3.5])
def test_a_signal_ends_it_at_any_moment(after_s, tmp_path):
    arguments = ["--simulate", "arena4:rendered=1,mocap_hz=100", "--view", "127.0.0.1:0"]
    with subprocess.Popen(
        [sys.executable, "-m", "host.cli", "run", *arguments, "--record", tmp_path / "a.mcap"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "TMPDIR": str(tmp_path)},
    ) as process:
        time.sleep(after_s)
        process.send_signal(signal.SIGINT if after_s == 0.8 else signal.SIGTERM)
        written, _ = process.communicate(timeout=LONG_S)
    assert "did not stop" not in written  # as of what is waited for in vain
    assert "Traceback" not in written
    assert not list(tmp_path.glob("swarmloc-*")), "the simulation leaves its folder behind"


def test_what_waits_at_the_end_waits_for_two_seconds_in_all():
    """As the changelog promises: for devices, for the queue, and for readers of the page."""
    assert pipeline._STOP_S + pipeline._DRAIN_S + server._GOODBYE_S < 2.0


def test_a_second_signal_ends_what_the_first_one_waits_for():
    program = (
        "import time; from host.cli.terminal.signals import signals_caught\n"
        "with signals_caught() as signalled:\n"
        "  print('caught', flush=True)\n"
        "  while True:\n"
        "    time.sleep(0.01); signalled() and print('noted', flush=True)"
    )
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"caught\n"
        process.send_signal(signal.SIGTERM)
        assert process.stdout.readline() == b"noted\n"
        process.send_signal(signal.SIGTERM)
        assert process.wait(LONG_S) == -signal.SIGTERM


@pytest.mark.usefixtures("handlers")
def test_a_signal_takes_no_lock_that_the_thread_it_interrupts_may_hold():
    """It would wait for itself, for ever; taking a lock shows as a call of the interpreter's."""
    taken = []

    def watch(frame, event, argument):
        if event == "c_call" and argument.__name__ in ("acquire", "__enter__"):
            taken.append(argument)

    with signals_caught() as signalled:
        sys.setprofile(watch)
        try:
            signal.raise_signal(signal.SIGTERM)
        finally:
            sys.setprofile(None)
        assert signalled()
    assert not taken


def invoke(*arguments: str):
    return CliRunner().invoke(main, ["run", *arguments])


def test_without_devices_it_goes_on_and_says_what_is_missing(tmp_path: Path):
    robot = tmp_path / "robot.toml"
    robot.write_text('[lidar]\nport = "/dev/no-lidar"\n[board]\nport = "/dev/no-board"\n')
    done = invoke("--robot", str(robot), "--seconds", "0.6")
    assert done.exit_code == 1
    assert "lidar FAIL: cannot open /dev/no-lidar; no such device" in done.output
    assert "board FAIL: cannot open /dev/no-board; no such device" in done.output
    assert "Summary" in done.stdout
    what, why, next_step = done.stderr.splitlines()
    assert what == "swarmloc: nothing was measured"
    assert why == "board: cannot open /dev/no-board; lidar: cannot open /dev/no-lidar"
    assert "--simulate arena4" in next_step


def test_it_ends_after_the_seconds_that_the_scenario_sets(tmp_path: Path):
    figures_path = tmp_path / "figures.json"
    done = invoke("--simulate", "arena4:seconds=2", "--json", str(figures_path))
    assert done.exit_code == 0, done.output
    assert json.loads(figures_path.read_text())["result"]["seconds"] >= 2.0


@pytest.mark.parametrize("sensors", ["lidar+camera", "camera"])
def test_cameras_of_a_real_robot_are_refused_in_words(sensors: str):
    done = invoke("--sensors", sensors)
    assert done.exit_code == 1
    assert "there is no camera to use" in done.stderr


def test_cameras_alone_find_teammates(tmp_path: Path):
    for seconds in (3, 20):  # the first is too short on a busy computer
        figures_path, recording = tmp_path / "figures.json", tmp_path / f"{seconds}.swarmloc"
        done = invoke(
            *("--simulate", f"arena4:seconds={seconds},seed=1", "--sensors", "camera"),
            *("--json", str(figures_path), "--record", str(recording)),
        )
        figures = json.loads(figures_path.read_text())["result"]
        if figures["teammates_reported"] > 0.5:
            break
    assert done.exit_code == 0, done.output
    assert "lidar" not in figures["devices"]
    assert figures["teammates_reported"] > 0.5
    assert Recording(recording).header.sensors == "camera"


def test_bad_use_is_told_with_exit_code_2():
    for arguments in (
        ("--unplug", "lidar=1-2"),
        ("--simulate", "arena4", "--unplug", "lidar"),
        ("--simulate", "arena4", "--unplug", "lidar=3-2"),
        ("--simulate", "arena4", "--unplug", "lidar=x-2"),
        ("--simulate", "arena4", "--seconds", "-1"),
        ("--simulate", "arena4", "--seconds", "nan"),
        ("--simulate", "arena4", "--seconds", "inf"),
        ("--filter", "magic"),
    ):
        done = invoke(*arguments)
        assert done.exit_code == 2, arguments
        assert "Error" in done.stderr


def test_failures_are_told_with_exit_code_1(tmp_path: Path):
    (tmp_path / "there").write_text("")
    for arguments, words in (
        (("--simulate", "atlantis"), "no scenario is called 'atlantis'\nknown: arena4"),
        (("--simulate", "arena4", "--unplug", "fish=1-2"), "cannot unplug 'fish'"),
        (("--simulate", "arena4", "--record", str(tmp_path / "there")), "exists already"),
        (("--simulate", "arena4", "--json", str(tmp_path / "no" / "x")), "there is no folder"),
        (("--robot", str(tmp_path / "none.toml")), "cannot read the configuration"),
    ):
        done = invoke(*arguments)
        assert done.exit_code == 1, done.output
        assert words in done.stderr
        assert "Traceback" not in done.output
