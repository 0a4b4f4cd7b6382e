"""robot.toml with fitted values: nothing else in it changes, and what it says stays true."""

import difflib
import functools
import math
import stat
import tomllib
from pathlib import Path
from typing import Any

import hypothesis
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.calibration.robot_file import update, updated
from host.config import parse_config
from host.errors import UserError

CHEROKEY = (Path(__file__).parents[2] / "robots" / "cherokey.toml").read_text(encoding="utf-8")
NOTE = "lidar calibrated 2026-11-22 from run.mcap: rms 2.1 mm over 812 pairs"
FITTED = {
    "lidar.heading_rad": 0.0523598,
    "lidar.x_m": 0.01012345678,
    "camera.front.tilt_rad": 0.80123,
}
SETTINGS = {
    "wheels.left_radius_m": st.floats(0.022, 0.048),
    "wheels.counts_per_turn": st.integers(960, 100_000),
    "lidar.heading_rad": st.floats(-math.pi, math.pi),
    "lidar.delay_s": st.floats(0.0, 1.0),
    "lidar.clutter_per_m2": st.floats(1e-6, 99.0),
    "camera.rear.tilt_rad": st.floats(-math.pi / 2, math.pi / 2),
    "camera.rear.k1": st.floats(-0.9, 0.9),
    "camera.front.focal_px": st.floats(180.0, 9000.0),
    "lidar.blind_sectors": st.lists(
        st.fixed_dictionaries(
            {
                "centre_rad": st.floats(-math.pi, math.pi),
                "width_rad": st.floats(0.001, 0.8),
            }
        ),
        max_size=7,
    ),
}


def changes(before: str, after: str) -> tuple[list[str], list[str]]:
    """Lines that went, lines that came."""
    lines = list(difflib.ndiff(before.splitlines(), after.splitlines()))
    gone, new = ([line[2:] for line in lines if line.startswith(sign)] for sign in ("- ", "+ "))
    return gone, new


def test_only_the_lines_of_the_settings_change_and_a_note_comes_to_each_table() -> None:
    gone, new = changes(CHEROKEY, updated(CHEROKEY, FITTED, NOTE))
    assert gone == [
        "x_m = 0.0                      # m, its centre ahead of the robot's origin",
        "heading_rad = 0.0              # rad, direction of its own zero in the robot frame",
        "tilt_rad = 0.7854              # rad, downward: 45 deg",
    ]
    assert new == [
        f"# {NOTE}",
        "x_m = 0.0101235                # m, its centre ahead of the robot's origin",
        "heading_rad = 0.0523598        # rad, direction of its own zero in the robot frame",
        f"# {NOTE}",
        "tilt_rad = 0.80123             # rad, downward: 45.9 deg",
    ]
    lines = updated(CHEROKEY, FITTED, NOTE).split("\n")
    assert lines[lines.index(f"# {NOTE}") - 1].startswith("[lidar] ")


def test_a_note_takes_the_place_of_the_earlier_one_of_its_kind_and_of_no_other() -> None:
    other = "detection calibrated 2026-11-21 from other.mcap: 4 sectors"
    first = updated(updated(CHEROKEY, FITTED, NOTE), {"lidar.half_range_m": 2.9}, other)
    later = NOTE.replace("22", "23").replace("812", "90")
    second = updated(first, FITTED, later)
    assert changes(first, second) == ([f"# {NOTE}"] * 2, [f"# {later}"] * 2)
    assert second.count(other) == 1
    assert updated(second, FITTED, later) == second


def test_a_value_that_stays_leaves_its_line() -> None:
    text = CHEROKEY.replace("x_m = 0.0  ", "x_m = 0.00 ")
    assert changes(text, updated(text, {"lidar.x_m": 0.0}, NOTE)) == ([], [f"# {NOTE}"])


def test_pillars_keep_their_comments_and_the_degrees_in_them_are_told_anew() -> None:
    sectors = [{"centre_rad": c, "width_rad": 0.1047} for c in (0.8, 2.3562, -2.3562, -0.75)]
    gone, new = changes(CHEROKEY, updated(CHEROKEY, {"lidar.blind_sectors": sectors}, NOTE))
    assert len(gone) == 2
    assert new == [
        f"# {NOTE}",
        "centre_rad = 0.8               # rad, bearing of the pillar's middle: 45.8 deg",
        "centre_rad = -0.75             # rad, -43.0 deg",
    ]


