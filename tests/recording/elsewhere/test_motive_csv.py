import csv
import functools
from datetime import datetime

import numpy as np
import pytest

from host.errors import UserError
from host.recording.elsewhere import motive_csv

EXPORTS = [
    "motive_csv/euler_m_v1.21.csv",
    "motive_csv/quaternion_mm_v1.23.csv",
    *(
        f"optiodom/{session}/{session}_run-0{run}_opti.csv".replace(f"/{session}_", f"/{name}_", 1)
        for session, name in (
            ("circular/231220200146", "231220200146"),
            ("free/030120210001", "030120210001"),
            ("square/231220200048", "231220200048"),
        )
        for run in (1, 2)
    ),
]
UNITS = {"Meters": 1.0, "Centimeters": 0.01, "Millimeters": 0.001}


def turn(axis, degrees):
    """Rotation matrices (n, 3, 3) about one axis, element by element."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    matrices = np.zeros((len(degrees), 3, 3))
    k = "XYZ".index(axis)
    a, b = (k + 1) % 3, (k + 2) % 3
    matrices[:, k, k] = 1.0
    matrices[:, a, a], matrices[:, b, b], matrices[:, b, a], matrices[:, a, b] = c, c, s, -s
    return matrices


def matrix(quaternions):
    """Rotation matrices (n, 3, 3) of quaternions x, y, z, w, by q v q*."""
    v, w = quaternions[:, :3], quaternions[:, 3:]
    columns = []
    for k in range(3):
        e = np.broadcast_to(np.eye(3)[k], v.shape)
        columns.append(e + 2.0 * np.cross(v, np.cross(v, e) + w * e))
    return np.stack(columns, axis=-1)


@pytest.fixture(scope="module")
def take_of(recorded):
    """Reads each recorded export once."""
    return functools.cache(lambda name: motive_csv.read_take(recorded(name)))


@pytest.mark.parametrize("name", EXPORTS)
def test_recorded_exports_are_read_to_the_last_cell(name, recorded, take_of):
    take = take_of(name)
    with recorded(name).open(newline="") as file:
        rows = [row for row in csv.reader(file) if row]
    header = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    kinds, names, quantities, axes = rows[1], rows[2], rows[4], rows[5]
    cells = np.array([[float(cell or "nan") for cell in row] for row in rows[6:]])
    assert cells.shape == (int(header["Total Exported Frames"]), len(axes))
    np.testing.assert_array_equal(take.frames, cells[:, 0])
    np.testing.assert_array_equal(take.times, cells[:, 1])
    assert take.rate_hz == float(header["Export Frame Rate"])

    unit = UNITS[header["Length Units"]]
    bodies = {body.name: body for body in take.bodies}
    markers = {(marker.kind, marker.name): marker for marker in take.markers}
    angles = {}
    for column in range(2, len(axes)):
        kind, thing, quantity, axis = (row[column] for row in (kinds, names, quantities, axes))
        found = bodies[thing] if kind == "Rigid Body" else markers[kind, thing]
        values = cells[:, column]
        if quantity == "Position":
            expected = found.positions[:, "XYZ".index(axis)]
            np.testing.assert_array_equal(values * unit, expected)
        elif quantity == "Marker Quality":
            np.testing.assert_array_equal(values, found.qualities)
        elif quantity in ("Mean Marker Error", "Error Per Marker"):
            np.testing.assert_array_equal(values * unit, found.errors)
        elif header["Rotation Type"] == "Quaternion":
            np.testing.assert_array_equal(values, found.quaternions[:, "XYZW".index(axis.upper())])
        else:
            angles[axis] = values
    for body in take.bodies:
        np.testing.assert_array_equal(body.tracked, np.isfinite(body.positions).all(axis=1))
        if angles:
            first, second, third = (turn(axis, angles[axis]) for axis in header["Rotation Type"])
            expected = first @ second @ third
            seen = body.tracked
            np.testing.assert_allclose(matrix(body.quaternions[seen]), expected[seen], atol=1e-9)


@pytest.mark.parametrize("name", EXPORTS[2::2])
def test_a_bodys_markers_stand_still_in_its_frame(name, take_of):
    """That Euler angles are about turning axes: the other way they move by millimetres."""
    take = take_of(name)
    (body,) = take.bodies
    back = np.swapaxes(matrix(body.quaternions[body.tracked]), 1, 2)
    for marker in take.markers:
        if marker.kind == "Rigid Body Marker":
            arm = (marker.positions - body.positions)[body.tracked]
            local = np.einsum("nij,nj->ni", back, arm)
            assert local.std(axis=0).max() < 2e-6


def test_what_the_recorded_exports_say(take_of):
    takes = [take_of(name) for name in EXPORTS[:3]]
    assert [take.start for take in takes] == [
        datetime(2024, 4, 10, 15, 35, 10, 906000),
        datetime(2024, 5, 10, 11, 31, 19, 221000),
        datetime(2020, 12, 23, 2, 40, 55, 189000),
    ]
    assert [take.header["Take Name"] for take in takes][1] == "Take 2024-05-10 11.31.19 AM"
    assert [[body.name for body in take.bodies] for take in takes] == [
        ["Rigid Body 1"],
        ["drone"],
        ["robot-diff"],
    ]
    assert [len(take.markers) for take in takes] == [0, 0, 8]
    assert [len(take.times) for take in takes] == [1932, 9420, 11714]


def export(version="1.25", rotation="Quaternion", units="Centimeters", timecode=False):
    """The lines of a small export: two bodies (the second is lost in frame 1) and a marker."""
    header = (
        f"Format Version,{version},Take Name,t,Capture Frame Rate,120,Export Frame Rate,60.0,"
        "Capture Start Time,2024-01-02 12.00.00.500 AM,Total Frames in Take,6,"
        f"Total Exported Frames,3,Rotation Type,{rotation},Length Units,{units},"
        "Coordinate Space,Global"
    )
    axes = "XYZW" if rotation == "Quaternion" else rotation
    counts = (len(axes) + 4, len(axes) + 4, 3)
    things = ("Rigid Body", "a", "A1"), ("Rigid Body", "b", "B2"), ("Marker", "m", "C3")

    def row(label, index):
        cells = [
            cell
            for thing, count in zip(things, counts, strict=True)
            for cell in [thing[index]] * count
        ]
        return ["", label, *cells]

    rows = [row("Type", 0), row("Name", 1), row("ID", 2)]
    if version == "1.25":
        rows.append(["", "Parent", *[""] * sum(counts)])
    body = ["Rotation"] * len(axes) + ["Position"] * 3 + ["Mean Marker Error"]
    rows.append(["", "", *body, *body, *["Position"] * 3])
    rows.append(["Frame", "Time (Seconds)", *([*axes, *"XYZ", ""] * 2), *"XYZ"])
    turned = ["0", "0.6", "0", "0.8"] if rotation == "Quaternion" else ["10", "20", "30"]
    for k in range(3):
        seen = [*turned, "100", "20", str(k), "0.5"]
        other = [""] * len(seen) if k == 1 else seen
        rows.append([str(2 * k), f"{k / 60:.6f}", *seen, *other, "1", "", "3"])
    if timecode:
        for number, each in enumerate(rows):
            first = len(rows) - 4
            each.insert(2, "" if number < first else "TimeCode" if number == first else "1:2:3.4")
    if version in ("1.2", "1.21"):
        for each in rows[:4]:
            each[1] = ""
        rows[-4][1] = "Time"
    return [header, "", *(",".join(each) for each in rows)]


@pytest.fixture
def read(tmp_path):
    def written(lines):
        path = tmp_path / "take.csv"
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return motive_csv.read_take(path)

    return written


@pytest.mark.parametrize("version", ["1.2", "1.21", "1.22", "1.23", "1.24", "1.25"])
@pytest.mark.parametrize("timecode", [False, True])
def test_each_format(version, timecode, read):
    take = read(export(version, timecode=timecode))
    assert take.rate_hz == 60.0
    assert take.start == datetime(2024, 1, 2, 0, 0, 0, 500000)
    assert take.frames.tolist() == [0, 2, 4]
    a, b = take.bodies
    assert (a.name, a.identity, b.name, b.identity) == ("a", "A1", "b", "B2")
    np.testing.assert_allclose(a.positions[:, 2], [0.0, 0.01, 0.02])
    np.testing.assert_allclose(a.quaternions, [[0, 0.6, 0, 0.8]] * 3)
    np.testing.assert_allclose(a.errors, 0.005)
    assert b.tracked.tolist() == [True, False, True]
    assert np.isnan(b.quaternions[1]).all()
    (m,) = take.markers
    np.testing.assert_allclose(m.positions, [[0.01, np.nan, 0.03]] * 3)


@pytest.mark.parametrize("order", ["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"])
@pytest.mark.parametrize("units", UNITS)
def test_each_order_of_rotation_and_each_unit(order, units, read):
    body = read(export(rotation=order, units=units)).bodies[0]
    first, second, third = (
        turn(axis, np.array([angle])) for axis, angle in zip(order, (10, 20, 30), strict=True)
    )
    np.testing.assert_allclose(matrix(body.quaternions)[:1], first @ second @ third, atol=1e-12)
    np.testing.assert_allclose(body.positions[0], np.array([100, 20, 0]) * UNITS[units])


@pytest.mark.parametrize("cells", [1, 3])
@pytest.mark.parametrize("first", [0, 2, 8])
def test_cells_that_a_spreadsheet_appends_are_no_columns(cells, first, read):
    lines = export()
    padded = [line + "," * cells * (k >= first) for k, line in enumerate(lines)]
    take, plain = read(padded), read(lines)
    assert [body.name for body in take.bodies] == [body.name for body in plain.bodies]
    np.testing.assert_array_equal(take.bodies[1].positions, plain.bodies[1].positions)


def without(lines, quantity, axis):
    """The lines without the first column of that quantity and axis."""
    rows = [line.split(",") for line in lines[2:]]
    column = next(
        k for k, (what, along) in enumerate(zip(rows[4], rows[5], strict=True))
        if (what, along) == (quantity, axis)
    )  # fmt: skip
    for row in rows:
        del row[column]
    return [*lines[:2], *(",".join(row) for row in rows)]


def edited(old, new, line=0):
    lines = export()
    assert old in lines[line]
    lines[line] = lines[line].replace(old, new, 1)
    return lines


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (export()[:-1], ["holds 2 frames, but should hold 3", "copy or export it again"]),
        ([*export()[:-1], export()[-1][:30]], ["line 11 is cut", "of 21 cells"]),
        (export("1.1"), ["format 1.1 is not understood", "1.2 to 1.25"]),
        (export("2.0"), ["format 2.0 is not understood", "export the take again"]),
        (without(export(), "Position", "Z"), ["Position Z of Rigid Body a is missing"]),
        (without(export(), "Rotation", "W"), ["Rotation W of Rigid Body a is missing"]),
        (edited("Time (Seconds)", "Clock", 7), ["the column Time is missing"]),
        (edited("Frame", "Number", 7), ["no row of column names"]),
        (edited(",Name,", ",Title,", 3), ["the row with the name of each column is missing"]),
        (edited("Quaternion", "Axis"), ["Rotation Type is Axis", "Quaternion"]),
        (edited("Centimeters", "Inches"), ["Length Units is Inches", "Millimeters"]),
        (edited("Global", "Local"), ["Coordinate Space is Local"]),
        (edited("Mean Marker Error", "Mass", 6), ["the column mass", "is not understood"]),
        (edited("B2", "A1", 4), ["Rigid Body", "missing"]),
        (edited("100", "1x0", 9), ["line 10, column 7: '1x0' is no number"]),
        (edited("2,", "0,", 9), ["frames are not in order"]),
        ([*export(), "", *export()], ["line 13: another section begins", "file of its own"]),
        ([*export("1.21"), *export("1.21")[1:]], ["line 12: another section begins"]),
        (edited("Format Version", "Name"), ["line 1: no export of Motive"]),
        ([""], ["line 1: no export of Motive"]),
    ],
)
def test_what_is_wrong_is_said(lines, words, read):
    with pytest.raises(UserError) as raised:
        read(lines)
    for word in words:
        assert word in str(raised.value)


def test_files_that_are_none(tmp_path):
    with pytest.raises(UserError, match="No such file"):
        motive_csv.read_take(tmp_path / "none.csv")
    (tmp_path / "picture.csv").write_bytes(bytes(range(256)))
    with pytest.raises(UserError, match="not a text file"):
        motive_csv.read_take(tmp_path / "picture.csv")


def test_every_cut_of_a_file_is_noticed(tmp_path):
    data = ("\n".join(export()) + "\n").encode()
    path = tmp_path / "cut.csv"
    for size in [*range(0, len(data), 7), len(data) - 3, len(data) - 2, len(data) - 1]:
        path.write_bytes(data[:size])
        with pytest.raises(UserError):
            motive_csv.read_take(path)
