"""Decoding NatNet frames beside the vendor's sample client for Python: the same packets.

    python tools/bench/natnet.py

natnetsdk 4.1.1 reads everything in a packet into objects and text; ours reads rigid bodies, stamps
and counts, steps over the rest by its sizes, and proves that the packet is whole.
"""

import contextlib
import io
import time

import numpy as np
from natnetsdk.NatNetClient import NatNetClient

from host.drivers.natnet.protocol import MocapDecoder, frame_of, frame_packet
from host.messages import Bodies

VERSION = (4, 1)
FRAMES, ROUNDS = 500, 5


def packets(bodies: int) -> list[bytes]:
    """Frames of so many robots somewhere on the floor."""
    random = np.random.default_rng(bodies)
    frames = []
    for number in range(FRAMES):
        seen = Bodies(number / 120.0, np.arange(1, bodies + 1), random.normal(size=(bodies, 3)))
        frame = frame_of(seen, "y", number, exposed=number + 1, transmitted=number + 2)
        frames.append(frame_packet(frame, VERSION))
    return frames


def ours(stream: list[bytes]) -> float:
    """Seconds a frame."""
    decoder = MocapDecoder(VERSION)
    begin = time.perf_counter()
    for packet in stream:
        decoder.feed(packet)
    seconds = (time.perf_counter() - begin) / len(stream)
    if decoder.counts["frames"] != len(stream):
        raise SystemExit(f"only {decoder.counts['frames']} of {len(stream)} frames were read")
    return seconds


def theirs(stream: list[bytes]) -> float:
    """Seconds a frame; what it prints goes nowhere."""
    read = NatNetClient()._NatNetClient__unpack_mocap_data
    with contextlib.redirect_stdout(io.StringIO()):
        begin = time.perf_counter()
        for packet in stream:
            read(packet[4:], len(packet) - 4, *VERSION)
        return (time.perf_counter() - begin) / len(stream)


def main() -> None:
    """Print the table: the best of some rounds each."""
    print(f"{'bodies':>6}{'swarmloc':>14}{'natnetsdk':>14}{'ratio':>8}")
    for bodies in (1, 4, 20):
        stream = packets(bodies)
        rounds = [(ours(stream), theirs(stream)) for _ in range(ROUNDS)]
        mine, other = (min(times) for times in zip(*rounds, strict=True))
        print(f"{bodies:6}{1e6 * mine:11.1f} us{1e6 * other:11.1f} us{other / mine:8.1f}")


if __name__ == "__main__":
    main()