@pytest.mark.parametrize("count", [0, 1, 3, 6])
def test_pillars_come_and_go(count: int) -> None:
    sectors = [{"centre_rad": 0.25 * k, "width_rad": 0.01} for k in range(count)]
    new = updated(CHEROKEY, {"lidar.blind_sectors": sectors}, NOTE)
    assert tomllib.loads(new)["lidar"]["blind_sectors"] == sectors
    head, _, tail = CHEROKEY.partition("[[lidar")
    assert changes(head, new)[0] == []
    assert new.endswith("\n\n[camera] " + tail.partition("\n[camera] ")[2])
    again = updated(new, {"lidar.blind_sectors": sectors + sectors}, NOTE)
    assert tomllib.loads(again)["lidar"]["blind_sectors"] == sectors + sectors


@pytest.mark.parametrize(
    ("comment", "told"),
    [
        ("rad, 3 deg", "rad, 57.3 deg"),  # 0.0524 rad
        ("rad, 3.00 deg by the plan", "rad, 57.30 deg by the plan"),
        ("rad, at most 90 deg", "rad, at most 90 deg"),
        ("rad, 13 deg, 3 degrees", "rad, 13 deg, 3 degrees"),
    ],
)
def test_a_comment_is_told_anew_only_where_it_repeated_the_value(comment: str, told: str) -> None:
    text = f"[lidar]\nheading_rad = 0.05236  # {comment}\n"
    new = updated(text, {"lidar.heading_rad": 1.00007}, "")
    assert new == f"[lidar]\nheading_rad = 1.00007  # {told}\n"


def test_a_file_without_the_tables_gets_them() -> None:
    settings = {
        "camera.delay_s": 0.2,
        "lidar.blind_sectors": [{"centre_rad": 0.5, "width_rad": 0.1}],
        "lidar.x_m": 0.03,
        "wheels.counts_per_turn": np.int64(1921),
    }
    text = 'name = "mine"\n\n[lidar]\ny_m = 0.01 # measured\n\n[camera.front]\nk1 = 0.01'
    assert updated(text, settings, NOTE).split("\n") == [
        'name = "mine"',
        "",
        "[lidar]",
        f"# {NOTE}",
        "x_m = 0.03",
        "y_m = 0.01 # measured",
        "",
        "[camera.front]",
        "k1 = 0.01",
        "",
        "[camera]",
        f"# {NOTE}",
        "delay_s = 0.2",
        "",
        "[[lidar.blind_sectors]]",
        "centre_rad = 0.5",
        "width_rad = 0.1",
        "",
        "[wheels]",
        f"# {NOTE}",
        "counts_per_turn = 1921",
        "",
    ]


@hypothesis.settings(max_examples=30)
@given(st.fixed_dictionaries({}, optional=SETTINGS), st.booleans(), st.booleans())
def test_the_new_file_says_what_the_old_one_said_but_for_the_settings(
    settings: dict[str, Any], windows: bool, bare: bool
) -> None:
    text = "[wheels]\ntrack_m = 0.2\n\n[lidar]\nblind_sectors = []\n" if bare else CHEROKEY
    text = text.replace("\n", "\r\n") if windows else text
    new = updated(text, settings, NOTE)
    assert new.count("\r\n") == (new.count("\n") if windows else 0)
    assert updated(new, settings, NOTE) == new
    before, after = parse_config(text).model_dump(), parse_config(new).model_dump()
    for key, value in settings.items():
        *tables, last = key.split(".")
        functools.reduce(dict.__getitem__, tables, before)[last] = value
    assert flat(after) == pytest.approx(flat(before), rel=1e-5, abs=1e-12)


def flat(tree: Any, name: str = "") -> dict[str, Any]:
    """Every value of nested tables by its dotted name; words by themselves."""
    if not isinstance(tree, dict | list | tuple):
        return {name: tree} if isinstance(tree, int | float) else {f"{name}={tree}": 0}
    items = tree.items() if isinstance(tree, dict) else enumerate(tree)
    return {
        key: value for part, inner in items for key, value in flat(inner, f"{name}.{part}").items()
    }


