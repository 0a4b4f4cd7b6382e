"""robot.toml: the example says what the code says, and whatever is wrong is told by its line."""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import annotated_types
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from host.config import (
    BlindSector,
    RobotConfig,
    Section,
    load_config,
    parse_config,
    recorded_config,
)
from host.errors import UserError

EXAMPLE = Path(__file__).resolve().parents[2] / "robots" / "cherokey.toml"
SECTIONS = {
    name: field.annotation
    for name, field in RobotConfig.model_fields.items()
    if isinstance(field.annotation, type) and issubclass(field.annotation, Section)
}


def bounds() -> Iterator[tuple[str, str, float, float]]:
    """Section, key, a value just out of range, and the bound it breaks."""
    for section, model in {**SECTIONS, "lidar.blind_sectors": BlindSector}.items():
        for key, field in model.model_fields.items():
            step = 1 if field.annotation is int else 1e-6
            for rule in field.metadata:
                match rule:
                    case annotated_types.Gt(gt=bound):
                        yield section, key, bound, bound
                    case annotated_types.Lt(lt=bound):
                        yield section, key, bound, bound
                    case annotated_types.Ge(ge=bound):
                        yield section, key, bound - step, bound
                    case annotated_types.Le(le=bound):
                        yield section, key, bound + step, bound


def complaint(text: str) -> str:
    with pytest.raises(UserError) as caught:
        parse_config(text, "my.toml")
    return str(caught.value)


def test_the_example_is_the_default() -> None:
    example, default = parse_config(EXAMPLE.read_text()).model_dump(), RobotConfig().model_dump()
    for section, values in default.items():
        assert example[section] == values, f"change [{section}] in {EXAMPLE.name} with config.py"
    assert load_config(EXAMPLE) == RobotConfig() == parse_config("")


def test_the_example_shows_every_setting_and_explains_each() -> None:
    example = tomllib.loads(EXAMPLE.read_text())
    assert set(example) == set(RobotConfig.model_fields)
    for section, model in SECTIONS.items():
        assert set(example[section]) == set(model.model_fields), section
    for line in EXAMPLE.read_text().splitlines():
        if re.match(r"\w+ = ", line):
            assert re.search(r"  # \S+", line), f"no word on: {line}"


def test_a_robot_says_only_what_differs() -> None:
    robot = parse_config('name = "five"\n[wheels]\ntrack_m = 0.2\n[lidar]\nblind_sectors = []\n')
    assert (robot.name, robot.wheels.track_m, robot.lidar.blind_sectors) == ("five", 0.2, ())
    assert robot.wheels.left_radius_m == RobotConfig().wheels.left_radius_m
    assert robot.camera == RobotConfig().camera


def test_a_camera_of_which_a_file_says_little_is_mounted_as_where_it_is_used() -> None:
    text = '[camera.rear]\nsource = "a"\n[mocap.ceiling.eye]\nsource = "b"\nz_m = 3.0\n'
    robot, default = parse_config(text, "robot.toml"), RobotConfig()
    assert robot.camera.rear == default.camera.rear.model_copy(update={"source": "a"})
    eye = default.mocap.ceiling.eye.model_copy(update={"source": "b", "z_m": 3.0})
    assert robot.mocap.ceiling.eye == eye
    assert parse_config("[camera.rear]\nheading_rad = 3.0\n", "r").camera.rear.heading_rad == 3.0


def test_a_configuration_does_not_change() -> None:
    with pytest.raises(ValidationError):
        RobotConfig().wheels.track_m = 1.0


@pytest.mark.parametrize(("section", "key", "value", "bound"), list(bounds()))
def test_out_of_range_names_key_line_and_bound(
    section: str, key: str, value: float, bound: float
) -> None:
    header = f"[[{section}]]" if section == "lidar.blind_sectors" else f"[{section}]"
    message = complaint(f"# a robot\n\n{header}\n{key} = {value!r}\n")
    (line,) = [line for line in message.splitlines() if f"{key} = " in line]
    assert line.startswith("line 4: " + section.partition(".")[0])
    assert any(
        float(number) == bound for number in re.findall(r"-?\d[\d.e-]*", line.split(": ")[-1])
    )


