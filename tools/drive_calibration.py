"""Drives to calibrate by, in many arenas: does what is driven cover what the fits need, and when?

    python tools/drive_calibration.py --seeds 1-5 [--pictures]

Each robot is misbuilt as of scenario misbuilt4, and drives in closed loop on the fast model of its
board, by its own estimates. With --pictures its cameras' pictures are rendered and searched, which
takes minutes an arena; else wheels and lidar are judged alone.
"""

import functools
import multiprocessing
import os
from collections.abc import Callable, Sequence
from dataclasses import replace

import click

from host.behaviour.survey import Survey
from host.calibration.camera.calibrate import calibrate as fit_camera
from host.calibration.camera.calibrate import camera_advice
from host.calibration.gathered import Gathered
from host.calibration.lidar.calibrate import calibrate as fit_lidar
from host.calibration.lidar.calibrate import lidar_advice
from host.calibration.reinterpretation import Reinterpretation
from host.calibration.result import Calibration
from host.calibration.wheels.calibrate import calibrate as fit_wheels
from host.calibration.wheels.drives import drives_of, wheels_advice
from host.calibration.wheels.unseen import apply_fit
from host.config import RobotConfig
from host.errors import UserError
from host.sessions.offline.swarming import Swarm
from host.simulation.offline import OBSERVER
from host.simulation.world.arena import ARENA_STEP_S
from host.simulation.world.scenarios import parse_scenario

MOST_S = 120.0  # longest drive
ADVICES = (wheels_advice, lidar_advice)


def drive(scenario: str, pictures: bool) -> tuple[float, Swarm, Gathered]:
    """Drive until nothing is missing: how long it took (s), the simulation, what was gathered."""
    survey = Survey()
    swarm = Swarm(replace(parse_scenario(scenario), stacks="own"), RobotConfig(), lambda _: survey)
    gathered = Gathered(swarm.observer.config)
    advices = (*ADVICES, camera_advice) if pictures else ADVICES
    for number in range(round(MOST_S / ARENA_STEP_S)):
        for message in swarm.step(number):
            gathered.take(message)
        if number % 50 == 49 and not missing(gathered, advices):
            survey.end()
        if swarm.stacks[OBSERVER].driving.done:
            return number * ARENA_STEP_S, swarm, gathered
    return MOST_S, swarm, gathered


def missing(gathered: Gathered, advices: Sequence[Callable[[Gathered], list[str]]]) -> list[str]:
    """What the drive still lacks, of all fits."""
    try:
        return [words for advice in advices for words in advice(gathered)]
    except UserError as error:
        return [str(error)]


def fits(gathered: Gathered, pictures: bool) -> list[Calibration]:
    """The fits in their order, each as if read with what was fitted before."""
    config = gathered.config
    found = [fit_wheels(drives_of(gathered), config.wheels, config.mocap)]
    wheels, mocap = apply_fit(found[0], config.wheels, config.mocap)
    fitted = config.model_copy(update={"wheels": wheels, "mocap": mocap})
    again, seen = Gathered(fitted), Reinterpretation(config, fitted)
    kept = [*gathered.scans, *gathered.displacements, *gathered.bearings, *gathered.bodies]
    for message in sorted(kept, key=lambda message: message.time):
        again.take(seen.of(message))
    found.append(fit_lidar(again))
    if pictures:
        found.append(fit_camera(again))
    return found


def arena(seed: int, pictures: bool) -> tuple[bool, str]:
    """Whether an arena was covered and all fits passed, and how it went in words."""
    seconds, swarm, gathered = drive(f"misbuilt4:seed={seed},rendered={int(pictures)}", pictures)
    found = fits(gathered, pictures)
    verdicts = [f"{fit.kind} {'; '.join(fit.failures) or 'ok'}" for fit in found]
    own = sum(contact.robot == OBSERVER for contact in swarm.contacts)
    covered = seconds < MOST_S
    words = (
        f"seed {seed}: {'covered' if covered else 'not covered'} after {seconds:.0f} s, "
        f"{own} contacts of ours; {', '.join(verdicts)}"
    )
    return covered and not any(fit.failures for fit in found), words


@click.command(help=__doc__)
@click.option("--seeds", default="1-3", show_default=True, help="First and last.")
@click.option("--pictures", is_flag=True, help="Render and search pictures.")
@click.option("--workers", default=os.cpu_count(), show_default=True, help="Arenas at a time.")
def main(seeds: str, pictures: bool, workers: int) -> None:
    """Print a line for each arena, as it ends."""
    first, last = map(int, seeds.split("-"))
    good = 0
    with multiprocessing.Pool(workers) as pool:
        of = functools.partial(arena, pictures=pictures)
        for passed, words in pool.imap_unordered(of, range(first, last + 1)):
            good += passed
            print(words, flush=True)
    print(f"{good} of {last - first + 1} arenas covered, and all fits passed")


if __name__ == "__main__":
    main()
