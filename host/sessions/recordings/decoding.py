"""A recording decoded again from the bytes that its devices sent."""

from collections import deque
from collections.abc import Iterator

from host.config import RobotConfig
from host.drivers.x4.protocol import delayed
from host.messages import DeviceBytes, Displacement, Message, Scan
from host.simulation.devices.catalogue import board_entry, lidar_entry

_LIDAR, _BOARD = "lidar", "board"
_LATEST_S = 1.0  # what a recording has no place for comes at most so much later


class Redecoder:
    """Puts what the decoders make of a recording's bytes in the place of what they made then.

    Where they make the same, the messages come in the same order, and estimates are bit-identical.
    What they make now and did not then comes with the next message of its kind. A device of which
    no bytes were recorded keeps its messages.
    """

    def __init__(self, config: RobotConfig) -> None:
        self._lidar = lidar_entry(config.lidar.model)
        self._delay_s = config.lidar.delay_s
        self._decoder = self._lidar.decoder()
        self._session = board_entry(config.board.model).session(config)
        self._made: dict[str, deque[Scan | Displacement]] = {}  # by device, not yet handed out

    def of(self, messages: Iterator[Message]) -> Iterator[Message]:
        """The messages of a recording, scans and displacements made again."""
        for message in messages:
            if isinstance(message, DeviceBytes):
                self._decode(message)
                yield message
                yield from self._due(message.device, message.time - _LATEST_S)
            elif isinstance(message, Scan | Displacement):
                device = _LIDAR if isinstance(message, Scan) else _BOARD
                if device not in self._made:
                    yield message
                yield from self._due(device, message.time)
            else:
                yield message

    def _decode(self, part: DeviceBytes) -> None:
        """Take bytes in; none begin a connection."""
        if part.device not in (_LIDAR, _BOARD):
            return
        made = self._made.setdefault(part.device, deque())
        if part.device == _LIDAR and part.data:
            scans = self._decoder.feed(part.data, part.time)
            made.extend(delayed(scan, self._delay_s) for scan in scans)
        elif part.device == _LIDAR:
            self._decoder = self._lidar.decoder()
        elif part.data:
            made.extend(self._session.receive(part.data, part.time))
        else:
            self._session.connect(part.time)

    def _due(self, device: str, time: float) -> Iterator[Message]:
        """What was made of a device's bytes and is no later than `time` (s)."""
        made = self._made.get(device, deque())
        while made and made[0].time <= time:
            yield made.popleft()