@pytest.mark.parametrize(
    "value", ["nan", "inf", "-inf", "1979-05-27", "[1.0]", "{}", "true", '"0.1"']
)
def test_what_is_no_number_is_refused(value: str) -> None:
    assert "line 2: wheels.track_m = " in complaint(f"[wheels]\ntrack_m = {value}")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "[wheels]\ntrack_cm = 14.4",
            "line 2: wheels.track_cm: no such setting; its unit is wrong: write track_m",
        ),
        (
            "[wheels]\n\ntrakc_m = 0.1",
            "line 3: wheels.trakc_m: no such setting; did you mean track_m?",
        ),
        ("[filters]\ngate = 9.0", "line 1: filters: no such setting; did you mean filter?"),
        ("zzz = 1", "line 1: zzz: no such setting; known here: name, wheels"),
        ('[filter]\nprofile = "pdh"', "line 2: filter.profile = 'pdh'"),
        ("wheels.track_cm = 14.4", "line 1: wheels.track_cm: no such setting; its unit is wrong"),
        ("name = 1\n[a.b]\nx = 1", "line 2: a: no such setting"),
    ],
)
def test_an_unknown_word_is_told_with_its_line_and_a_guess(text: str, words: str) -> None:
    assert words in complaint(text)


def test_shapes_other_than_the_settings_are_told() -> None:
    assert "line 1: wheels must be a table: write [wheels]" in complaint("wheels = 3")
    missing = complaint("[[lidar.blind_sectors]]\ncentre_rad = 0.1")
    assert "line 1: lidar.blind_sectors.0.width_rad is missing" in missing
    assert "line 2: wheels.counts_per_turn = 1920.5" in complaint(
        "[wheels]\ncounts_per_turn = 1920.5"
    )


@pytest.mark.parametrize("device", ["lidar", "board"])
def test_a_port_has_a_name(device: str) -> None:
    assert f"line 2: {device}.port = '': " in complaint(f'[{device}]\nport = ""')


def test_the_line_is_that_of_the_right_block_among_several() -> None:
    good = "[[lidar.blind_sectors]]\ncentre_rad = 0.1\nwidth_rad = 0.1\n"
    message = complaint(
        good + good.replace("0.1\nw", "9.0\nw") + "[board]\ncentre_rad = 1\n" + good
    )
    assert "line 5: lidar.blind_sectors.1.centre_rad = 9.0" in message
    assert "line 8: board.centre_rad: no such setting" in message


def test_every_mistake_is_told_at_once_up_to_five() -> None:
    message = complaint("\n".join(f"{letter} = 1" for letter in "abcdefg"))
    assert message.startswith("my.toml: 7 setting(s)")
    assert len(message.splitlines()) == 7
    assert message.endswith("\nand 2 more")


def test_files_that_cannot_be_read_are_told(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"cannot read .*absent\.toml") as caught:
        load_config(tmp_path / "absent.toml")
    assert "swarmloc init" in caught.value.next_step
    (tmp_path / "binary.toml").write_bytes(b"name = '\xff'")
    with pytest.raises(UserError, match=r"binary\.toml, line 1: no text in UTF-8\nbyte 8"):
        load_config(tmp_path / "binary.toml")
    assert re.search(r"my\.toml is not valid TOML\n.*line 2", complaint("\n[wheels\n"))


names = st.sampled_from(
    ["wheels", "track_m", "lidar", "blind_sectors", "centre_rad", "name", "port", "x", "'a b'", "1"]
)
keys = st.lists(names, min_size=1, max_size=3).map(".".join)
values = st.sampled_from(
    ["1", "-7", "0.1", "true", '"a"', "[]", "[1, {x = 2}]", "{x = 1}", '"""\nx\n"""']
)
lines = st.one_of(
    keys.map("[{}]".format),
    keys.map("[[{}]]".format),
    st.tuples(keys, values).map(" = ".join),
    st.text(max_size=8),
)


@given(st.lists(lines, max_size=6).map("\n".join))
def test_any_text_is_a_configuration_or_a_told_mistake(text: str) -> None:
    told = ""
    try:
        parse_config(text)
    except UserError as error:
        told = str(error)
    last = max(1, len(text.splitlines()))
    assert all(1 <= int(line) <= last for line in re.findall(r"^line (\d+):", told, re.MULTILINE))


def test_a_recording_may_hold_what_filters_had_once_and_nothing_else() -> None:
    old = RobotConfig(name="old").model_dump(mode="json")
    old["filter"] |= {"report_weight": 0.6, "capacity": 3000}
    assert recorded_config(old) == RobotConfig(name="old")
    assert "line 2: filter.report_weight: no such setting" in complaint(
        "[filter]\nreport_weight = 0.6\n"
    )
    with pytest.raises(ValidationError, match="wings"):
        recorded_config({"filter": {"wings": 2}})


