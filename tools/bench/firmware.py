"""The firmware on its simulated board: size, cycles, the fastest exact counting, speed steps.

Everything is of the real machine code in virtual time, so the figures depend on no machine; only
the last line, how fast the simulation itself runs, does. Cycles are 1/16 us; an interrupt's include
those of interrupts that it lets through, as the control in TIMER1_COMPA does. "interrupts off" is
the longest time in which no edge is seen, while the host reads descriptors and sends settings.

Exits with 1 where a floor is missed: flash 60 % and RAM 50 % of what there is, a loop of 2 ms,
and exact counting of two wheels at 8 kHz edges of channel A (2x) and 20 kHz steps (4x).
"""

import argparse
import json
import sys
import time
from pathlib import Path

from host.config import RobotConfig
from host.drivers.romeo.framing import BoardDecoder, encode
from host.drivers.romeo.protocol import DisplacementFrame, HelloFrame, VelocityFrame
from host.drivers.romeo.session import settings_for
from host.errors import UserError
from host.flashing.build import build_with_avr_gcc
from host.flashing.firmware import FLASH_BYTES, RAM_BYTES, Firmware
from host.simulation.devices.motors import DrivenRobot
from host.simulation.devices.romeo_elf import CYCLES_PER_S, LEFT, RIGHT, STEPS_PER_COUNT, RomeoElf

FLOOR_HZ = {2: 8_000, 4: 20_000}
NAMES = {2: "2x, external interrupts, edges of A", 4: "4x, pin change, quadrature steps"}
LONGEST_LOOP_S = 0.002
TALK_S = 0.05
SEARCH_S, PROOF_S = 2.0, 10.0
FASTER = 1.05
SPEED_MPS = 0.3
READ_CONFIGURATION = bytes.fromhex("8006000200000002")  # a control request, USB 2.0, table 9-2


def booted(firmware: Firmware, edges: int) -> RomeoElf:
    """A board whose port is open and whose host has said hello."""
    board = RomeoElf(firmware.elf, edges)
    board.open_port()
    board.run(0.3)
    board.send(encode(HelloFrame()))
    board.run(0.4)
    board.take()
    return board


def count(board: RomeoElf, edges: int, rate_hz: int, seconds: float) -> bool:
    """Rotate both wheels forward and back, one against the other; is every tick counted?

    The host streams commands and reads meanwhile.
    """
    decoder = BoardDecoder()
    start = last_ticks(board, decoder)
    moved = 0
    for k in range(round(seconds / TALK_S)):
        ticks = round(rate_hz * TALK_S) * (1 if k * TALK_S < seconds * 0.6 else -1)
        moved += ticks
        end = board.now + TALK_S
        board.turn(LEFT, STEPS_PER_COUNT[edges] * ticks, end)
        board.turn(RIGHT, -STEPS_PER_COUNT[edges] * ticks, end)
        board.send(encode(VelocityFrame(1000, -1000)))
        board.run(end)
        for _, data in board.take():
            decoder.feed(data)
    left, right = last_ticks(board, decoder)
    return (left - start[LEFT], right - start[RIGHT]) == (moved, -moved)


def last_ticks(board: RomeoElf, decoder: BoardDecoder) -> tuple[int, int]:
    """The counts that the board reports, its wheels at rest."""
    board.run(board.now + 0.05)
    frames = [frame for _, data in board.take() for frame in decoder.feed(data)]
    last = [frame for frame in frames if isinstance(frame, DisplacementFrame)][-1]
    return last.left_ticks, last.right_ticks


def fastest_exact(firmware: Firmware, edges: int) -> int:
    """The highest rate (Hz) of a search upward by FASTER that is exact for PROOF_S."""
    rates = [FLOOR_HZ[edges]]
    while count(booted(firmware, edges), edges, round(rates[-1] * FASTER), SEARCH_S):
        rates.append(round(rates[-1] * FASTER))
    for rate in reversed(rates):
        if count(booted(firmware, edges), edges, rate, PROOF_S):
            return rate
    return 0


def cycles(firmware: Firmware, edges: int) -> dict[str, dict[str, int]]:
    """Worst cycles of each interrupt, with its latency, and of a pass of the loop, at the floor."""
    board = booted(firmware, edges)
    board.watch("loop")
    board.clear_figures()
    count(board, edges, FLOOR_HZ[edges], 2.0)
    board.request(READ_CONFIGURATION)
    board.send(encode(settings_for(RobotConfig())))  # to be written to EEPROM meanwhile
    board.reading = False
    count_without_reading(board)
    figures = {
        name: {"worst": one.worst_cycles, "latency": one.worst_latency_cycles, "count": one.count}
        for name, one in board.interrupts.items()
    }
    passes = board.passes
    return {
        **figures,
        "loop": {"worst": passes.worst_cycles, "count": passes.count},
        "interrupts off": {"worst": board.interrupts_off[0], "count": 1},
    }


