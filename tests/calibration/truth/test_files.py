"""Files of true paths, in the forms in which people have them; read right, or refused in words."""

import math

import numpy as np
import pytest

from host.calibration.truth.files import body_of, read_truth
from host.errors import UserError
from host.recording.elsewhere.named_columns import BodyPath, Units, units_of

PLAIN = "time,x,y,heading\n0.0,1.0,2.0,0.5\n0.1,1.5,2.0,0.6\n0.2,,,\n0.3,1.7,2.1,0.7\n"
EXPORT = (
    "Format Version,1.23,Take Name,made up,Capture Frame Rate,100.000000,Export Frame Rate,"
    "100.000000,Total Exported Frames,{frames},Rotation Type,Quaternion,Length Units,Millimeters,"
    "Coordinate Space,Global\n\n,Type"
    + ",Rigid Body" * 7
    + "\n,Name"
    + ",r1" * 7
    + "\n,ID"
    + ",7" * 7
    + "\n,,"
    + "Rotation," * 4
    + "Position,Position,Position\n"
    "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z\n{rows}"
)


def export(*rows):
    return EXPORT.format(frames=len(rows), rows="".join(f"{row}\n" for row in rows))


# Motive's y is up: a heading of 90 deg is a rotation about y; the floor's y is Motive's -z.
ROWS = (
    "100,1.000000,0.0,0.0,0.0,1.0,1000.0,80.0,-2000.0",
    "101,1.010000,0.0,0.707107,0.0,0.707107,1010.0,80.0,-2000.0",
    "102,1.020000,0.0,0.0,0.0,0.0,0.0,0.0,0.0",
    "103,1.030000,,,,,,,",
    "104,1.040000,0.0,-0.707107,0.0,0.707107,1020.0,80.0,-2000.0",
)


@pytest.fixture
def file(tmp_path):
    def write(text, encoding="utf-8"):
        path = tmp_path / "truth.csv"
        path.write_bytes(text.encode(encoding))
        return path

    return write


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("cells", [",", ";", "\t", "decimal commas"])
def test_named_columns_in_every_form(file, cells, encoding):
    text = PLAIN.replace(",", ";").replace(".", ",") if cells == "decimal commas" else PLAIN
    text = text if cells == "decimal commas" else text.replace(",", cells)
    (path,) = read_truth(file(text, encoding), Units())
    assert path.times.tolist() == [0.0, 0.1, 0.3]
    assert path.poses.tolist() == [[1.0, 2.0, 0.5], [1.5, 2.0, 0.6], [1.7, 2.1, 0.7]]


def test_units_bodies_comments_and_other_columns(file):
    text = "# a tracker\nHeading, quality ,BODY,Time,Y,X\n90,1,a,1000,20,10\n-90,1,b,1000,40,30\n"
    first, second = read_truth(file(text), units_of("ms,cm,deg"))
    assert (first.name, second.name) == ("a", "b")
    assert first.times.tolist() == [1.0]
    assert first.poses[0] == pytest.approx([0.1, 0.2, math.pi / 2.0])
    assert second.poses[0] == pytest.approx([0.3, 0.4, -math.pi / 2.0])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no column is called time"),
        ("time,x,y\n0,0,0\n", "no column is called heading"),
        ("time,x,x,y,heading\n", "more than one column is called x"),
        ("time,x,y,heading\n", "no line with numbers"),
        ("time,x,y,heading\n0,0,0,0\n0,1,1,1\n", "line 3 .*\n.*that of the line before\n.*rounded"),
        ("time,x,y,heading\n1,0,0,0\n0,1,1,1\n", "line 3 .*\n.*does not come after"),
        ("time,x,y,heading\n0,0,zero,0\n", "line 2 .*\ny is no number: 'zero'"),
        ("time,x,y,heading\n0,0,0\n", "line 2 .*\n.*3 of 4 cells"),
        ("time,x,y,heading\n0,00,1,20,1,35,0,01\n", "8 of 4 cells: do decimals stand after"),
        ("0.0,1.0,2.0,0.1\n0.1,1.0,2.0,0.1\n", "no column is called time"),
        ("time [h],x,y,heading\n0,0,0,0\n", "no column is called time\n.*time .h., x"),
    ],
)
def test_what_is_wrong_with_named_columns_is_named(file, text, words):
    with pytest.raises(UserError, match=words):
        read_truth(file(text), Units())


@pytest.mark.parametrize(
    "head",
    [
        "time [ms],x [cm],y [cm],heading [deg]",
        "Time (ms), X (cm), Y (cm), Heading (deg)",
        "time_ms,x_cm,y_cm,heading_deg",
        "NO_OF_FRAMES,3\n\nA tracker's export\ntime [ms],x [cm],y [cm],heading [deg]",
    ],
)
def test_units_beside_the_names(file, head):
    (path,) = read_truth(file(f"{head}\n1000,20,10,90\n"), Units())
    assert path.times.tolist() == [1.0]
    assert path.poses[0] == pytest.approx([0.2, 0.1, math.pi / 2.0])


