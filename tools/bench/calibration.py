"""What calibration is worth: GOSPA of a misbuilt robot as configured, as calibrated, and as it is.

    python tools/bench/calibration.py [--seconds 120] [--seeds 11,12]

One simulated drive under motion capture is recorded; the commands of an afternoon (wheels, lidar,
camera) fit robot.toml to it. Then other drives of the same robot are simulated and scored with each
of the three configurations, its devices' bytes and pictures read again each time.
"""

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from host import config
from host.config import RobotConfig
from host.sessions.recordings import runs
from host.simulation.world.built import built
from host.simulation.world.scenarios import parse_scenario
from host.sources.sensors import LIDAR_AND_CAMERA

EXAMPLE = Path(__file__).parents[2] / "robots" / "cherokey.toml"
SCENARIO = "misbuilt4"


def swarmloc(*arguments: str) -> None:
    """Run a command as a user does; it must succeed."""
    subprocess.run([str(Path(sys.executable).with_name("swarmloc")), *arguments], check=True)


def calibrated(folder: Path, seconds: int) -> RobotConfig:
    """The configuration that the commands write from one drive."""
    robot, drive = folder / "robot.toml", folder / "drive.swarmloc"
    shutil.copyfile(EXAMPLE, robot)
    swarmloc("simulate", f"{SCENARIO}:seed=1,seconds={seconds}", "--output", str(drive))
    for kind in ("wheels", "lidar", "camera"):
        report = folder / f"{kind}.html"
        swarmloc("calibrate", kind, str(drive), "--robot", str(robot), "--report", str(report))
    return config.load_config(robot)


def gospa(scenario: str, robot: RobotConfig) -> float:
    """Mean GOSPA (m) of the default filter over a drive."""
    run = runs.load_run(scenario, robot)
    row = run.score(robot.filter.profile, LIDAR_AND_CAMERA).row("", "", "", "").as_json()
    return float(row["gospa_m"])


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=int, default=120, help="of each drive")
    parser.add_argument("--seeds", default="11", help="of the drives that are scored")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="swarmloc-") as folder:
        robots = {
            "as configured": RobotConfig(),
            "calibrated": calibrated(Path(folder), options.seconds),
            "as it truly is": built(RobotConfig(), parse_scenario(SCENARIO)),
        }
    print(f"\n{'seed':>6}" + "".join(f"{name:>18}" for name in robots) + f"{'ratio':>8}")
    for seed in options.seeds.split(","):
        scenario = f"{SCENARIO}:seed={seed},seconds={options.seconds}"
        found = [gospa(scenario, robot) for robot in robots.values()]
        row = "".join(f"{value:16.3f} m" for value in found)
        print(f"{seed:>6}{row}{found[1] / found[2]:8.2f}")
    print("ratio: calibrated / as it truly is")


if __name__ == "__main__":
    main()
