import itertools
import math

import numpy as np
import pytest

from host.errors import UserError
from host.geometry import Path as RobotPath
from host.messages import Displacement, Positions
from host.recording.elsewhere import mrclam

START = 1_248_444_175.0


def write(folder, name, rows):
    text = "# UTIAS data\n# columns\n"
    text += "".join("  " + " \t ".join(f"{value:.3f}" for value in row) + " \n" for row in rows)
    (folder / name).write_text(text)


@pytest.fixture
def folder(tmp_path):
    """Robot 1 drives an arc and reads robot 2, a landmark and an unknown barcode."""
    barcodes = [(1, 5), (2, 14), (3, 41), (4, 32), (5, 23), (6, 63)]
    write(tmp_path, "Barcodes.dat", barcodes)
    write(tmp_path, "Landmark_Groundtruth.dat", [(6, 4.0, 1.0, 0.0, 0.0)])
    for robot in mrclam.ROBOTS:
        times = START + np.arange(0.0, 10.05, 0.1)
        write(tmp_path, f"Robot{robot}_Odometry.dat", [(START, 0.0, 0.0), (START + 10, 0.0, 0.0)])
        write(tmp_path, f"Robot{robot}_Measurement.dat", [(START + 5, 14, 1.0, 0.0)])
        write(tmp_path, f"Robot{robot}_Groundtruth.dat", [(t, robot, 2.0, 0.0) for t in times])
    drive = [(START, 0.0, 0.0), (START + 1, 0.5, 0.4), (START + 9, 0.0, 0.0), (START + 10, 0, 0)]
    write(tmp_path, "Robot1_Odometry.dat", drive)
    write(
        tmp_path,
        "Robot1_Measurement.dat",
        [
            (START + 2.000, 14, 2.03, 0.5),
            (START + 2.001, 63, 3.03, -0.2),
            (START + 2.236, 63, 3.03, -0.2),
            (START + 3.180, 43, 1.53, 0.1),
        ],
    )
    return tmp_path


def of_kind(messages, kind):
    return [message for message in messages if isinstance(message, kind)]


def test_readings_of_one_frame_come_together_and_silent_frames_are_put_in(folder):
    messages = mrclam.load_dataset(folder).messages(1, "clutter")
    frames = of_kind(messages, Positions)
    assert [len(frame.positions) for frame in frames] == [2, 1, 0, 0, 0, 1]
    assert [frame.time for frame in frames] == pytest.approx(
        [2.0, 2.236, 2.472, 2.708, 2.944, 3.18], abs=1e-6
    )
    assert [frame.identities.tolist() for frame in frames] == [[2, -1], [-1], [], [], [], [-1]]
    assert [message.time for message in messages] == sorted(message.time for message in messages)


def test_dropping_landmarks_keeps_their_frames_and_unknown_barcodes(folder):
    frames = of_kind(mrclam.load_dataset(folder).messages(1, "drop"), Positions)
    assert [frame.identities.tolist() for frame in frames] == [[2], [], [], [], [], [-1]]


def test_range_and_bearing_become_a_position_without_the_bias_and_its_covariance(folder):
    frame = of_kind(mrclam.load_dataset(folder).messages(1, "drop"), Positions)[0]
    assert frame.positions[0] == pytest.approx([2 * math.cos(0.5), 2 * math.sin(0.5)])
    generator = np.random.default_rng(6)
    distance = 2.0 + generator.normal(0.0, 0.03 + 0.031 * 2.0, 100_000)
    bearing = 0.5 + generator.normal(0.0, 0.0105, 100_000)
    drawn = np.cov(distance * np.cos(bearing), distance * np.sin(bearing))
    assert frame.covariances[0] == pytest.approx(drawn, abs=1e-4)


