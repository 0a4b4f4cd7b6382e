"""`tools/bringup`: its options, and a table of what each step did."""

import argparse
import json
import os
import sys
from pathlib import Path

from tools.bring_up.answers import Answers, read_answers
from tools.bring_up.machine import Machine, StepError
from tools.bring_up.remote import bring_up_others
from tools.bring_up.simulated import run_simulated
from tools.bring_up.steps import STEPS, Step, remove

DESCRIPTION = "From a fresh Debian to a robot that starts by itself (docs/bringup.md)."


def main(arguments: list[str]) -> int:
    """0: all steps did their work; 1: one failed; 2: bad use."""
    options = _options(arguments)
    try:
        if options.on:
            return bring_up_others(options.on.split(","), options)
        if options.simulate is not None:
            return run_simulated(options.simulate, options.seconds, options.dry_run)
        return _bring_up(options)
    except StepError as error:
        print(f"bringup: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\nbringup: stopped; run it again to go on", file=sys.stderr)
        return 1


def _options(arguments: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser("tools/bringup", description=DESCRIPTION)
    parser.add_argument("steps", nargs="*", metavar="STEP", help=f"{', '.join(STEPS)}; or all")
    parser.add_argument("--answers", type=Path, metavar="FILE", help="TOML; defaults else")
    parser.add_argument("--yes", action="store_true", help="ask nothing, take the defaults")
    parser.add_argument("--dry-run", action="store_true", help="print the commands, run none")
    parser.add_argument("--remove", action="store_true", help="undo what it did")
    parser.add_argument("--on", metavar="HOST,HOST", help="bring up other computers, over ssh")
    parser.add_argument(
        "--simulate", nargs="?", const="arena4", metavar="SCENARIO",
        help="a simulated robot as a service, without root",
    )  # fmt: skip
    parser.add_argument("--seconds", type=float, help="of --simulate: end after so long")
    options = parser.parse_args(arguments)
    unknown = [step for step in options.steps if step not in STEPS]
    if unknown:
        parser.error(f"no step is called {unknown[0]}; there are {', '.join(STEPS)}")
    return options


def _bring_up(options: argparse.Namespace) -> int:
    destination = os.environ.get("DESTDIR")
    machine = Machine(options.dry_run, Path(destination) if destination else None)
    given = read_answers(options.answers) if options.answers else {}
    silent = options.yes or bool(options.answers) or options.dry_run or options.remove
    answers = Answers(given, silent)
    steps: dict[str, Step] = {name: STEPS[name] for name in options.steps or STEPS}
    if options.remove:
        steps = {"remove": lambda machine, answers: remove(machine)}
    results = _run(steps, machine, answers)
    print("\n" + "\n".join(f"  {name:12} {result}" for name, result in results.items()))
    print(f"RESULT {json.dumps(results)}")
    return any(result.startswith("FAILED") for result in results.values())


def _run(steps: dict[str, Step], machine: Machine, answers: Answers) -> dict[str, str]:
    """The result of each step; those after a failed one are tried as well, for what they need."""
    results = {}
    for name, step in steps.items():
        print(f"{name}: {(step.__doc__ or 'undo what it did').splitlines()[0]}", flush=True)
        try:
            results[name] = step(machine, answers)
        except StepError as error:
            print(f"    {error}", file=sys.stderr)
            results[name] = f"FAILED: {str(error).splitlines()[0]}"
            if name in ("packages", "environment"):  # nothing works without them
                break
    return results
