"""A long run with bad luck: does it stay as it is, in memory, threads, descriptors and time?

    python -m tools.soak --minutes 30 --speed 4

Two processes simulate the devices, another runs the robot with its recording and its page, all on a
clock that is `speed` times as fast. Lidar and board are unplugged in turn, their lines stall and
bring garbage, every few seconds; the cameras live, so that no estimate may be older than 0.5 s. One
reader reads all, one hardly.
Ends with exit code 1 where something grew by more than 5 % since the first quarter.
"""

import argparse
import contextlib
import dataclasses
import functools
import math
import multiprocessing
import os
import random
import select
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:  # what is imported before the clock is fast keeps the slow one
    from multiprocessing.synchronize import Barrier

    from host.messages import Message

READ = """
import sys, time
from websockets.sync.client import connect
with connect(sys.argv[1], ping_interval=None) as stream:
    for _ in stream:
        time.sleep(float(sys.argv[2]))
"""
LIDAR_OUT, BOARD_OUT, AGAIN_S = (3.0, 4.5), (7.0, 8.2), 10.0  # s within each ten
STALL_S, STALLS_S, GARBAGE_S = 0.4, 6.0, 4.0
OLDEST_S, GROWTH = 0.5, 0.05
SCENARIO = "arena4:seed=1,seconds=7200"


class Sample(NamedTuple):
    """What a process has: memory (kB), threads, open descriptors."""

    memory: int
    threads: int
    descriptors: int


def faster(speed: float) -> None:
    """Let the clock run `speed` times as fast for all that is imported from now on."""
    monotonic, sleep, wait, chosen = (
        time.monotonic,
        time.sleep,
        threading.Condition.wait,
        select.select,
    )
    begin = monotonic()
    # No function: some classes keep the clock, and a builtin is no method of theirs.
    time.monotonic = functools.partial(lambda: begin + speed * (monotonic() - begin))

    def shorter(timeout: float | None) -> float | None:
        return None if timeout is None else timeout / speed

    time.sleep = lambda seconds: sleep(seconds / speed)
    threading.Condition.wait = lambda self, timeout=None: wait(self, shorter(timeout))  # type: ignore[method-assign]
    select.select = lambda r, w, x, timeout=None: chosen(r, w, x, shorter(timeout))


def sample() -> Sample:
    """Of this process."""
    status = Path("/proc/self/status").read_text()
    figures = dict(line.split(":", 1) for line in status.splitlines())
    descriptors = len(os.listdir("/proc/self/fd"))
    return Sample(int(figures["VmRSS"].split()[0]), int(figures["Threads"]), descriptors)


def disturb_lines() -> None:
    """Lines of simulated devices that stall and bring garbage from now on."""
    from host.simulation import live

    random_bytes = random.Random(1)

    class BadLine(live.Terminal):
        held, garbage_due = b"", 0.0

        def write(self, data: bytes) -> None:
            now = time.monotonic()
            if now > self.garbage_due:
                self.garbage_due = now + GARBAGE_S
                data = random_bytes.randbytes(64) + data
            if now % STALLS_S < STALL_S:
                self.held += data
                return
            data, self.held = self.held + data, b""
            super().write(data)

    live.Terminal = BadLine  # type: ignore[misc]


def simulate(name: str, seconds: float, pipe: Connection, together: "Barrier") -> None:
    """Lidar and cameras, or the board; through the pipe go the configuration and what cameras see.

    The simulated chip takes half a core at this speed, so that it has its own process. The
    same seed makes the same world in both.
    """
    from host.config import RobotConfig
    from host.simulation.devices.board import STAND_IN, best_board
    from host.simulation.live import BOARD, LIDAR, LiveSimulation
    from host.simulation.world.scenarios import parse_scenario

    disturb_lines()
    robot = RobotConfig()
    other, board = (LIDAR, best_board(robot.motors)) if name == BOARD else (BOARD, STAND_IN)
    begin, end = BOARD_OUT if name == BOARD else LIDAR_OUT
    tens = [AGAIN_S * k for k in range(int(seconds / AGAIN_S))]
    unplugged = {name: [(ten + begin, ten + end) for ten in tens], other: [(0.0, math.inf)]}
    simulation = LiveSimulation(parse_scenario(SCENARIO), robot, unplugged, board)
    together.wait()
    with simulation:
        pipe.send(simulation.config)
        cameras = pipe.send if name == LIDAR else ignore
        simulation.camera.run(cameras, threading.Event())


def ignore(message: object) -> None:
    """What nobody is to hear."""


