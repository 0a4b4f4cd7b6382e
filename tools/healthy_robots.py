"""False alarms of the doctor: it examines healthy simulated robots live, each in a process.

    python tools/healthy_robots.py --seeds 1-20 --at-once 4
    python tools/healthy_robots.py --seeds 1-20 --scenario arena4:mocap_hz=100 --spin

Findings about this computer are counted apart: several live robots at once may be too many for it.
"""

import contextlib
import functools
import multiprocessing
import sys
import time
from pathlib import Path

import click

from host.config import RobotConfig
from host.doctor.examine import examine
from host.doctor.findings import Finding, Level
from host.doctor.spin import Spin
from host.drivers.computer import Computer
from host.sources.rig import simulated_rig
from host.sources.sensors import LIDAR_AND_CAMERA

COMPUTER = ("computer", "localizer", "disk")  # parts that are this computer's, not the robot's


@click.command()
@click.option("--seeds", default="1-20", show_default=True, help="FROM-TO, or one.")
@click.option("--scenario", default="arena4", show_default=True)
@click.option("--spin", is_flag=True, help="Drive the wheels, too.")
@click.option("--at-once", default=2, show_default=True, help="So many robots.")
def main(seeds: str, scenario: str, spin: bool, at_once: int) -> None:
    """Print every finding that is not ok; the exit code is 1 where a robot has one."""
    first, _, last = seeds.partition("-")
    robots, begin = range(int(first), int(last or first) + 1), time.monotonic()
    alarms = busy = 0
    with multiprocessing.get_context("spawn").Pool(at_once) as pool:
        found = pool.imap(functools.partial(examined, scenario, spin), robots, chunksize=1)
        for seed, findings in zip(robots, found, strict=True):
            for finding in findings:
                own = finding.part in COMPUTER
                busy, alarms = busy + own, alarms + (not own)
                click.echo(f"seed {seed}: {finding.part} {finding.level}: {finding.what}")
    click.echo(
        f"{len(robots)} robots of {scenario}: {alarms} false alarms; "
        f"{busy} findings about this computer; {time.monotonic() - begin:.0f} s"
    )
    sys.exit(alarms > 0)


def examined(scenario: str, spin: bool, seed: int) -> list[Finding]:
    """What the doctor does not find ok of one robot."""
    named = f"{scenario}{',' if ':' in scenario else ':'}seed={seed}"
    with contextlib.ExitStack() as stack:
        rig = simulated_rig(stack, RobotConfig(), named, {}, LIDAR_AND_CAMERA, driven=spin)
        wheels = Spin(rig.board.command, rig.config) if spin else None
        found = examine(rig, Path.cwd(), Computer(), spin=wheels).findings
    return [finding for finding in found if finding.level != Level.OK]


if __name__ == "__main__":
    main()