def count_without_reading(board: RomeoElf) -> None:
    """Let a host be silent for 2 s, then read again."""
    board.run(board.now + 2.0)
    board.reading = True
    board.run(board.now + 0.1)
    board.take()


def speed_step(firmware: Firmware, supply: float) -> dict[str, float]:
    """0 to SPEED_MPS in the motor model: overshoot, and the worst error after 0.5 s, per cent."""
    robot_config = RobotConfig()
    board = booted(firmware, 2)
    robot = DrivenRobot(board, robot_config.wheels, 6.0 * supply)
    settings = settings_for(robot_config)
    ticks = round(SPEED_MPS / robot_config.motors.full_speed_mps * settings.full_speed)
    board.send(encode(settings) + encode(VelocityFrame(ticks, ticks)))
    radius, speeds = robot_config.wheels.left_radius_m, []
    start = board.now
    for k in range(2000):
        if k % 50 == 0:
            board.send(encode(VelocityFrame(ticks, ticks)))
        robot.run(start + (k + 1) * 0.001)
        speeds.append(radius * robot.wheels[LEFT].speed / SPEED_MPS)
    return {
        "overshoot_percent": round(100 * (max(speeds) - 1), 1),
        "error_after_half_a_second_percent": round(100 * max(abs(s - 1) for s in speeds[500:]), 1),
    }


def simulation_speed(firmware: Firmware) -> float:
    """Virtual seconds a second of this machine, wheels rotating at the motors' most."""
    board = booted(firmware, 2)
    begin = time.process_time()
    count(board, 2, 6_400, 5.0)
    return 5.0 / (time.process_time() - begin)


def measure() -> tuple[dict[str, object], list[str]]:
    """Figures, and the floors that were missed, as text."""
    figures: dict[str, object] = {}
    missed = []
    for edges in (2, 4):
        firmware = build_with_avr_gcc({"ENCODER_EDGES": str(edges)})
        flash, ram = firmware.flash_bytes / FLASH_BYTES, firmware.ram_bytes / RAM_BYTES
        print(f"{NAMES[edges]}   ({firmware.built_with})")
        print(
            f"  flash {firmware.flash_bytes} B = {flash:.1%}   "
            f"RAM {firmware.ram_bytes} B = {ram:.1%}"
        )
        worst = cycles(firmware, edges)
        print(f"  {'':14}{'count':>9}{'worst cycles':>14}{'us':>8}{'latency us':>12}")
        for name, one in worst.items():
            latency = f"{one['latency'] / 16:12.1f}" if "latency" in one else ""
            print(f"  {name:14}{one['count']:9}{one['worst']:14}{one['worst'] / 16:8.1f}{latency}")
        rate = fastest_exact(firmware, edges)
        print(
            f"  exact for {PROOF_S:.0f} s, two wheels: up to {rate} Hz (floor {FLOOR_HZ[edges]})\n"
        )
        missed += ["flash"] * (flash > 0.6) + ["RAM"] * (ram > 0.5)
        missed += ["loop"] * (worst["loop"]["worst"] > LONGEST_LOOP_S * CYCLES_PER_S)
        missed += [f"counting at {edges}x"] * (rate < FLOOR_HZ[edges])
        figures[f"{edges}x"] = {
            "flash_bytes": firmware.flash_bytes,
            "ram_bytes": firmware.ram_bytes,
            "cycles": worst,
            "exact_hz": rate,
        }
    firmware = build_with_avr_gcc({"ENCODER_EDGES": "2"})
    for supply in (0.9, 1.0, 1.1):
        step = speed_step(firmware, supply)
        figures[f"speed_step_at_supply_{supply}"] = step
        overshoot, error = step.values()
        print(
            f"0 to {SPEED_MPS} m/s at {supply:.0%} supply: overshoot {overshoot} %, "
            f"within {error} % after 0.5 s"
        )
        missed += [f"speed step at {supply:.0%}"] * (overshoot >= 10.0 or error > 5.0)
    figures["virtual_seconds_per_second"] = round(simulation_speed(firmware), 1)
    print(f"simulation: {figures['virtual_seconds_per_second']} x real time on this machine")
    return figures, missed


def main() -> int:
    """Print the figures; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there too")
    arguments = parser.parse_args()
    try:
        figures, missed = measure()
    except UserError as error:
        print(error, file=sys.stderr)
        return 1
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    for name in missed:
        print(f"MISSED: {name}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