def test_logged_velocities_add_up_to_the_arc_they_command(folder):
    messages = mrclam.load_dataset(folder).messages(1, "clutter")
    steps = of_kind(messages, Displacement)
    path = RobotPath(keep_seconds=math.inf)
    for step in steps:
        path.append(step)
    driven, turn = 0.5 * 8, 0.4 * 8
    radius = 0.5 / 0.4
    assert path.poses(np.array([10.0]))[0] == pytest.approx(
        [radius * math.sin(turn), radius * (1 - math.cos(turn)), turn]
    )
    whole = path.between(0.0, 10.0)
    assert whole.translation_variance == pytest.approx(0.002 * driven)
    assert whole.heading_variance == pytest.approx(0.016 * turn + 2.4e-4 * 10)
    ends = [step.time for step in steps]
    for frame in of_kind(messages, Positions):
        assert frame.time in ends


def test_a_displacement_comes_before_the_frame_at_its_end(folder):
    messages = mrclam.load_dataset(folder).messages(1, "clutter")
    for earlier, later in itertools.pairwise(messages):
        if isinstance(earlier, Positions) and isinstance(later, Displacement):
            assert later.time > earlier.time


def test_truth_is_in_the_observers_frame_and_heading_turns_the_short_way(folder):
    times = START + np.arange(0.0, 10.05, 0.1)
    headings = [math.pi - 0.01 if k % 2 == 0 else -math.pi + 0.01 for k in range(len(times))]
    rows = [(t, 1.0, 2.0, psi) for t, psi in zip(times, headings, strict=True)]
    write(folder, "Robot1_Groundtruth.dat", rows)
    dataset = mrclam.load_dataset(folder)
    truth = dataset.truth(1, 3.05)
    assert truth.identities.tolist() == [2, 3, 4, 5]
    assert truth.positions == pytest.approx(
        np.array([[-1.0, 0.0], [-2.0, 0.0], [-3.0, 0.0], [-4.0, 0.0]]), abs=2e-3
    )
    seen = dataset.landmarks_seen_from(1, 3.05)
    assert seen == pytest.approx(np.array([[-3.0, 1.0]]), abs=2e-3)


def test_a_gap_of_any_robots_vicon_is_told(folder):
    times = [START + t for t in np.arange(0.0, 10.05, 0.1) if not 4.0 < t < 4.4]
    write(folder, "Robot3_Groundtruth.dat", [(t, 1.0, 2.0, 0.0) for t in times])
    dataset = mrclam.load_dataset(folder)
    assert dataset.has_vicon(3.9)
    assert not dataset.has_vicon(4.2)
    assert dataset.has_vicon(4.6)
    assert dataset.has_vicon(10.0)
    assert not dataset.has_vicon(10.01)
    assert dataset.has_vicon(0.0)
    assert dataset.has_vicon(0.05)
    assert not dataset.has_vicon(-0.01)
    assert not dataset.has_vicon(10.2)
    assert not dataset.has_vicon(-0.1)


def edit(path, number, line):
    lines = path.read_text().splitlines()
    lines[number - 1] = line
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("1248444176.0 \t 0.5", "expected 3 numbers"),
        ("1248444176.0 \t 0.5 \t 0.4 0.1", "expected 3 numbers"),
        ("1248444176.0 \t 0.5 \t O.4", "expected 3 numbers"),
        ("1248444176.0 \t 0.5 \t nan", "expected 3 numbers"),
        ("1248444170.0 \t 0.5 \t 0.4", "time goes back"),
    ],
)
def test_a_torn_line_is_named(folder, line, why):
    edit(folder / "Robot1_Odometry.dat", 4, line)
    with pytest.raises(UserError, match=rf"Robot1_Odometry.dat, line 4[\s\S]*{why}"):
        mrclam.load_dataset(folder)


def test_a_missing_folder_or_file_and_files_without_data_are_named(folder, tmp_path):
    with pytest.raises(UserError, match="no such folder"):
        mrclam.load_dataset(tmp_path / "nowhere")
    path = folder / "Robot4_Measurement.dat"
    path.write_text("# nothing\n")
    with pytest.raises(UserError, match=r"Robot4_Measurement\.dat, line 1[\s\S]*no numbers"):
        mrclam.load_dataset(folder)
    path.write_bytes(bytes(range(256)))
    with pytest.raises(UserError, match="not a text file"):
        mrclam.load_dataset(folder)
    path.unlink()
    with pytest.raises(UserError, match=r"cannot read .*Robot4_Measurement\.dat"):
        mrclam.load_dataset(folder)
