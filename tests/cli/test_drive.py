"""`swarmloc drive` as a person meets it."""

import re

from click.testing import CliRunner

from host.cli.main import main


def test_keys_drive_a_simulated_robot_and_x_ends_it(on_screen):
    screen = on_screen("drive", "--simulate", "arena4:seed=3", "--view", "none")
    screen.wait_for(lambda text: re.search(r"driver +ok +driving", text))
    for _ in range(10):
        screen.type(b"d")
    screen.type(b"x")
    assert screen.end() == 0
    assert "contacts: the robot drove against something 0 times" in screen.text


def test_without_a_terminal_there_are_no_keys_and_live_there_is_one_stack() -> None:
    run = CliRunner().invoke(main, ["drive", "--simulate", "arena4"])
    assert run.exit_code == 1
    assert "not a terminal" in run.output
    run = CliRunner().invoke(main, ["drive", "walk", "--simulate", "arena4:stacks=all"])
    assert run.exit_code == 1
    assert "swarmloc simulate arena4:stacks=all" in run.output


def test_a_scenario_names_its_stacks_and_behaviour() -> None:
    for setting, wanted in (
        ("stacks=some", "none, own, all"),
        ("stacks=all,behaviour=nap", "walk"),
    ):
        run = CliRunner().invoke(main, ["simulate", f"arena4:{setting}", "--output", "no.mcap"])
        assert run.exit_code == 1
        assert wanted in run.output
