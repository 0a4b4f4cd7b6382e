"""`swarmloc map`: pictures of both maps, and how wrong they are."""

import json
from pathlib import Path

import cv2
from click.testing import CliRunner

from host.cli.main import main


def test_a_map_without_teammates_is_less_wrong(tmp_path: Path) -> None:
    output, figures = tmp_path / "room.png", tmp_path / "room.json"
    source = "arena4:seed=1,seconds=12,standing=2"
    result = CliRunner().invoke(main, ["map", source, str(output), "--json", str(figures)])
    assert result.exit_code == 0, result.output
    found = json.loads(figures.read_text())["result"]
    without, whole = found["without teammates"], found["with teammates"]
    assert without["wrong"] < whole["wrong"]
    assert without["known"] > 2000
    for path in (output, tmp_path / "room-with-teammates.png"):
        picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        assert min(picture.shape) > 3.0 / 0.05
        assert set(picture.flat) == {0, 160, 255}


def test_a_map_is_a_png(tmp_path: Path) -> None:
    result = CliRunner().invoke(main, ["map", "arena4", str(tmp_path / "room.svg")])
    assert result.exit_code == 2
    assert "room.png" in result.output
