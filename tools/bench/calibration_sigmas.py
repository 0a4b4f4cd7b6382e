"""How honest the sigmas of the calibrations are: errors over sigmas, for many drives.

    python tools/bench/calibration_sigmas.py --seeds 1-20 [--pivot-m 0.01] [--folder RECORDINGS]
    python tools/bench/calibration_sigmas.py --seeds 1-42 --no-pictures    # ten times as fast

Drives of the robot that is not as its robot.toml says are simulated, and wheels, lidar and cameras
fitted one after the other, each with the covariance that those before it left; then all of them
together. Of each value that is written and that the simulation knows the truth of, by the single
fits and by the joint one: the mean of (error / sigma)² (1 is honest; by chance ± sqrt(2 / seeds)),
the mean of error / sigma, and the root mean square error. --pivot-m: how far teammates' bodies have
their pivots beside their turrets. --no-pictures: wheels and lidar alone.
"""

import argparse
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from host.calibration.chain import Chain
from host.calibration.result import Calibration, Fitted
from host.config import RobotConfig
from host.sessions.calibrating.calibrate import CalibrationKind, calibrate_gathered
from host.sessions.calibrating.gathering import gather_source
from host.sessions.recordings.simulating import simulate_to_recording
from host.simulation.world.built import built
from host.simulation.world.motion_capture import pivots_of
from host.simulation.world.scenarios import Scenario, parse_scenario

KINDS: tuple[CalibrationKind, ...] = ("wheels", "lidar", "camera", "joint")
Errors = dict[str, list[tuple[float, float]]]  # by key: errors and sigmas


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


def calibrated(source: str, kinds: tuple[CalibrationKind, ...] = KINDS) -> list[Calibration]:
    """All fits to one drive, whether they pass or not."""
    robot, chain, fits = RobotConfig(), Chain(), []
    for kind in kinds:
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


def errors_of(row: Fitted, scenario: Scenario) -> dict[str, tuple[float, float]]:
    """Error and sigma of a value that the simulation has one truth of; by its key."""
    if row.name.startswith("turret of body"):
        number, across = int(row.name.split()[3].rstrip(",")), "left" in row.name
        true = -float(pivots_of(scenario, 0)[number - 1, int(across)])
        return {f"turrets, {'y' if across else 'x'}": (row.value - true, row.sigma)}
    if not row.key or "noise" in row.key or "reach" in row.key:
        return {}
    true = value_of(built(RobotConfig(), scenario), row.key)
    return {row.key: (row.value - true, row.sigma)}


def show(single: Errors, joint: Errors) -> None:
    """Print the table."""
    print(f"\n{'':35}single fits{'':20}joint fit")
    print(f"{'':28}{'NSE':>7}{'mean':>7}{'rms error':>11}{'NSE':>9}{'mean':>7}{'rms error':>11}")
    for key in {**single, **joint}:
        line = f"{key:28}"
        for errors, width in ((single, 7), (joint, 9)):
            off, sigma = np.array(errors.get(key, [(np.nan, np.nan)])).T
            squares, mean = np.mean((off / sigma) ** 2), np.mean(off / sigma)
            line += f"{squares:{width}.2f}{mean:+7.2f}{np.sqrt(np.mean(off**2)):11.2e}"
        print(line)


def main() -> None:
    """Simulate, fit and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", default="1-20")
    parser.add_argument("--seconds", type=int, default=60, help="of each drive")
    parser.add_argument("--pivot-m", type=float, default=0.0, help="of teammates' bodies")
    parser.add_argument("--folder", type=Path, help="where drives are kept, and taken from")
    parser.add_argument("--no-pictures", action="store_true", help="wheels and lidar alone")
    options = parser.parse_args()
    kinds, blind = (KINDS[:2], ",rendered=0") if options.no_pictures else (KINDS, "")
    pivots = f"-pivot_m={options.pivot_m}" if options.pivot_m else ""
    single: Errors = {}
    joint: Errors = {}
    with tempfile.TemporaryDirectory(prefix="swarmloc-") as temporary:
        folder = options.folder or Path(temporary)
        for seed in seeds_of(options.seeds):
            path = folder / f"drive-{seed}{pivots}{blind}.mcap"
            scenario = f"misbuilt4:seed={seed},seconds={options.seconds},pivot_m={options.pivot_m}"
            scenario += blind
            if not path.exists():
                simulate_to_recording(scenario, path, RobotConfig())
            for fit in calibrated(str(path), kinds):
                for row in fit.fitted:
                    for key, pair in errors_of(row, parse_scenario(scenario)).items():
                        kept = joint if fit.kind == "joint" else single
                        kept.setdefault(key, []).append(pair)
                if fit.failures:
                    print(f"seed {seed}, {fit.kind}: {fit.failures[0]}")
            print(f"seed {seed}", flush=True)
    show(single, joint)


if __name__ == "__main__":
    main()
