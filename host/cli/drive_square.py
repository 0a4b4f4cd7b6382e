"""`swarmloc drive square`: UMBmark, with figures of the odometry's systematic errors."""

import contextlib
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import click
import numpy as np

from host.cli import options
from host.cli.files import json_option, write_json
from host.cli.terminal.layout import listing
from host.cli.terminal.signals import signals_caught
from host.config import RobotConfig
from host.drivers.natnet.client import MOCAP
from host.evaluation.umbmark import Umbmark, corrected, umbmark
from host.messages import FloatArray
from host.sessions.robot import robot_configuration
from host.sources.rig import Rig

_EMPTY_ROOM = "arena4:robots=1,posts=0,side_m=6,seed=3"  # it starts in the middle


@click.command(
    epilog="""\b
Examples:
  swarmloc drive square --simulate
  swarmloc drive square --side 1.5 --runs 5 --robot robot.toml"""
)
@options.robot_option
@options.simulate_option("Drive a simulated robot.", _EMPTY_ROOM)
@click.option(
    "--side",
    "side_m",
    type=options.Number(0.2, 20.0),
    default=1.0,
    show_default=True,
    help="Side of the square, m.",
)
@click.option(
    "--runs",
    type=click.IntRange(1, 20),
    default=1,
    show_default=True,
    help="Runs in each direction; the paper drives 5.",
)
@json_option
def square(
    robot_path: Path | None,
    scenario: str | None,
    side_m: float,
    runs: int,
    json_path: Path | None,
) -> None:
    """Drive a square in both directions and compute wheel corrections from its errors (UMBmark).

    Without motion capture, mark where the robot stands, and type after each square how far from
    the mark it ended.
    """
    from host.sessions.live.squares import as_rows, square_rig

    robot = robot_configuration(robot_path)
    errors: dict[bool, list[FloatArray]] = {False: [], True: []}
    with contextlib.ExitStack() as stack:
        rig = square_rig(stack, robot, scenario)
        signalled = stack.enter_context(signals_caught())
        for number in range(2 * runs):
            left = number % 2 == 1
            errors[left].append(_once(rig, side_m, left, signalled))
    found = umbmark(as_rows(errors[False]), as_rows(errors[True]), side_m, robot.wheels.track_m)
    content = _figures(found, robot)
    write_json(json_path, content)
    click.echo(_as_table(errors))
    click.echo(as_text(content, runs))


def _once(rig: Rig, side_m: float, left: bool, stopped: Callable[[], bool]) -> FloatArray:
    from host.sessions.live.squares import drive_square, return_error

    click.echo(f"{rig.title}: {'counter-clockwise' if left else 'clockwise'}", err=True)
    last = ""

    def watch(halt: str) -> None:
        nonlocal last
        if halt != last and halt:
            click.echo(f"  the robot stopped: {halt}", err=True)
        last = halt

    gathered = drive_square(rig, side_m, left, stopped=stopped, watch=watch)
    if MOCAP in rig.sources:
        return return_error(gathered)
    ahead = click.prompt("how far ahead of its mark did it end, mm (behind: negative)", type=float)
    beside = click.prompt("and how far to the left of it, mm (right: negative)", type=float)
    return np.array([ahead, beside]) / 1000.0


def _as_table(errors: dict[bool, list[FloatArray]]) -> str:
    """The return errors, a line each."""
    rows = [
        f"  {'counter-clockwise' if left else 'clockwise':20}{1000 * x:8.0f}{1000 * y:8.0f}"
        for left, runs in errors.items()
        for x, y in runs
    ]
    return "\n".join([f"  {'return error':20}{'x mm':>8}{'y mm':>8}", *rows])


def as_text(figures: Mapping[str, Any], runs: int) -> str:
    """The result in words, and what follows for robot.toml."""
    spread = f"{figures['spread_mm']} mm" if runs > 1 else "unknown after one square each way"
    lines = {
        "systematic error": f"{figures['systematic_error_mm']} mm",
        "spread": spread,
        "heading error a corner": f"{figures['corner_error_deg']} deg (track)",
        "heading error a side": f"{figures['side_bend_deg']} deg (wheels)",
        "right radius / left": f"{figures['wheel_ratio']}",
        "track / configured": f"{figures['track_ratio']}",
    }
    # Of the mean of a direction's runs, at three sigmas.
    if figures["systematic_error_mm"] <= 3.0 * figures["spread_mm"] / math.sqrt(runs):
        return f"{listing(lines)}\nkeep robot.toml: wheel slip alone explains these errors"
    todo = "write this into robot.toml:"
    if runs == 1:
        todo = "next: repeat with --runs 5, since wheels slip; so far robot.toml would be"
    return f"""{listing(lines)}
{todo}
  [wheels]
  left_radius_m = {figures["corrected_left_radius_m"]}
  right_radius_m = {figures["corrected_right_radius_m"]}
  track_m = {figures["corrected_track_m"]}"""


def _figures(found: Umbmark, robot: RobotConfig) -> dict[str, Any]:
    wheels = robot.wheels
    left, right, track = corrected(
        found, wheels.left_radius_m, wheels.right_radius_m, wheels.track_m
    )
    return {
        "systematic_error_mm": round(1000.0 * found.systematic_m, 1),
        "spread_mm": round(1000.0 * found.spread_m, 1),
        "corner_error_deg": round(math.degrees(found.alpha_rad), 3),
        "side_bend_deg": round(math.degrees(found.beta_rad), 3),
        "wheel_ratio": round(found.wheel_ratio, 5),
        "track_ratio": round(found.track_ratio, 5),
        "corrected_left_radius_m": round(left, 6),
        "corrected_right_radius_m": round(right, 6),
        "corrected_track_m": round(track, 5),
    }
