"""Squares of misbuilt robots on the firmware: before, after UMBmark's correction, after a fit.

    python -m tools.squares --misbuilt 1,2.5

Offline, in closed loop on the firmware with the motor model: misbuilt=1 has wheels 2 % and a track
5 % off, 2.5 has 5 % and 12.5 %. Without slip, which alone scatters squares by centimetres. A square
of 1 m each way, and what UMBmark makes of it; a drive to calibrate by, and its fit of the wheels;
the squares again under either correction. The tracked body is known.
"""

import click

from host.behaviour.interface import Behaviour
from host.behaviour.square import Square
from host.behaviour.survey import Survey
from host.calibration.gathered import Gathered
from host.calibration.wheels.calibrate import calibrate as fit_wheels
from host.calibration.wheels.drives import drives_of, wheels_advice
from host.calibration.wheels.unseen import apply_fit
from host.config import RobotConfig
from host.evaluation.umbmark import Umbmark, corrected, umbmark
from host.sessions.live.squares import return_error
from host.sessions.offline.swarming import Swarm
from host.simulation.devices.board import best_board
from host.simulation.offline import OBSERVER
from host.simulation.world.arena import ARENA_STEP_S
from host.simulation.world.built import built
from host.simulation.world.scenarios import parse_scenario
from tools.drive_calibration import MOST_S, missing

SCENARIO = "arena4:robots=1,posts=0,side_m=6,seed=3,mocap_hz=100,wheel_slip=0,misbuilt={}"
SIDE_M = 1.0


def driven(robot: RobotConfig, misbuilt: str, behaviour: Behaviour) -> Gathered:
    """What a robot of this configuration delivers until its behaviour is done, or for MOST_S."""
    scenario = parse_scenario(SCENARIO.format(misbuilt))
    swarm = Swarm(scenario, robot, lambda _: behaviour, best_board(robot.motors))
    gathered = Gathered(robot)
    for number in range(round(MOST_S / ARENA_STEP_S)):
        for message in swarm.step(number):
            gathered.take(message)
        enough = number % 50 == 49 and not missing(gathered, (wheels_advice,))
        if isinstance(behaviour, Survey) and enough:
            behaviour.end()
        if swarm.stacks[OBSERVER].driving.done:
            break
    return gathered


def squares(robot: RobotConfig, misbuilt: str) -> Umbmark:
    """UMBmark's figures of one square each way."""
    cw, ccw = (
        return_error(driven(robot, misbuilt, Square(SIDE_M, left)))[None] for left in (False, True)
    )
    return umbmark(cw, ccw, SIDE_M, robot.wheels.track_m)


def with_wheels(robot: RobotConfig, found: Umbmark) -> RobotConfig:
    """The robot with UMBmark's correction."""
    wheels = robot.wheels
    names = "left_radius_m", "right_radius_m", "track_m"
    values = corrected(found, *(getattr(wheels, name) for name in names))
    changed = wheels.model_copy(update=dict(zip(names, values, strict=True)))
    return robot.model_copy(update={"wheels": changed})


def with_fit(robot: RobotConfig, misbuilt: str) -> RobotConfig:
    """The robot with what a drive to calibrate by says of wheels and tracked body."""
    fit = fit_wheels(drives_of(driven(robot, misbuilt, Survey())), robot.wheels, robot.mocap)
    click.echo(f"  fit of wheels: {'; '.join(fit.failures) or 'passes'}")
    wheels, mocap = apply_fit(fit, robot.wheels, robot.mocap)
    return robot.model_copy(update={"wheels": wheels, "mocap": mocap})


@click.command(help=__doc__)
@click.option("--misbuilt", "all_misbuilt", default="1,2.5", show_default=True)
def main(all_misbuilt: str) -> None:
    """Print the systematic error of each, mm."""
    for misbuilt in all_misbuilt.split(","):
        true = built(RobotConfig(), parse_scenario(SCENARIO.format(misbuilt)))
        robot = RobotConfig(mocap=true.mocap)  # where the tracked body is was calibrated before
        before = squares(robot, misbuilt)
        click.echo(f"misbuilt {misbuilt}: {1e3 * before.systematic_m:.0f} mm")
        after = squares(with_wheels(robot, before), misbuilt)
        click.echo(f"  after its own correction: {1e3 * after.systematic_m:.0f} mm")
        fitted = squares(with_fit(robot, misbuilt), misbuilt)
        click.echo(f"  after the fit: {1e3 * fitted.systematic_m:.0f} mm")


if __name__ == "__main__":
    main()
