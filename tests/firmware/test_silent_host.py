"""The port is open and nobody reads: the board loses whole frames, and nothing else."""

from collections.abc import Callable
from pathlib import Path

import pytest

from host.drivers.romeo.framing import BoardDecoder, encode
from host.drivers.romeo.protocol import DisplacementFrame, HelloFrame
from tests.firmware.boards import ElfBoard

SECONDS = 10
LONGEST_LOOP_S = 0.002


@pytest.mark.parametrize("edges", [2, 4])
def test_a_host_that_does_not_read_costs_whole_frames_and_no_time(
    elf: Callable[[int], Path], edges: int
) -> None:
    board = ElfBoard(elf(edges), edges)
    board.send(encode(HelloFrame()))
    before = [f for _, f in board.turn(600, -600, 0.1) if isinstance(f, DisplacementFrame)]
    board.elf.watch("loop")
    board.elf.clear_figures()
    board.elf.reading = False
    unread = board.turn(6000 * SECONDS, -6000 * SECONDS, SECONDS)
    assert unread == []
    passes = board.elf.passes
    assert passes.count > 10_000
    assert passes.worst_cycles / 16e6 < LONGEST_LOOP_S
    board.elf.reading = True
    after = [f for _, f in board.turn(600, -600, 0.1) if isinstance(f, DisplacementFrame)]
    after += [f for _, f in board.run(0.1) if isinstance(f, DisplacementFrame)]
    assert board.decoder.counts.refused == 0, "a frame came in pieces"
    assert (after[-1].left_ticks, after[-1].right_ticks) == (
        1200 + 6000 * SECONDS,
        -1200 - 6000 * SECONDS,
    )
    # What was neither read before, nor lay in the buffers, nor came after, is what it says it lost.
    numbers = [frame.sequence for frame in before + after]
    missing = numbers[-1] - numbers[0] + 1 - len(numbers)
    assert after[-1].dropped_frames == missing
    assert missing == pytest.approx(50 * SECONDS, abs=8)


def test_a_closed_port_gets_no_frames_and_drops_none(elf: Callable[[int], Path]) -> None:
    board = ElfBoard(elf(2), 2)
    last = [f for _, f in board.run(0.1) if isinstance(f, DisplacementFrame)][-1]
    board.elf.close_port()
    board.run(0.05)
    assert board.turn(500, 500, 5.0) == []
    board.elf.open_port()
    first, *_ = [f for _, f in board.run(0.1) if isinstance(f, DisplacementFrame)]
    assert first.dropped_frames == 0
    assert first.left_ticks == first.right_ticks == 500
    assert (first.sequence - last.sequence) % 2**16 < 6


def test_answers_that_find_no_room_are_dropped_whole(elf: Callable[[int], Path]) -> None:
    board = ElfBoard(elf(2), 2)
    board.elf.reading = False
    for _ in range(50):
        board.send(encode(HelloFrame()))
        board.run(0.01)
    board.elf.reading = True
    received = board.run(0.2)
    assert board.decoder.counts.refused == 0
    displacements = [frame for _, frame in received if isinstance(frame, DisplacementFrame)]
    assert displacements[-1].dropped_frames > 50


def test_each_frame_is_sent_at_once_as_a_packet_of_its_own(elf: Callable[[int], Path]) -> None:
    """Nothing waits in the USB buffer for the core's interrupt to send it off with the next."""
    board = ElfBoard(elf(2), 2)
    board.send(encode(HelloFrame()) * 3)
    board.elf.run(board.now + 0.05)
    packets = [BoardDecoder().feed(data) for _, data in board.elf.take()]
    assert len(packets) >= 5
    assert [len(frames) for frames in packets] == [1] * len(packets)
