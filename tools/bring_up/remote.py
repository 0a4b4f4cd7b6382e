"""Several robots at once: this folder copied to each over ssh, and brought up there."""

import argparse
import json
import shutil
import subprocess
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tools.bring_up.layout import SOURCE
from tools.bring_up.machine import StepError

FOLDER = "swarmloc-bringup"  # in the home of the other computer
_LEFT_OUT = (
    ".git",
    ".venv",
    ".venv-lowest",
    "__pycache__",
    ".mypy_cache",
    ".ruff_cache",
    ".pytest_cache",
)
_SSH = ("ssh", "-o", "BatchMode=yes", "-o", "ConnectTimeout=10")


def bring_up_others(hosts: Sequence[str], options: argparse.Namespace) -> int:
    """Bring up each host, all at once; print a table of results. 1 where one failed.

    Raises StepError where this computer has no ssh.
    """
    if shutil.which(_SSH[0]) is None:
        raise StepError("ssh is not installed: sudo apt-get install openssh-client")
    logs = Path("bringup-logs")
    logs.mkdir(exist_ok=True)
    with ThreadPoolExecutor(max(1, min(len(hosts), 8))) as pool:
        results = list(pool.map(lambda host: _one(host, options, logs / f"{host}.log"), hosts))
    steps = list(dict.fromkeys(step for result in results for step in result))
    width = max(len(host) for host in hosts)
    for host, result in zip(hosts, results, strict=True):
        words = [f"{step}: {result[step]}" for step in steps if step in result]
        print(f"{host:{width}}  " + "; ".join(words))
    print(f"what each said is in {logs}/")
    return any(word.startswith("FAILED") for result in results for word in result.values())


def _one(host: str, options: argparse.Namespace, log: Path) -> dict[str, str]:
    """The results of one host, by step."""
    with log.open("wb") as file:
        if _copy(host, file):
            return {"copy": f"FAILED: see {log}"}
        command = [f"{FOLDER}/tools/bringup", *options.steps, "--yes"]
        command += ["--remove"] * options.remove + ["--dry-run"] * options.dry_run
        text = b""
        if options.answers:
            # By standard input, so that nothing more has to be copied.
            command += ["--answers", "/dev/stdin"]
            text = options.answers.read_bytes()
        done = subprocess.run(
            [*_SSH, host, " ".join(command)], input=text, check=False, capture_output=True
        )
        file.write(done.stdout + done.stderr)
    last = done.stdout.decode("utf-8", "replace").rstrip().rpartition("\n")[2]
    if last.startswith("RESULT "):
        found: dict[str, str] = json.loads(last.removeprefix("RESULT "))
        return found
    return {"bringup": f"FAILED: see {log}"}


def _copy(host: str, log: "subprocess._FILE") -> bool:
    """Copy this folder; True where that failed."""
    without = [f"--exclude={name}" for name in _LEFT_OUT]
    # At the end of the block the pipe is closed: where nobody unpacks, tar would wait for ever.
    with subprocess.Popen(
        ["tar", "-C", str(SOURCE), "-cz", *without, "."], stdout=subprocess.PIPE, stderr=log
    ) as pack:
        unpack = subprocess.run(
            [*_SSH, host, f"mkdir -p {FOLDER} && tar -xz -C {FOLDER}"],
            stdin=pack.stdout, stdout=log, stderr=log, check=False,
        )  # fmt: skip
    return bool(pack.returncode or unpack.returncode)