@pytest.mark.parametrize("lost", ["0,0,0", "NA,NA,NA", "-,-,-", "nan,nan,nan", "1,inf,0", ",,"])
def test_rows_without_the_body_are_left_out(file, lost):
    text = f"time,x,y,heading\n0.0,1,2,3\n0.1,{lost}\n0.2,1,2,3\n"
    (path,) = read_truth(file(text), Units())
    assert path.times.tolist() == [0.0, 0.2]


@pytest.mark.parametrize("above", ["# of today\n", "\n", ",,,\n"])
def test_a_take_is_recognized_under_what_was_written_above_it(file, above):
    (body,) = read_truth(file(above + export(*ROWS)), Units())
    assert len(body.times) == 3


@pytest.mark.parametrize("text", ["s,m", "s,m,turns", "h,m,rad", "s,m,rad,x"])
def test_units_that_nobody_knows_are_refused(text):
    with pytest.raises(ValueError, match="as s,mm,deg"):
        units_of(text)


@pytest.mark.parametrize("change", ["none", "utf-16", "spreadsheet"])
def test_an_excerpt_of_a_take_without_its_lost_frames(file, change):
    text = export(*ROWS)
    if change == "spreadsheet":
        text = text.replace(",", ";").replace(".", ",")
    path = file(text, "utf-16" if change == "utf-16" else "utf-8")
    (body,) = read_truth(path, Units())
    assert body.name == "r1"
    assert body.times.tolist() == [1.0, 1.01, 1.04]
    assert body.poses[:, 0] == pytest.approx([1.0, 1.01, 1.02])
    assert body.poses[:, 1] == pytest.approx(2.0)
    assert body.poses[:, 2] == pytest.approx([0.0, math.pi / 2.0, -math.pi / 2.0], abs=1e-5)


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (("1,0.01,0,0,0,0.5,0,0,0",), "frame 1: the rotation of Rigid Body r1 is none"),
        (("1,0,01,0,0,0,0,0,0,1,0,0,0,0,0,0",), "decimals stood after commas"),
    ],
)
def test_what_cannot_be_a_take_is_refused(file, rows, words):
    with pytest.raises(UserError, match=words):
        read_truth(file(export(*rows)), Units())


def test_a_take_with_z_up_is_recognized(file):
    rows = [f"{k},{0.01 * k:.2f},0,0,0,1,{100 * k},{200 * k},80" for k in range(9)]
    (body,) = read_truth(file(export(*rows)), Units())
    assert body.poses[:, :2] == pytest.approx(np.outer(np.arange(9), [0.1, 0.2]))


def test_a_body_that_is_not_there_is_answered_with_those_that_are(file):
    text = "time,x,y,heading,body\n0,0,0,0,a\n0,1,1,0,b\n"
    paths = read_truth(file(text), Units())
    assert body_of(paths, "b", "f.csv").name == "b"
    for name in ("", "c", "B"):
        with pytest.raises(UserError, match="bodies: a, b"):
            body_of(paths, name, "f.csv")
    robots = [BodyPath(name, path.times, path.poses) for path in paths for name in ("A", "robot_2")]
    with pytest.raises(UserError, match=r"f\.csv:robot_2"):
        body_of(robots, "robot 2", "f.csv")


VICON = (
    "{kind}\n100\n,,Global Angle Robot1:Robot1,,,,,,Global Angle Box:Box,,,,,\n"
    "Frame,Sub Frame,RX,RY,RZ,TX,TY,TZ,RX,RY,RZ,TX,TY,TZ\n"
    ",,{angle},{angle},{angle},mm,mm,mm,{angle},{angle},{angle},mm,mm,mm\n"
    "1,0,0.01,0.02,0.5,1000,2000,90,0,0,0,1,2,3\n"
    "2,0,0.01,0.02,0.6,1010,2000,90,,,,,,\n"
    "3,0,0,0,0,0,0,0,0,0,0,1,2,3\n"
    "4,0,0.01,0.02,-3.1,1020,2001,90,0,0,0,1,2,3\n"
    "\nTrajectories\n100\n,,M1,,\nFrame,Sub Frame,X,Y,Z\n,,mm,mm,mm\n1,0,1,2,3\n"
)