def test_a_recording_stays_readable_whose_settings_contradict_each_other() -> None:
    front = {"source": "/dev/video0", "heading_rad": 3.0}
    rear = {"source": "/dev/video0", "heading_rad": 3.0, "centre_x_px": -5.0}
    old = {"camera": {"front": front, "rear": rear}, "wheels": {"track_m": 0.03}}
    with pytest.raises(ValidationError):
        RobotConfig.model_validate(old)
    assert recorded_config(old).camera.rear.centre_x_px == -5.0


def test_a_strip_has_the_size_of_its_pattern_unless_it_is_given() -> None:
    both = [
        parse_config(f'[camera.strip]\npattern = "{pattern}"\ndiameter_m = 0.09\n').camera.strip
        for pattern in ("two_colours", "one_colour")
    ]
    assert [(s.height_m, s.tall_m, s.diameter_m) for s in both] == [
        (0.2, 0.08, 0.09),
        (0.22, 0.04, 0.09),
    ]


def test_a_colour_without_a_pattern_is_that_of_the_thesis_strip() -> None:
    strip = parse_config("[camera.strip]\nhue_deg = 5.0\nheight_m = 0.3\n").camera.strip
    assert (strip.pattern, strip.hue_deg) == ("one_colour", 5.0)
    assert (strip.height_m, strip.tall_m) == (0.3, 0.04)


def test_a_size_without_a_pattern_asks_for_it() -> None:
    said = complaint('name = "a"\n[camera.strip]\nheight_m = 0.3\n')
    assert "line 2: camera.strip: pattern is missing" in said
    assert 'pattern = "one_colour"' in said


def test_a_colour_for_a_strip_of_two_colours_is_a_mistake() -> None:
    said = complaint('[camera.strip]\npattern = "two_colours"\nhue_deg = 5.0\n')
    assert "hue_deg" in said
    assert 'pattern = "one_colour"' in said


