"""How honest the sigmas of the calibrations are: errors over sigmas, for many drives.

    python tools/bench/calibration_sigmas.py --seeds 1-20 [--folder RECORDINGS] [--seconds 60]

Drives of the robot that is not as its robot.toml says are simulated, and wheels, lidar and cameras
fitted one after the other, each with the covariance that those before it left. Of each value that
is written and that the simulation knows the truth of: the mean of (error / sigma)² (1 is honest;
by chance ± sqrt(2 / seeds)), its mean, and the root mean square error.
"""

import argparse
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from host.calibration.chain import Chain
from host.calibration.result import Calibration
from host.config import RobotConfig
from host.sessions.calibrating.calibrate import CalibrationKind, calibrate_gathered
from host.sessions.calibrating.gathering import gather_source
from host.sessions.recordings.simulating import simulate_to_recording
from host.simulation.world.built import built
from host.simulation.world.scenarios import parse_scenario

SCENARIO = "misbuilt4"
KINDS: tuple[CalibrationKind, ...] = ("wheels", "lidar", "camera")


def value_of(robot: RobotConfig, key: str) -> float:
    """A setting by its key."""
    found: Any = robot
    for part in key.split("."):
        found = getattr(found, part)
    return float(found)


def changed(robot: RobotConfig, settings: dict[str, Any]) -> RobotConfig:
    """The configuration with other settings, by their keys."""
    content = robot.model_dump()
    for key, value in settings.items():
        *tables, name = key.split(".")
        place = content
        for table in tables:
            place = place[table]
        place[name] = value
    return RobotConfig.model_validate(content)


def calibrated(source: str) -> list[Calibration]:
    """All fits to one drive, whether they pass or not."""
    robot, chain, fits = RobotConfig(), Chain(), []
    for kind in KINDS:
        gathered = gather_source(source, robot)
        gathered.chain = chain
        fits.append(calibrate_gathered(kind, gathered))
        chain.take(fits[-1])
        robot = changed(robot, fits[-1].new_settings())
    return fits


def seeds_of(text: str) -> list[int]:
    """As "1-20" or "3,5"."""
    first, _, last = text.partition("-")
    return list(range(int(first), int(last) + 1)) if last else [int(s) for s in text.split(",")]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", default="1-20")
    parser.add_argument("--seconds", type=int, default=60, help="of each drive")
    parser.add_argument("--folder", type=Path, help="where drives are kept, and taken from")
    options = parser.parse_args()
    truth = built(RobotConfig(), parse_scenario(SCENARIO))
    errors: dict[str, list[tuple[float, float]]] = {}
    with tempfile.TemporaryDirectory(prefix="swarmloc-") as temporary:
        folder = options.folder or Path(temporary)
        for seed in seeds_of(options.seeds):
            path = folder / f"drive-{seed}.mcap"
            if not path.exists():
                scenario = f"{SCENARIO}:seed={seed},seconds={options.seconds}"
                simulate_to_recording(scenario, path, RobotConfig())
            for row in (row for fit in calibrated(str(path)) for row in fit.fitted if row.key):
                error = row.value - value_of(truth, row.key)
                errors.setdefault(row.key, []).append((error, row.sigma))
            print(f"seed {seed}", flush=True)
    print(f"\n{'':32}{'NSE':>7}{'mean':>7}{'rms error':>12}")
    for key, pairs in errors.items():
        if "noise" in key or "reach" in key:
            continue  # the simulation has no one true value of these
        off, sigma = np.array(pairs).T
        squares, mean = np.mean((off / sigma) ** 2), np.mean(off / sigma)
        print(f"{key:32}{squares:7.2f}{mean:+7.2f}{np.sqrt(np.mean(off**2)):12.2e}")


if __name__ == "__main__":
    main()