@pytest.mark.parametrize(
    ("text", "count", "new"),
    [
        ("", 0, "[lidar]\nblind_sectors = []\n"),
        (
            "[[lidar.blind_sectors]]\ncentre_rad = 0.1\nwidth_rad = 0.2\n# of x\n"
            "[lidar]\nx_m = 0.2",
            0,
            "# of x\n[lidar]\nblind_sectors = []\nx_m = 0.2\n",
        ),
        (
            "[lidar]\nblind_sectors = [\n  {centre_rad = 0.1, width_rad = 0.2},\n]  # all\n",
            0,
            "[lidar]\nblind_sectors = []  # all\n",
        ),
        (
            "[lidar]\nx_m = 0.0\n# end\n",
            1,
            "[lidar]\nx_m = 0.0\n# end\n\n"
            "[[lidar.blind_sectors]]\ncentre_rad = 0.5\nwidth_rad = 0.1\n",
        ),
    ],
)
def test_other_lines_stay_wherever_the_pillars_are(text: str, count: int, new: str) -> None:
    settings = {"lidar.blind_sectors": [{"centre_rad": 0.5, "width_rad": 0.1}] * count}
    assert updated(text, settings, "") == new


def test_angles_at_their_bound_stay_inside() -> None:
    for angle in (math.pi, -math.pi):
        text = updated(CHEROKEY, {"lidar.heading_rad": angle}, NOTE)
        assert abs(parse_config(text).lidar.heading_rad - angle) < 1e-5
    text = updated(CHEROKEY, {"camera.front.tilt_rad": math.pi / 2}, NOTE)
    assert abs(parse_config(text).camera.front.tilt_rad - math.pi / 2) < 1e-5


def test_the_file_changes_at_once_and_keeps_its_permissions(tmp_path: Path) -> None:
    path, link = tmp_path / "robot.toml", tmp_path / "link.toml"
    path.write_bytes(CHEROKEY.replace("\n", "\r\n").encode())
    path.chmod(0o640)
    link.symlink_to(path)
    update(link, FITTED, NOTE)
    assert path.read_bytes() == updated(CHEROKEY, FITTED, NOTE).replace("\n", "\r\n").encode()
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert link.is_symlink()
    assert sorted(tmp_path.iterdir()) == [link, path]


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        ({"lidar.x_m": 5.0}, "lidar.x_m = 5.0"),
        ({"lidar.x_m": math.nan}, "lidar.x_m"),
        (
            {"lidar.blind_sectors": [{"centre_rad": 9.0, "width_rad": 0.1}]},
            "blind_sectors.0.centre",
        ),
        ({"lidar.heading_deg": 5.0}, "write heading_rad"),
    ],
)
def test_a_value_out_of_bounds_is_named_and_the_file_left_alone(
    tmp_path: Path, settings: dict[str, Any], named: str
) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(CHEROKEY)
    with pytest.raises(UserError, match=r"stays as it was") as caught:
        update(path, settings, NOTE)
    assert named in str(caught.value)
    assert path.read_text() == CHEROKEY
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    "text", ["lidar = {x_m = 0.1}\n", "lidar.x_m = 0.1\n", "[camera]\nfront.k1 = 0.1\n"]
)
def test_a_layout_without_headers_is_refused_in_words(text: str) -> None:
    with pytest.raises(UserError, match=r"its own header"):
        updated(text, FITTED, NOTE)


def test_a_file_that_cannot_be_written_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(CHEROKEY)

    def full(*arguments: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    with pytest.raises(UserError, match=r"(?s)cannot write.*No space left"):
        update(path, FITTED, NOTE)
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_text() == CHEROKEY


def test_a_file_that_is_read_only_stays_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(CHEROKEY)
    path.chmod(0o444)
    with pytest.raises(UserError, match=r"(?s)cannot write.*read-only.*chmod u\+w"):
        update(path, FITTED, NOTE)
    assert path.read_text() == CHEROKEY


def test_a_note_is_one_line_whatever_is_in_it() -> None:
    note = "calibrated 2026-11-22 from a\nb\x00\udc80.mcap # rms"
    new = updated(CHEROKEY, {"lidar.x_m": 0.1}, note)
    assert changes(CHEROKEY, new)[1][0] == "# calibrated 2026-11-22 from a b  .mcap # rms"
    new.encode("utf-8")