@pytest.mark.parametrize("pattern", ["two_colours", "one_colour"])
def test_a_configuration_written_whole_is_read_back(pattern: str) -> None:
    robot = parse_config(f'[camera.strip]\npattern = "{pattern}"\n')
    assert RobotConfig.model_validate(robot.model_dump(mode="json")) == robot


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "[lidar]\nx_m = 0.1\nmin_range_m = 3.0\n",
            "line 3: lidar: min_range_m (3.0) must be less",
        ),
        ("[lidar]\nx_m = 0.1\nmax_range_m = 0.12\n", "line 3: lidar: min_range_m (0.12) must be"),
        (
            "[lidar]\nfield_of_view_rad = 0.5\n"
            "[[lidar.blind_sectors]]\ncentre_rad = 0.2\nwidth_rad = 0.5\n"
            "[[lidar.blind_sectors]]\ncentre_rad = -0.2\nwidth_rad = 0.4\n",
            "blind_sectors hide all of field_of_view_rad",
        ),
        (
            "[lidar]\n"
            + "".join(
                f"[[lidar.blind_sectors]]\ncentre_rad = {c}\nwidth_rad = 1.6\n"
                for c in (0.0, 1.57, 3.14, -1.57)
            ),
            "blind_sectors hide all of field_of_view_rad",
        ),
        (
            "[camera.strip]\npattern = 'two_colours'\nheight_m = 0.02\n",
            "line 3: camera.strip: height",
        ),
        (
            "[mocap]\nturrets = [{body = 1, x_m = 0.0, y_m = 0.0}]\n",
            "[[mocap.turrets]] has bodies 1: each is another teammate's, and 1 is this robot",
        ),
        (
            "[mocap]\n" + "[[mocap.turrets]]\nbody = 2\nx_m = 0.0\ny_m = 0.0\n" * 2,
            "has bodies 2, 2: each is another",
        ),
        ("[mocap.natnet]\ndata_port = 1510\n", "line 2: mocap.natnet: data_port must differ"),
        ("[mocap.natnet]\nmulticast_group = '10.0.0.1'\n", "must be an address of multicast"),
        ("[mocap.ceiling]\ntag_height_m = 2.6\n", "line 2: mocap.ceiling: tag_height_m (2.6) must"),
        ("\ufeffname = 'a'\n", "line 1 begins with a byte-order mark"),
        ("[lidar]\nx_m = 0.1\n\nx_m = 0.2\n", "line 4: lidar.x_m is set twice, first in line 2"),
        ("[lidar]\n[wheels]\n[lidar]\n", "line 3: lidar is set twice, first in line 1"),
        ("[lidar]\nx_m = 0,1\n", "write decimals with a point, as 0.5"),
        ("name = five\n", "write text in quotes"),
        ("a = " + 3000 * "[" + 3000 * "]", "nested hundreds deep"),
        ("x = {" + 2000 * "a={" + 2001 * "}" + "\n", "nested hundreds deep"),
        ('name = "a\\u001b[2J"\n', r"line 1: name: it holds the control character '\x1b'"),
        ('[board]\nport = "a\\u0007"\n', r"line 2: board.port: it holds the control character"),
        ("[[lidar.blind_sectors]]\ncentre_rad = 0.1\ncentre_rad = 0.2\n", "line 3: lidar.blind_"),
        ("name = “five”\n", "write straight quotes"),
        ("name = 'five\n", "the quote at the end is missing"),
        ("[motors]\nleft_reversed = True\n", "write true or false, in small letters"),
        ("[wheels]\ntrack_m = 144 mm\n", "write the number alone"),
        ("[wheels]\ntrack_m = .144\n", "write digits before and after the point"),
        ("[lidar]\nheading_rad = pi/2\n", "write the result"),
        ("wheels:\n  track_m: 0.1\n", "write = between a key and its value"),
        ("[wheels\ntrack_m = 0.1\n", "a ] is missing"),
        ("name = 'a'\n\0", "line 2: this is not a text file"),
        ("[wheels]\ntrack_m = 1" + 400 * "0", "line 2: wheels.track_m = 1000"),
        ("name = 1" + 5000 * "0", "5001 digits"),
        ('"a\\u001b[2J" = 1\n', r"line 1: a\x1b[2J: no such setting"),
        ("track_m = 0.1\n", "it belongs in [wheels]"),
        ("[lidar.blind_sectors]\ncentre_rad = 0.1\n", "write [[lidar.blind_sectors]] above each"),
        ("[lidar]\nblind_sectors = [1]\n", "write [[lidar.blind_sectors]] above its"),
        ('[wheels]\ntrack_m = "144 mm"\n', "must be a number, without quotes and unit"),
        ("[board]\nport = 'a'\n[lidar]\nport = 'a'\n", "line 4: lidar.port is that of board.port"),
        (
            "[camera.front]\nsource = 'a'\n[mocap.ceiling.eye]\nsource = 'a'\n",
            "line 4: mocap.ceiling.eye.source is that of camera.front.source",
        ),
        (
            "[camera.front]\nsource = 'a'\nheading_rad = 3.1\n[camera.rear]\nsource = 'b'\n",
            "both look the same way",
        ),
        ("[wheels]\nleft_radius_m = 0.065\n", "line 2: wheels: left_radius_m (0.065) and"),
        ("[wheels]\ntrack_m = 0.03\n", "line 2: wheels: track_m (0.03) must be more"),
        ("[wheels]\ncounts_per_turn = 48\n", "line 2: wheels: counts_per_turn (48) must be"),
        ("[mocap.natnet]\nserver = '192.168.0.300'\n", "must be the address or the name"),
        (
            "[camera.front]\nwidth_px = 640\ncentre_x_px = 959.5\n",
            "line 3: camera.front: centre_x_px (959.5) must lie in the picture",
        ),
        (f"[link]\nkey = '{300 * 'k'}'\n", "line 2: link.key: must have at most 200 characters"),
        ("[board]\nport = ''\n", "board.port = '': must be text that is not empty"),
        ("[lidar]\nheading_rad = 45\n", "45 deg are 0.785398 rad"),
        ("[wheels]\nleft_radius_m = 32.5\n", "32.5 mm are 0.0325 m"),
        ("[lidar]\ndelay_s = 150\n", "150 ms are 0.15 s"),
        ("[wheels]\ntrack_m = 14.4\n", "14.4 cm are 0.144 m"),
        ("[wheels]\nmax_turn_rate_radps = 180\n", "180 deg/s are 3.14159 rad/s"),
        ("[wheels]\nmax_speed_mps = 400\n", "400 mm/s are 0.4 m/s"),
        ("[lidar]\ndetection_probability = 95\n", "95 % are 0.95"),
        ("[camera]\nsearch_rate_hz = 0.05\n", "a period of 0.05 s is 20 Hz"),
        ("[board]\nreport_rate_hz = 0.02\n", "a period of 0.02 s is 50 Hz"),
        ("[lidar]\nheading_rad = -3.2\n", "-3.2 rad and 3.08319 rad are one direction"),
        ("[camera.strip]\nhue_deg = 360\n", "360 deg and 0 deg are one direction"),
        ("[lidar]\nx = 0.1\n", "its unit is missing: write x_m"),
        ("[lidar]\nblind_sector = []\n", "did you mean blind_sectors?"),
        ("[strip]\ntall_m = 0.1\n", "line 1: strip: no such setting; write [camera.strip]"),
        ("[wheels]\ntrack_m = true\n", "wheels.track_m = true: must be a number"),
        ("[wheels]\ntrack_m = 2026-01-02\n", "wheels.track_m = 2026-01-02: must be a number"),
        ("[lidar]\nx_m = 0.7\n", "line 2: lidar.x_m (0.7) and lidar.y_m (0) are 0.7 m from the"),
        ("[wheels]\ntrack_m = 0.1\n[camera.rear]\nx_m = -0.5\n", "line 4: camera.rear.x_m (-0.5)"),
        ("[wheels]\nmax_speed_mps = 0.8\n", "line 2: wheels.max_speed_mps (0.8) must be motors"),
        ("[wheels]\nmax_turn_rate_radps = 45\n", "it is in rad/s, not deg/s"),
        ("[lidar]\nmin_range_m = 2.0\nhalf_range_m = 1.0\n", "half_range_m (1.0) must be more"),
        ("[lidar]\nrange_noise_m = 0.1\n", "range_noise_m (0.1) must be less than target_diamet"),
        ("[filter]\nsurvival_range_m = 0.12\n", "line 2: filter.survival_range_m (0.12) must be"),
        ("[camera.front]\nfocal_px = 2.8\n", "focal_px (2.8) is too short for 1920 x 1080 px"),
        ("[camera.front]\nlens = 'orthographic'\nk1 = 0.1\n", "line 3: camera.front: k1 and k2"),
        ("[camera.strip]\nhue_deg = 5\nvalue_min = 1\n", "value_min (1) must be less than 1"),
        ("[mocap.ceiling.eye]\ntilt_rad = -1.57\n", "eye.tilt_rad = -1.57: must be greater"),
        ("[mocap]\nsource = 'ceiling'\nbody = 50\n", "4X4_50): its tags are 0 to 49"),
        (
            "[camera]\nmains_hz = 60\n[camera.front]\nsource = 'a'\n[mocap]\nsource = 'ceiling'\n",
            "camera.mains_hz (60) and mocap.ceiling.mains_hz (50) must be equal",
        ),
        ("[link]\nkey = '0123456789abcdef'\naddress = '0.0.0.0'\n", "must be that of a network's"),
        (
            "[mocap]\nsource = 'natnet'\n[link]\nkey = '0123456789abcdef'\nport = 1511\n",
            "line 5: link.port is that of mocap.natnet.data_port, too",
        ),
        ("[mocap.natnet]\nserver = '239.255.42.99'\n", "must be the address or the name"),
        ("[board]\nport = '/dev/ttyACM0 '\n", "begins or ends with a blank"),
        ("[board]\nport = 'none'\n", """'none' must be a path, as "/dev/ttyUSB0", or "auto\""""),
        ("[camera.front]\nsource = '0'\n", """must be a path, as "/dev/video0", or "none\""""),
        ("[board]\nport = '/dev/x'\n[lidar]\nport = '/dev/./x'\n", "line 4: lidar.port is that"),
        ("[lidar]\nx_m = 0.1,\n", "line 2, column 10): remove the comma"),
        ("[lidar]\nx_m =\n", "the value is missing"),
        ("[lidar] x_m = 0.1\n", "write [table] on a line of its own"),
        ("[lidar]]\nx_m = 0.1\n", "write [table], or [[table]] for one of a list"),
        ("name = 'it's'\n", "use the other kind of quotes"),
        ('[board]\nport = "\\\\.\\COM3"\n', "or the text in single quotes"),
        ("[lidar]\nx_m = 0.1 // ahead\n", "write # before a comment"),
        ("[lidar]\nx_m == 0.1\n", "write = between a key and its value"),
        ("[lidar]\nx_m = None\n", "write a number, or leave the line out"),
        ("[lidar]\nblind_sectors = [{centre_rad = 1.0,}]\n", "remove the comma before the }"),
        ("[lidar]\nblind_sectors = [\n", "(at end of document): a ] is missing"),
        ('name = """a\n\n', "line 1: Unterminated string"),
        ("camera.front.k1 = 0.1\n[camera.front]\n", "line 2: camera.front is set twice, first in"),
        ("# \u2028\n[lidar]\nx_m = 7\n", "line 3: lidar.x_m = 7"),
    ],
)
def test_what_cannot_be_meant_is_said_by_its_line_with_a_hint(text: str, words: str) -> None:
    assert words in complaint(text)