@pytest.mark.parametrize("kind", ["Objects", "Segments"])
@pytest.mark.parametrize(("angle", "unit"), [("rad", 1.0), ("deg", math.pi / 180.0)])
@pytest.mark.parametrize("cells", [",", ";", "\t"])
def test_an_export_of_vicon(file, kind, angle, unit, cells):
    text = VICON.format(kind=kind, angle=angle).replace(",", cells)
    robot, box = read_truth(file(text, "utf-8-sig"), Units())
    assert (robot.name, box.name) == ("Robot1", "Box")
    assert robot.times == pytest.approx([0.01, 0.02, 0.04])
    assert robot.poses[:, :2] == pytest.approx(np.array([[1.0, 2.0], [1.01, 2.0], [1.02, 2.001]]))
    assert robot.poses[:, 2] == pytest.approx(np.array([0.5, 0.6, -3.1]) * unit)
    assert len(box.times) == 3


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("\n100\n", "\n\n"), "line 2 .*(.|\n)*frame rate is missing"),
        (("Objects", "Trajectories"), "no poses of bodies(.|\n)*objects of Tracker"),
        (("1010,2000", "1010,?"), "line 7 (.|\n)*no numbers"),
        (("0.01,0.02", "1.57,0.02"), "does not stand upright(.|\n)*90 deg"),
        ((",RZ,TX", ",R,TX"), "has no rotation"),
        (
            (",,Global Angle Robot1:Robot1,,,,,,Global Angle Box:Box", ""),
            "line 3 .*(.|\n)*the bodies' names are missing",
        ),
    ],
)
def test_what_is_wrong_with_an_export_of_vicon_is_named(file, change, words):
    with pytest.raises(UserError, match=words):
        read_truth(file(VICON.format(kind="Objects", angle="rad").replace(*change)), Units())


def qualisys(title="{name} X", matrix=True, time=True):
    """Two bodies by QTM, the first by headings of 0.5, lost, -2.5 rad; tilted by 5 deg."""
    lines = ["NO_OF_FRAMES\t3", "NO_OF_BODIES\t2", "FREQUENCY\t100", "DESCRIPTION\t--"]
    lines += [
        "TIME_STAMP\t2026-01-22, 17:47:17\t22107.9",
        "DATA_INCLUDED\t6D",
        "BODY_NAMES\tr1\tr2",
    ]
    rest = ["Y", "Z", "Roll", "Pitch", "Yaw", "Residual", *(f"Rot[{k}]" for k in range(9))]
    rest = rest if matrix else rest[:6]
    columns = ["Frame", *["Time"] * time]
    for name in ("r1", "r2"):
        columns += [*title.format(name=name).split("|"), *rest]
    lines.append("\t".join(columns))
    for k, heading in enumerate((0.5, math.nan, -2.5)):
        tilt = math.radians(5.0)
        about_x, about_z = (
            np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
            for a in (tilt, heading)
        )
        about_z = about_z[[1, 2, 0]][:, [1, 2, 0]]
        angles = [math.degrees(tilt), 0.0, math.degrees(heading)]
        cells = [1000.0 + k, -500.0, 80.0, *angles, 0.4]
        cells += (about_x @ about_z).T.ravel().tolist() if matrix else []
        cells = ["0.000" if math.isnan(heading) else f"{cell:.5f}" for cell in cells]
        lines.append("\t".join([str(k + 1), *[f"{0.01 * k:.5f}"] * time, *cells, *cells]))
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("title", ["{name} X", "X", "{name}|X"])
@pytest.mark.parametrize("matrix", [True, False])
@pytest.mark.parametrize("time", [True, False])
def test_an_export_of_qualisys(file, title, matrix, time):
    bodies = read_truth(file(qualisys(title, matrix, time)), Units())
    assert [body.name for body in bodies] == ["r1", "r2"]
    for body in bodies:
        assert body.times == pytest.approx([0.0, 0.02])
        assert body.poses[:, :2] == pytest.approx(np.array([[1.0, -0.5], [1.002, -0.5]]))
        assert body.poses[:, 2] == pytest.approx([0.5, -2.5], abs=4e-3)


@pytest.mark.parametrize("wrong", ["mirrored", "inf", "nan", "1e300"])
def test_what_is_no_rotation_is_no_pose(file, wrong):
    *head, first, lost, last = qualisys().splitlines()
    cells = first.split("\t")
    for column in (9, 12, 15):  # Rot's first row, of body r1
        cells[column] = f"{-float(cells[column]):.5f}" if wrong == "mirrored" else wrong
    text = "\n".join([*head, "\t".join(cells), lost, last]) + "\n"
    body, other = read_truth(file(text), Units())
    assert body.times == pytest.approx([0.02])
    assert other.times == pytest.approx([0.0, 0.02])


def test_an_infinite_angle_of_vicon_is_no_pose(file):
    text = VICON.format(kind="Objects", angle="rad").replace("0.02,0.6", "0.02,inf")
    assert read_truth(file(text), Units())[0].times == pytest.approx([0.01, 0.04])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("BODY_NAMES", "MARKER_NAMES"), "no poses of bodies(.|\n)*6DOF data"),
        (("r2\n", "r2\tr3\n"), "X, Y, Z of 2 of 3 bodies"),
        (("1002.00000", "?"), "line 11 (.|\n)*no number"),
        (("Yaw", "Y_"), "has no rotation"),
    ],
)
def test_what_is_wrong_with_an_export_of_qualisys_is_named(file, change, words):
    with pytest.raises(UserError, match=words):
        read_truth(file(qualisys(matrix=False).replace(*change)), Units())


def test_what_is_no_text_is_answered_with_all_forms(tmp_path):
    (tmp_path / "picture.csv").write_bytes(bytes(range(256)))
    with pytest.raises(UserError, match="Motive, Vicon or QTM, a CSV with named columns, or a ROS"):
        read_truth(tmp_path / "picture.csv", Units())
