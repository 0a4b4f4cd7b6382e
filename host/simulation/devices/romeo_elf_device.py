"""The board with its real machine code, as a device at byte level among simulated ones."""

from collections.abc import Callable
from pathlib import Path

from host.simulation.devices.romeo_elf import LEFT, RIGHT, STEPS_PER_COUNT, RomeoElf

SAMPLE_S = 0.002  # the wheels' speed is taken as constant for so long


class RomeoElfDevice:
    """What RomeoStandIn is, but run by the firmware itself: bytes in, bytes out, at times given.

    Times are the simulation's, in seconds, and do not run backward. Its port is open from the
    moment the host has found it: 0.12 s after each start. board: the simulated hardware.
    """

    def __init__(
        self,
        elf: Path,
        ticks: Callable[[float], tuple[int, int]],
        start: float = 0.0,
        encoder_edges: int = 2,
    ) -> None:
        """ticks: encoder counts (left, right) at a time since some beginning, forward positive; it
        is asked for times up to SAMPLE_S ahead.

        start: when it is switched on, s. encoder_edges: as of RomeoElf.
        Raises UserError as RomeoElf does.
        """
        self.board = RomeoElf(elf, encoder_edges)
        self._ticks = ticks
        self._start = start
        self._first_ticks = ticks(start)
        self._steps_per_count = STEPS_PER_COUNT[encoder_edges]
        self._opening = False
        self._samples = 0

    def receive(self, data: bytes, now: float) -> None:
        """Bytes from the host arrive at `now`. Raises UserError where the firmware crashes."""
        self._run(now)
        self.board.send(data)

    def transmit(self, now: float) -> list[tuple[float, bytes]]:
        """What the host read since the last call, up to `now`: (time, a packet's bytes), in order.

        Raises UserError where the firmware crashes.
        """
        self._run(now)
        return [(self._start + time, data) for time, data in self.board.take()]

    def reset(self, now: float) -> None:
        """As the reset button does."""
        self._run(now)
        self.board.reset()

    def _run(self, now: float) -> None:
        """By whole samples, so that how often it is asked changes nothing."""
        until = now - self._start
        while self.board.now < until:
            if self.board.now >= self._samples * SAMPLE_S:
                self._samples += 1
                self._keep_open()
                self._turn_wheels()
            self.board.run(min(self._samples * SAMPLE_S, until))

    def _turn_wheels(self) -> None:
        end = self._samples * SAMPLE_S
        counts = self._ticks(self._start + end)
        for wheel in (LEFT, RIGHT):
            wanted = (counts[wheel] - self._first_ticks[wheel]) * self._steps_per_count
            self.board.turn(wheel, wanted - self.board.steps[wheel], end)

    def _keep_open(self) -> None:
        closed = self.board.configured and not self.board.port_open
        if closed and not self._opening:
            self.board.open_port()
        self._opening = closed