@pytest.mark.parametrize("value", ["nan", "inf", "-0.144", "7", "1e30", f"{10**30}"])
def test_another_unit_is_named_only_where_it_fits_the_bounds(value: str) -> None:
    assert " mm are " not in complaint(f"[wheels]\ntrack_m = {value}\n")


def test_the_centre_of_a_lens_is_the_middle_of_its_picture_unless_it_is_given() -> None:
    front = parse_config("[camera.front]\nwidth_px = 640\nheight_px = 480\n").camera.front
    assert (front.centre_x_px, front.centre_y_px) == (319.5, 239.5)


def test_sectors_that_leave_a_view_pass() -> None:
    behind = "[[lidar.blind_sectors]]\ncentre_rad = 3.1\nwidth_rad = 3.0\n"
    assert len(parse_config(f"[lidar]\n{behind}{behind}").lidar.blind_sectors) == 2


sizes = st.floats(0.3, 3.0)  # of the default, of robots from palm to table size


@given(scale=sizes, speed=sizes, ahead=st.floats(-2.0, 2.0), view=st.floats(0.5, 2.0))
def test_a_sensible_robot_of_any_size_is_accepted(
    scale: float, speed: float, ahead: float, view: float
) -> None:
    track = 0.144 * scale
    parse_config(
        f"""
        [wheels]
        track_m = {track}
        left_radius_m = {0.0325 * scale}
        right_radius_m = {0.0325 * scale * 1.02}
        max_speed_mps = {0.4 * speed}
        [motors]
        full_speed_mps = {0.54 * speed}
        [lidar]
        x_m = {ahead * track}
        [camera.front]
        source = "/dev/video0"
        width_px = 640
        height_px = 480
        focal_px = {320 / view}
        x_m = {ahead * track}
        [mocap.ceiling.eye]
        x_m = {5.0 * ahead}
        """
    )


