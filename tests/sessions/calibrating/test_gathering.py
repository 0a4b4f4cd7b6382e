"""What a calibration is given: motion capture where the scenario sets none."""

from host.config import RobotConfig
from host.messages import Health
from host.sessions.calibrating.gathering import DriveWatch, gather_source, with_mocap
from host.sources.rig import Rig


def test_motion_capture_is_added_only_where_nothing_is_said_about_it() -> None:
    assert with_mocap("arena4") == "arena4:mocap_hz=100"
    assert with_mocap("arena4:seed=1") == "arena4:seed=1,mocap_hz=100"
    for text in ("arena4:mocap_hz=0", "arena4:mocap_hz=30", "misbuilt4"):
        assert with_mocap(text) == text


def test_a_scenario_is_gathered_with_its_progress() -> None:
    seen: list[tuple[float, float]] = []
    gathered = gather_source("arena4:seconds=2", None, lambda *step: seen.append(step))
    assert gathered.scans
    assert gathered.bodies
    assert gathered.displacements
    assert seen[-1][1] == 2.0
    assert 1.5 < max(time for time, _ in seen) <= 2.0


def test_a_drive_reports_a_device_that_is_down_before_what_is_missing() -> None:
    drive = DriveWatch(Rig("test", RobotConfig(), "lidar", {}), lambda gathered: ["drive on"])
    assert drive.missing() == ["drive on"]
    drive.note(Health(0.0, "lidar", False, "gone\nplug it in", {}))
    assert drive.missing() == ["lidar: gone; plug it in"]
    drive.note(Health(1.0, "lidar", True, "scanning", {}))
    assert drive.missing() == ["drive on"]
