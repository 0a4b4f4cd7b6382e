"""`swarmloc drive` as a person meets it."""

import json
import math
import re
import signal
import time
from pathlib import Path

import pytest
from click.testing import CliRunner
from websockets.sync.client import connect

from host.cli.main import main

LONG_S = 40.0  # a bound on waiting, not on speed


def test_keys_drive_a_simulated_robot_and_x_ends_it(on_screen):
    screen = on_screen("drive", "--simulate", "arena4:seed=3", "--view", "none")
    screen.wait_for(lambda text: re.search(r"driver +ok +driving", text))
    for _ in range(10):
        screen.type(b"d")
    screen.type(b"x")
    assert screen.end() == 0
    assert "contacts: the robot drove against something 0 times" in screen.text


def test_without_a_terminal_there_are_no_keys() -> None:
    run = CliRunner().invoke(main, ["drive", "--simulate", "arena4"])
    assert run.exit_code == 1
    assert "not a terminal" in run.output


@pytest.mark.parametrize(
    ("command", "scenario"),
    [
        ("drive walk", "arena4:stacks=all"),
        ("drive formation circle", "formation6"),
        ("run", "arena4:stacks=all"),
        ("run", "formation6"),
        ("run", "arena4:stacks=own"),
        ("doctor", "arena4:stacks=all"),
    ],
)
def test_robots_on_their_own_stacks_are_not_simulated_live(command: str, scenario: str) -> None:
    run = CliRunner().invoke(main, [*command.split(), "--simulate", scenario])
    assert run.exit_code == 1
    assert f"swarmloc simulate {scenario} --output FILE" in run.output.replace("\n", " ")


def test_a_scenario_names_its_stacks_and_behaviour() -> None:
    for setting, wanted in (
        ("stacks=some", "none, own, all"),
        ("stacks=all,behaviour=nap", "walk"),
    ):
        run = CliRunner().invoke(main, ["simulate", f"arena4:{setting}", "--output", "no.mcap"])
        assert run.exit_code == 1
        assert wanted in run.output


def test_a_walk_and_a_drive_to_calibrate_by_end_after_their_seconds(tmp_path: Path) -> None:
    figures = tmp_path / "walk.json"
    common = ["--simulate", "arena4:seed=3", "--seconds"]
    run = CliRunner().invoke(
        main, ["drive", "walk", *common, "2.5", "--view", "none", "--json", str(figures)]
    )
    assert run.exit_code == 0, run.output
    assert "the robot drove against something 0 times" in run.output
    assert "driver" in json.loads(figures.read_text())["result"]["devices"]
    recording = tmp_path / "drive.mcap"
    run = CliRunner().invoke(
        main, ["drive", "calibration", *common, "2", "--record", str(recording)]
    )
    assert run.exit_code == 0, run.output
    assert "next: swarmloc calibrate wheels" in run.output
    assert recording.stat().st_size > 1000


def test_driving_by_the_page_needs_the_page_and_the_lidar() -> None:
    for options, wanted in (
        (["--view", "none"], "leave --view none out"),
        (["--sensors", "camera"], "needs the lidar"),
    ):
        run = CliRunner().invoke(main, ["run", "--simulate", "--drive", *options])
        assert run.exit_code == 2
        assert wanted in run.output


def test_who_has_the_address_with_the_token_drives_by_the_page(on_screen) -> None:
    room = "arena4:robots=1,posts=0,side_m=6,seed=3"
    screen = on_screen("run", "--simulate", room, "--drive", "--view", "127.0.0.1:0")
    screen.wait_for(lambda text: re.search(r"driver +ok +driving", text))
    address = re.search(r"http://(\S+/)(\?token=\S+)", screen.text)
    assert address is not None
    server, token = address.groups()
    with (
        connect(f"ws://{server}stream{token}") as stream,
        connect(f"ws://{server}drive{token}") as hand,
    ):
        begin = end = json.loads(stream.recv(timeout=LONG_S))["pose"]
        until = time.monotonic() + LONG_S
        while math.hypot(end["x"] - begin["x"], end["y"] - begin["y"]) < 0.05:
            assert time.monotonic() < until
            for _ in range(5):
                hand.send('{"ahead": 1, "left": 0}')
                time.sleep(0.03)
            end = json.loads(stream.recv(timeout=LONG_S))["pose"]
    screen.send(signal.SIGINT)
    assert screen.end() == 0
