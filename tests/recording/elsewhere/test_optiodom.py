import math

import numpy as np
import pytest

from host.errors import UserError
from host.recording.elsewhere import optiodom

METADATA = "type,diff,\nngear,43.7,\nencRes,64,\nLi,0.2,\nDi,0.084,0.084\nThi,,\nodo_tf,1,1\n"


def rows(count=21, turn=0.01):
    """A robot that turns to the left: the right wheel counts more."""
    return [f"{0.05 * k},{0.01 * k},0,{turn * k},30,10" for k in range(count)]


@pytest.fixture
def session(tmp_path):
    folder = tmp_path / "square" / "1234"
    folder.mkdir(parents=True)
    (folder / "1234_metadata.csv").write_text("\ufeff" + METADATA, encoding="utf-8")
    (folder / "1234_run-01.csv").write_text("\n".join(rows()), encoding="utf-8")
    (folder / "1234_run-02.csv").write_text("\n".join(rows(11)) + "\n\n", encoding="utf-8")
    for twin in ("odo", "opti"):
        (folder / f"1234_run-01_{twin}.csv").write_text("not a run\n")
    return folder


def test_a_session_a_folder_of_sessions_and_one_run_are_read(session):
    for place in (session, session.parent.parent):
        assert [run.name for run in optiodom.read_runs(place)] == ["1234_run-01", "1234_run-02"]
    (run,) = optiodom.read_runs(session / "1234_run-02.csv")
    assert run.ticks.shape == (11, 2)
    assert run.ticks.dtype == np.int64
    assert np.diff(run.ticks, axis=0).tolist() == [[10, 30]] * 10
    assert run.truth[-1] == pytest.approx([0.1, 0.0, 0.1])
    assert run.times[-1] == pytest.approx(0.5)


def test_a_tick_of_the_nominal_geometry_is_as_long_as_the_metadata_say(session):
    wheels = optiodom.read_runs(session)[0].wheels
    per_tick = 2.0 * math.pi * wheels.left_radius_m / wheels.counts_per_turn
    assert per_tick == pytest.approx(math.pi * 0.084 / (43.7 * 64), rel=1e-12)
    assert wheels.right_radius_m == wheels.left_radius_m
    assert wheels.track_m == 0.2


def test_poses_that_were_lost_are_left_out_and_headings_unwrapped(session):
    lines = rows(turn=0.5)
    lines[3] = "0.15,,,,30,10"
    lines[8:] = [
        line.replace(f",{0.5 * k},", f",{0.5 * k - math.tau},")
        for k, line in enumerate(lines[8:], 8)
    ]
    (session / "1234_run-01.csv").write_text("\n".join(lines))
    run = optiodom.read_runs(session / "1234_run-01.csv")[0]
    assert len(run.times) == 21
    assert len(run.truth_times) == 20
    assert run.truth[-1, 2] == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("line", "text", "message"),
    [
        (4, "0.15,0,0,0,1", "line 5: .*\nexpected 6 columns, found 5"),
        (4, "0.2,0,0,x,1,2", "line 5: .*\nnot numbers"),
        (4, "0.2,0,0,0,1.5,2", "line 5: .*\n.*whole numbers"),
        (4, "0.2,0,0,0,,2", "line 5: .*\n.*whole numbers"),
        (4, "0.2,0,0,0,1e308,2", "line 5: .*\n.*whole numbers"),
        (4, "0.1,0,0,0,1,2", "line 5: .*\ntime goes from 0.150 to 0.100"),
        (20, "5.0,0,0,0,1,2", "rows are missing after 0.95 s"),
    ],
)
def test_what_is_wrong_in_a_run_is_named_with_its_line(session, line, text, message):
    lines = rows()
    lines[line] = text
    path = session / "1234_run-01.csv"
    path.write_text("\n".join(lines))
    with pytest.raises(UserError, match=message):
        optiodom.read_runs(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (METADATA.replace("diff", "omni3"), "line 1: .*\n.*'omni3', not 'diff'"),
        (METADATA.replace("type,diff,", "type"), "line 1: .*\n.*'', not 'diff'"),
        (METADATA.replace("Li,0.2,", "Li,,"), "line 4: .*\nLi must be followed by 1 positive"),
        (METADATA.replace("Di,0.084,0.084", "Di,0.084"), "Di must be followed by 2"),
        (METADATA.replace("encRes,64,\n", ""), "has no line 'encRes'"),
        (METADATA.replace("0.2", "20"), "no robot has such wheels"),
    ],
)
def test_what_is_wrong_in_the_metadata_is_named(session, text, message):
    (session / "1234_metadata.csv").write_text(text)
    with pytest.raises(UserError, match=message):
        optiodom.read_runs(session)


def test_metadata_need_only_what_is_used(session):
    (session / "1234_metadata.csv").write_text("ngear,50\nencRes,20\nLi,0.3\nDi,0.1,0.1\n")
    wheels = optiodom.read_runs(session)[0].wheels
    assert (wheels.counts_per_turn, wheels.left_radius_m, wheels.track_m) == (1000, 0.05, 0.3)


def test_missing_files_are_told_apart(session, tmp_path):
    with pytest.raises(UserError, match="no such file or folder"):
        optiodom.read_runs(tmp_path / "nowhere")
    with pytest.raises(UserError, match=r"called \*_run-NN.csv"):
        optiodom.read_runs(session / "1234_run-01_odo.csv")
    (session / "1234_run-01.csv").write_text("0,0,0,0,0,0\n")
    with pytest.raises(UserError, match="two rows or more, this one 1"):
        optiodom.read_runs(session / "1234_run-01.csv")
    (session / "1234_metadata.csv").unlink()
    with pytest.raises(UserError, match=r"there is no 1234_metadata\.csv beside it"):
        optiodom.read_runs(session)


def test_in_every_recorded_run_the_right_wheel_turns_the_robot_left(recorded):
    runs = optiodom.read_runs(recorded("optiodom"))
    assert len(runs) == 6
    for run in runs:
        per_tick = math.tau * run.wheels.left_radius_m / run.wheels.counts_per_turn
        left, right = (run.ticks[-1] - run.ticks[0]) * per_tick
        by_wheels = (right - left) / run.wheels.track_m
        true = run.truth[-1, 2] - run.truth[0, 2]
        assert by_wheels == pytest.approx(true, rel=0.03, abs=0.05)
        raw = np.loadtxt(
            next(recorded("optiodom").rglob(f"{run.name}_odo.csv")),
            delimiter=",",
            encoding="utf-8-sig",
        )
        # The raw log, left wheel first, runs on before and after.
        assert abs(raw[:, 1].sum() - run.ticks[-1, 0]) <= 0.001 * raw[:, 1].sum()
