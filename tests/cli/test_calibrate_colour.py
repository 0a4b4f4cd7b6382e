"""`swarmloc calibrate colour`, as a person uses it."""

import json
import tomllib
from pathlib import Path

import click
import cv2
import pytest
from click.testing import CliRunner, Result

from host import config
from host.cli.calibrate import calibrate
from host.cli.main import Commands
from host.config import Cameras, Strip
from tests.perception.drawn_strips import background, draw_pair, draw_strip, encode, place

RED = Cameras(strip=Strip(pattern="one_colour"))
FRONT = RED.front


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    canvas = background(FRONT, 0)
    draw_strip(canvas, RED, FRONT, place(FRONT, 0.3, 0.8))
    path = tmp_path / "front.jpg"
    path.write_bytes(encode(canvas))
    return path


def run(*arguments: str | Path) -> Result:
    assert isinstance(arguments[0], Path)
    robot = arguments[0].parent / "robot.toml"
    robot.write_text('[camera.strip]\npattern = "one_colour"\n', encoding="utf-8")
    return command(*arguments, "--robot", robot)


def command(*arguments: str | Path) -> Result:
    top = Commands("swarmloc", params=[click.Option(["--debug"], is_flag=True)])
    top.add_command(calibrate)
    return CliRunner().invoke(top, ["calibrate", "colour", *map(str, arguments)])


def test_prints_lines_for_robot_toml_and_draws_what_it_finds(picture: Path, tmp_path: Path) -> None:
    output, figures = tmp_path / "seen.png", tmp_path / "colour.json"
    result = run(picture, picture, "--output", output, "--json", figures)
    assert result.exit_code == 0, result.output
    toml = result.output[result.output.index("[camera.strip]") :].split("\n\n")[0]
    strip = config.parse_config(toml).camera.strip
    assert "1 strip; drawn in" in result.output
    told = json.loads(figures.read_text())
    assert told["strip"] == tomllib.loads(toml)["camera"]["strip"]
    assert told["strip"]["saturation_min"] == strip.saturation_min
    (blob,) = told["pictures"][1]["blobs"]
    assert blob["bearing_rad"] == pytest.approx(0.3, abs=0.01)
    for path in (output, tmp_path / "seen-2.png"):
        assert cv2.imread(str(path)).shape == (FRONT.height_px, FRONT.width_px, 3)


def test_a_box_is_taken_for_each_picture(picture: Path, tmp_path: Path) -> None:
    output = tmp_path / "seen.png"
    assert run(picture, "--box", "700,60,200,120", "--output", output).exit_code == 0
    result = run(picture, "--box", "0,900,40,40", "--output", output)
    assert result.exit_code == 1
    assert "no strip's colour" in result.output
    for wrong in ("1,2,3", "a,b,c,d", "1,2,0,4"):
        assert run(picture, "--box", wrong, "--output", output).exit_code == 2
    result = run(picture, picture, "--box", "700,60,200,120", "--output", output)
    assert result.exit_code == 2
    assert "one each, or none" in result.output


def test_a_gap_in_a_picture_is_told_in_words(picture: Path, tmp_path: Path) -> None:
    whole = picture.read_bytes()
    gap = tmp_path / "gap.jpg"
    gap.write_bytes(whole[: len(whole) // 4] + b"\xff\xd9")
    result = run(gap, "--output", tmp_path / "seen.png")
    assert (result.exit_code, "it is torn" in result.output) == (1, True), result.exception


def test_pictures_are_cut_as_those_of_the_camera(picture: Path, tmp_path: Path) -> None:
    """Without an end mark, with filling before a marker, two in one buffer."""
    whole = picture.read_bytes()
    frame = whole.index(b"\xff\xc0")
    for name, data in (
        ("endless", whole[:-2] + bytes(400)),
        ("filled", whole[:frame] + b"\xff\xff" + whole[frame:-2] + b"\xff" + whole[-2:]),
        ("two", whole + whole),
    ):
        path = tmp_path / f"{name}.jpg"
        path.write_bytes(data)
        both = [
            run(one, "--output", tmp_path / "seen.png").output.replace(str(one), "")
            for one in (path, picture)
        ]
        assert "hue_deg = " in both[0]
        assert both[0] == both[1]


def test_pictures_that_cannot_be_used_are_told_in_words(picture: Path, tmp_path: Path) -> None:
    torn = tmp_path / "torn.jpg"
    torn.write_bytes(picture.read_bytes()[:-100])
    small = tmp_path / "small.jpg"
    small.write_bytes(encode(cv2.imread(str(picture))[::2, ::2]))
    for path, words in (
        (torn, "torn"),
        (small, "960 x 540 px"),
        (tmp_path / "absent.jpg", "cannot read"),
    ):
        result = run(path, "--output", tmp_path / "seen.png")
        assert result.exit_code == 1
        assert words in result.output
        assert "Traceback" not in result.output
    result = run(picture, "--output", tmp_path / "no" / "such.png")
    assert (result.exit_code, "cannot write" in result.output) == (1, True)


def test_a_strip_of_two_colours_has_none_to_learn_and_is_shown(tmp_path: Path) -> None:
    canvas = background(FRONT, 0)
    draw_pair(canvas, Cameras(), FRONT, place(FRONT, 0.3, 0.8))
    path, output = tmp_path / "front.jpg", tmp_path / "seen.png"
    path.write_bytes(encode(canvas))
    result = command(path, "--output", output)
    assert result.exit_code == 0, result.output
    assert "no colour to learn" in result.output
    assert f"1 strip; drawn in {output}" in result.output
    assert "hue_deg" not in result.output
