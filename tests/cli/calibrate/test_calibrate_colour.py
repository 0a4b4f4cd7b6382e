"""`swarmloc calibrate colour`, as a person uses it."""

import json
import tomllib
from pathlib import Path

import click
import cv2
import numpy as np
import pytest
from click.testing import CliRunner, Result

from host import config
from host.cli.calibrate.calibrate import calibrate
from host.cli.main import Commands
from host.config import Cameras, Strip
from tests.perception.strips.drawn_strips import (
    background,
    draw_coat,
    draw_pair,
    draw_strip,
    encode,
    pixel_of,
    place,
)

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
    assert isinstance(arguments[0], Path)
    arguments = (*arguments, "--report", arguments[0].parent / "colour.html")
    top = Commands("swarmloc", params=[click.Option(["--debug"], is_flag=True)])
    top.add_command(calibrate)
    return CliRunner().invoke(top, ["calibrate", "colour", *map(str, arguments)])


def test_prints_lines_for_robot_toml_and_draws_what_it_finds(picture: Path, tmp_path: Path) -> None:
    output, figures = tmp_path / "seen.png", tmp_path / "colour.json"
    result = run(picture, picture, "--output", output, "--json", figures)
    assert result.exit_code == 0, result.output
    toml = (tmp_path / "robot.toml").read_text(encoding="utf-8")
    assert set(result.output.split("[camera.strip]\n")[1].splitlines()[:5]) <= set(
        toml.splitlines()
    )
    strip = config.parse_config(toml).camera.strip
    assert "1 strip; drawn in" in result.output
    told = json.loads(figures.read_text())["result"]
    assert told["strip"] == tomllib.loads(toml)["camera"]["strip"]
    assert told["passed"]
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
    x, y = pixel_of(np.append(place(FRONT, 0.3, 0.8), 0.2), FRONT)
    box = f"{round(x) - 50},{round(y) - 60},100,120"
    good = command(path, "--output", output, "--box", box)
    assert (good.exit_code, "1 of 1 strips found" in good.output) == (0, True), good.output
    bad = command(path, "--output", output, "--box", "100,300,60,60")
    assert bad.exit_code == 1
    assert "false detections of strips" in bad.output
    assert "not found" in bad.output


def test_the_verdict_counts_strips_and_what_is_none(picture: Path, tmp_path: Path) -> None:
    """Two strips and a red sheet that looks like one, by the places at which they are drawn."""
    canvas = background(FRONT, 0)
    for bearing, distance in ((0.3, 0.8), (-0.7, 1.2)):
        draw_strip(canvas, RED, FRONT, place(FRONT, bearing, distance))
    path, output = tmp_path / "two.jpg", tmp_path / "seen.png"
    path.write_bytes(encode(canvas))
    boxes = [box_around(0.3, 0.8), box_around(-0.7, 1.2)]
    both = run(path, "--box", "+".join(boxes), "--output", output)
    assert (both.exit_code, "2 of 2 strips found" in both.output) == (0, True), both.output
    one = run(path, "--box", boxes[0], "--output", output)
    assert one.exit_code == 1
    assert "false detections of strips" in one.output
    assert "hue_deg" not in (tmp_path / "robot.toml").read_text(encoding="utf-8")
    assert is_yellow(output, box_around(-0.7, 1.2))
    assert run(path, "--box", boxes[0], "--output", output, "--accept").exit_code == 0
    assert "hue_deg" in (tmp_path / "robot.toml").read_text(encoding="utf-8")
    empty = run(path, "--box", f"{boxes[0]}+{box_around(-1.1, 1.2)}", "--output", output)
    assert (empty.exit_code, "not found" in empty.output) == (1, True), empty.output


def test_a_wall_in_the_strips_colour_is_refused_and_shown(tmp_path: Path) -> None:
    canvas = background(FRONT, 0)
    draw_strip(canvas, RED, FRONT, place(FRONT, 0.3, 0.8))
    draw_coat(canvas, FRONT, place(FRONT, -0.8, 2.0), (0.0, 0.6), 1.5)
    path, output = tmp_path / "wall.jpg", tmp_path / "seen.png"
    path.write_bytes(encode(canvas))
    result = run(path, "--box", box_around(0.3, 0.8), "--output", output)
    assert result.exit_code == 1
    assert "background in its colour" in result.output
    assert is_yellow(output, box_around(-0.8, 1.3))


def box_around(bearing: float, distance: float) -> str:
    x, y = pixel_of(np.append(place(FRONT, bearing, distance), RED.strip.height_m), FRONT)
    return f"{round(x) - 50},{round(y) - 40},100,80"


def is_yellow(path: Path, box: str) -> bool:
    left, top, width, height = map(int, box.split(","))
    seen = cv2.imread(str(path))[top : top + height, left : left + width].astype(int)
    blue, green, red = seen[..., 0], seen[..., 1], seen[..., 2]
    return bool(((green > blue + 100) & (red > blue + 100)).any())