class Relayed:
    """The simulated cameras of the other process, as a device. newest: time of the last message."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe
        self.newest = -math.inf

    def run(self, emit: "Callable[[Message], None]", stop: threading.Event) -> None:
        """Hand on what comes; what came before nobody listened to."""
        while self._pipe.poll():
            self._pipe.recv()
        while not stop.is_set():
            if self._pipe.poll(0.05):
                message = self._pipe.recv()
                self.newest = message.time
                emit(message)


class Ages:
    """Who watches how old the newest reading in an estimate is.

    late: looks beyond OLDEST_S; at_hand: those when the cameras had delivered a younger reading.
    """

    def __init__(self, cameras: Relayed) -> None:
        self._cameras = cameras
        self.oldest, self.looks, self.late, self.at_hand = 0.0, 0, 0, 0

    def take(self, message: object) -> None:
        """Nothing of interest."""

    def look(self, now: object) -> None:
        """Note the age."""
        time, measured = now.estimate.time, now.measured  # type: ignore[attr-defined]
        late = time - measured > OLDEST_S
        self.oldest = max(self.oldest, time - measured)
        self.looks += 1
        self.late += late
        self.at_hand += late and time - self._cameras.newest <= OLDEST_S


def run(seconds: float, folder: Path) -> tuple[list[Sample], Ages, str]:
    """Run for so many seconds of the faster clock; return samples, one in five of these."""
    context = multiprocessing.get_context("fork")
    together = context.Barrier(2)
    from host.sessions.live.running import run_devices
    from host.sources.rig import real_rig
    from host.viewer.scene import Scene
    from host.viewer.server import Viewer

    samples = []
    with contextlib.ExitStack() as stack:
        pipes = {}
        for name in ("lidar", "board"):
            pipes[name], theirs = context.Pipe()
            device = context.Process(target=simulate, args=(name, seconds, theirs, together))
            device.start()
            stack.callback(device.terminate)
        config = pipes["lidar"].recv().model_copy(update={"board": pipes["board"].recv().board})
        rig = real_rig(config, "lidar")
        cameras = Relayed(pipes["lidar"])
        ages, sources = Ages(cameras), {**rig.sources, "camera": cameras}
        rig = dataclasses.replace(rig, sources=sources, sensors="lidar+camera")
        viewer = stack.enter_context(Viewer(Scene(rig.config, rig.config.filter.profile), port=0))
        stream = viewer.url.replace("http:", "ws:") + "stream"
        for pause_s in ("0", "2"):
            reader = subprocess.Popen([sys.executable, "-c", READ, stream, pause_s])
            stack.callback(reader.kill)
        outcome = run_devices(
            rig,
            {},
            {"page": viewer, "ages": ages},
            seconds=seconds,
            record=folder / "soak.mcap",
            watch=lambda: samples.append(sample()),
            watch_every_s=5.0,
        )
    lidar = outcome.figures["devices"]["lidar"]
    share = outcome.figures["cpu_share_of_one_core"]
    connections = lidar["counts"]["connections"]
    said = f"{outcome.figures['updates']} updates, {connections} connections of the lidar"
    return samples, ages, f"{said}, {share:.2f} of a core for each second of its clock"


def main() -> None:
    """Run, and print whether it stayed as it was."""
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("--minutes", type=float, default=30.0, help="of this computer's clock")
    options.add_argument("--speed", type=float, default=4.0, help="times real time")
    asked = options.parse_args()
    faster(asked.speed)
    with tempfile.TemporaryDirectory() as folder:
        tempfile.tempdir = folder
        seconds = 60.0 * asked.minutes * asked.speed
        samples, ages, said = run(seconds, Path(folder))
        recorded = (Path(folder) / "soak.mcap").stat().st_size / 1e6
    print(f"{asked.minutes:g} min at {asked.speed:g} times real time: {said}, {recorded:.1f} MB")
    quarter = len(samples) // 4
    grown = False
    for name in Sample._fields:
        early, late = (
            statistics.median(getattr(each, name) for each in part)
            for part in (samples[quarter : 2 * quarter], samples[-quarter:])
        )
        print(f"  {name:12} {early:.0f} → {late:.0f}")
        grown |= late > (1.0 + GROWTH) * early
    print(
        f"  oldest       {ages.oldest:.2f} s; {ages.late} of {ages.looks} beyond {OLDEST_S}, "
        f"{ages.at_hand} of them with a younger reading at hand"
    )
    sys.exit(1 if grown or ages.late else 0)


if __name__ == "__main__":
    main()
