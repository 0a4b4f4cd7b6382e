"""How a device driver reports its state: at each change, and once per second."""

from collections.abc import Callable, Mapping

from host.drivers.counted import Counted
from host.drivers.pace import Pace
from host.messages import Health


class HealthReporter:
    """Makes the Health messages of one device.

    device: its name in them. clock: host time in s. period_s: how often an unchanged state is
    repeated. pace: says each time how long the driver waits for its device. To what a driver says
    of a device that is ok it adds what the counts of the last seconds say.
    """

    def __init__(self, device: str, clock: Callable[[], float], period_s: float = 1.0) -> None:
        self._device = device
        self._clock = clock
        self.pace = Pace(clock)
        self._counted = Counted()
        self._period_s = period_s
        self._state: tuple[bool, str] | None = None
        self._next = 0.0

    def report(
        self,
        emit: Callable[[Health], None],
        ok: bool,
        reason: str,
        counts: Callable[[], Mapping[str, int]],
        certain: bool = False,
    ) -> None:
        """Emit Health where `ok` or `reason` changed, or the last message is a period old.

        ok: it delivers. reason: in words, see `Health`. counts: returns what it counted so far.
        certain: what is wrong shows in something else than how much came when; else it may be
        this computer that is slow, and it is named where it is.
        """
        slow = None if ok or certain else self.pace.fault()
        reason = reason if slow is None else str(slow)
        now = self._clock()
        if self._state == (ok, reason) and now < self._next:
            return
        # Judgements come once a period: one that is a little early must not wait for the next.
        self._state, self._next = (ok, reason), now + 0.9 * self._period_s
        counted = dict(counts())
        remarks = self._counted.remarks(now, ok, counted)
        emit(Health(now, self._device, ok, "; ".join([reason, *remarks]), counted))