def test_one_device_under_two_names_is_found(tmp_path: Path) -> None:
    (tmp_path / "video0").touch()
    (tmp_path / "by-path").symlink_to("video0")
    sources = [
        f"[camera.{name}]\nsource = '{tmp_path}/{path}'\n"
        for name, path in (("front", "video0"), ("rear", "by-path"))
    ]
    assert "line 4: camera.rear.source is that of camera.front.source" in complaint(
        "".join(sources)
    )


def test_a_file_of_another_kind_is_told(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_bytes("name = 'a'".encode("utf-16"))
    with pytest.raises(UserError, match="it looks like UTF-16"):
        load_config(path)
    with pytest.raises(UserError, match="characters, and no robot"):
        load_config("/dev/zero")
    with pytest.raises(UserError, match="Is a directory"):
        load_config(tmp_path)
    path.write_bytes(b"[lidar]\rx_m = 7\r")
    with pytest.raises(UserError, match=r"line 2: lidar\.x_m"):
        load_config(path)


def test_rates_have_no_unit_of_the_screen():
    for text, bound in (
        ("[lidar]\nrange_steepness_per_m = 900.0\n", "less than 100"),
        ("[camera.front]\nbeyond_noise_per_rad = -1.0\n", "greater than or equal to 0"),
    ):
        with pytest.raises(UserError) as caught:
            parse_config(text, "robot.toml")
        assert caught.value.why.endswith(f"must be {bound}")


def test_the_links_key_is_in_no_error():
    for key in (
        "' 0123456789abcdef'",
        f"'{300 * '0123456789abcdef'}'",
        "'0123456789'",
        "123456789",
    ):
        with pytest.raises(UserError) as caught:
            parse_config(f"[link]\nkey = {key}\n", "robot.toml")
        assert "link.key" in str(caught.value) or "key has" in str(caught.value)
        assert "12345" not in str(caught.value)
