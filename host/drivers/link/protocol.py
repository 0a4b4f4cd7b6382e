"""What robots send each other: total odometry in a signed datagram of 88 bytes. Pure.

    magic "SWL1", robot (uint16), two bytes of 0, session, sequence, sent (uint64 each),
    age (float32), 4 bytes of 0, x, y, heading (float64 each), variances of translation and of
    heading (float32 each), HMAC-SHA256 of all that by the shared key, cut to 16 bytes

Little-endian. session: when the sender began, calendar time in us. sent: since then, us, by a
clock that only rises. age: how long before that the odometry is of, s. x, y (m), heading (rad, not
wrapped): the pose since the session's start, so that lost datagrams lose no motion; variances (m²,
rad²) have summed up since then.

Nobody without the key can make one. One that was recorded is refused: of each robot a datagram
must be newer than the last one, and of now by the calendar.
"""

import hashlib
import hmac
import math
import struct
from collections import Counter
from dataclasses import dataclass

import numpy as np

from host.drivers.clock import ClockSync
from host.geometry import to_frame
from host.messages import TeammateOdometry

MAGIC = b"SWL1"
_BODY = struct.Struct("<4sHHQQQfIdddff")
_TAG_BYTES = 16
DATAGRAM_BYTES = _BODY.size + _TAG_BYTES
_FARTHEST_M, _MOST_RAD, _OLDEST_S = 1e6, 1e6, 10.0


@dataclass(frozen=True, slots=True)
class Report:
    """A robot's odometry at one moment. pose: x, y (m), heading (rad), since its session's start.

    session us, sequence, sent us, age s, variances (m², rad²): see this file's head.
    """

    robot: int
    session: int
    sequence: int
    sent: int
    age: float
    pose: tuple[float, float, float]
    variances: tuple[float, float]


def encode(report: Report, key: bytes) -> bytes:
    """The datagram of a report."""
    body = _BODY.pack(
        MAGIC,
        report.robot,
        0,
        report.session,
        report.sequence,
        report.sent,
        report.age,
        0,
        *report.pose,
        *report.variances,
    )
    return body + _tag(body, key)


def decode(datagram: bytes, key: bytes) -> Report | str:
    """A report; or why it is none: "foreign" (not ours), "forged" (another key), "malformed"."""
    if len(datagram) != DATAGRAM_BYTES or not datagram.startswith(MAGIC):
        return "foreign"
    body, tag = datagram[: _BODY.size], datagram[_BODY.size :]
    if not hmac.compare_digest(tag, _tag(body, key)):
        return "forged"
    _, robot, _, session, sequence, sent, age, _, x, y, heading, along, turning = _BODY.unpack(body)
    report = Report(robot, session, sequence, sent, age, (x, y, heading), (along, turning))
    return report if _possible(report) else "malformed"


def _tag(body: bytes, key: bytes) -> bytes:
    return hmac.new(key, body, hashlib.sha256).digest()[:_TAG_BYTES]


def _possible(report: Report) -> bool:
    x, y, heading = report.pose
    return (
        abs(x) < _FARTHEST_M
        and abs(y) < _FARTHEST_M
        and abs(heading) < _MOST_RAD
        and 0.0 <= report.age < _OLDEST_S
        and all(0.0 <= variance < math.inf for variance in report.variances)
    )


@dataclass
class _Sender:
    clock: ClockSync
    last: Report
    time: float  # of the last report's odometry, host, s


class Receiver:
    """Makes displacements of what others send. own: this robot's number, whose datagrams come back.

    counts: datagrams by what became of them. twins: how many came from a robot of our number.
    """

    def __init__(self, key: bytes, own: int, session: int, clock_tolerance_s: float) -> None:
        names = ("heard", "foreign", "forged", "malformed", "old", "repeated")
        self.counts = Counter(dict.fromkeys(names, 0))
        self.twins = 0
        self.off_clock: dict[int, float] = {}  # robots, and how far their calendar is off, s
        self._key = key
        self._own = own
        self._session = session
        self._tolerance_s = clock_tolerance_s
        self._senders: dict[int, _Sender] = {}

    def feed(self, datagram: bytes, arrival: float, calendar: float) -> TeammateOdometry | None:
        """What a datagram adds. arrival: host time, s; calendar: the same moment since 1970, s."""
        report = decode(datagram, self._key)
        if isinstance(report, str):
            self.counts[report] += 1
            return None
        if report.robot == self._own:
            self.twins += report.session != self._session
            return None
        off = calendar - (report.session + report.sent) * 1e-6
        if abs(off) > self._tolerance_s:
            self.counts["old"] += 1
            self.off_clock[report.robot] = off
            return None
        self.off_clock.pop(report.robot, None)
        return self._newer(report, arrival)

    def _newer(self, report: Report, arrival: float) -> TeammateOdometry | None:
        """A report that is newer than the robot's last one; totals have what was between."""
        known = self._senders.get(report.robot)
        if known is not None:
            last = known.last
            if (report.session, report.sequence) <= (last.session, last.sequence):
                self.counts["repeated"] += 1
                return None
        self.counts["heard"] += 1
        began = known is None or known.last.session != report.session
        clock = ClockSync() if known is None or began else known.clock
        time = clock.update(report.sent % (1 << 32), arrival) - report.age
        self._senders[report.robot] = _Sender(clock, report, time)
        if known is None or began:
            restarted = known is not None
            return TeammateOdometry(time, report.robot, 0.0, 0.0, 0.0, 0.0, restarted=restarted)
        return _between(known, report, time)


def _between(known: _Sender, report: Report, time: float) -> TeammateOdometry:
    """Eq. 18's dq_i: from one total displacement to the next."""
    before = known.last
    dx, dy = to_frame(np.array([report.pose[:2]]), np.array(before.pose))[0]
    along, turning = (
        max(0.0, now - then) for now, then in zip(report.variances, before.variances, strict=True)
    )
    return TeammateOdometry(
        time=time,
        identity=report.robot,
        interval=max(0.0, time - known.time),
        dx=float(dx),
        dy=float(dy),
        dpsi=report.pose[2] - before.pose[2],
        translation_variance=along,
        heading_variance=turning,
    )
