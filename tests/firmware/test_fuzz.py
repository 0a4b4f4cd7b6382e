"""A million bytes of noise and a hundred thousand broken frames, to the real machine code."""

import random
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from host.drivers.romeo.framing import encode
from host.drivers.romeo.protocol import DisplacementFrame, HelloFrame, IdentityFrame, VelocityFrame
from tests.firmware.boards import ElfBoard, mutated, refused_by_board

SEED = 2026
CHUNK = 20_000  # bytes between two looks at the wheels


def feed(board: ElfBoard, data: bytes) -> list[DisplacementFrame]:
    """Send it, as fast as the board takes it; the wheels must stand still all the while."""
    board.send(data)
    reports = []
    while board.elf.unsent:
        received = board.run(0.05)
        assert board.driving == (0, 0), f"seed {SEED}"
        reports += [frame for _, frame in received if isinstance(frame, DisplacementFrame)]
    return reports


def check_alive(board: ElfBoard, bad: int) -> None:
    """It answers the next good frame, and has counted the bad ones."""
    board.send(b"\0" + encode(HelloFrame()))
    frames = [frame for _, frame in board.run(0.1)]
    assert any(isinstance(frame, IdentityFrame) for frame in frames), f"seed {SEED}"
    reports = [frame for frame in frames if isinstance(frame, DisplacementFrame)]
    assert reports[-1].bad_frames == min(bad, 65535), f"seed {SEED}"
    assert board.decoder.counts.refused == 0
    assert board.elf.restarts == 0


@pytest.mark.slow
def test_a_megabyte_of_noise(elf: Callable[[int], Path]) -> None:
    rng = random.Random(SEED)
    board = ElfBoard(elf(2), 2)
    noise = rng.randbytes(1_000_000)
    bad, frames = refused_by_board(noise + b"\0")
    assert frames == [], "a frame came about by chance: take another seed"
    for k in range(0, len(noise), CHUNK):
        feed(board, noise[k : k + CHUNK])
    check_alive(board, bad)
    board.send(encode(VelocityFrame(500, -500)))
    board.run(0.1)
    assert board.driving == (1, -1)


def broken_frames(rng: random.Random, count: int) -> Iterator[bytes]:
    """Mutated frames that are still broken: a mutation may undo itself or hit the CRC."""
    while count:
        data = mutated(rng)
        if not refused_by_board(data)[1]:
            count -= 1
            yield data


@pytest.mark.slow
def test_a_hundred_thousand_broken_frames(elf: Callable[[int], Path]) -> None:
    rng = random.Random(SEED)
    for _ in range(2):  # the count of bad frames ends at 65535
        board = ElfBoard(elf(4), 4)
        expected = 0
        for _ in range(25):
            data = b"".join(broken_frames(rng, 2000))
            expected += refused_by_board(data)[0]
            feed(board, data)
        assert expected > 45_000
        check_alive(board, expected)
