"""Does a camera see? Judged by what its pictures show, not by whether bytes come."""

from collections import Counter, deque
from collections.abc import Callable

from host.drivers.camera.appearance import Appearance, look_at
from host.errors import UserError

WINDOW_S, _FEWEST = 2.0, 60  # the rate is judged over so long, and so many periods at the least
_SLOWEST = 0.75  # of the rate that was asked for
_REMEMBERED = 8  # pictures; drivers that hang give the content of their few buffers in turn
_DIM, _BLACK, _FLAT = 60.0, 16.0, 4.0  # levels of 255
_WHITE = 0.5  # share of the picture
_LOOKS = 3  # in a row that are of no use, before it is said


class Liveness:
    """Takes the pictures of one camera and judges the last seconds.

    rate_hz: that was asked for. counts: where identical pictures are counted, as "repeated".
    """

    def __init__(self, rate_hz: float, counts: Counter[str]) -> None:
        self._rate_hz = rate_hz
        self._window = max(WINDOW_S, _FEWEST / rate_hz)
        self._counts = counts
        self._recent: deque[int] = deque(maxlen=_REMEMBERED)
        self._last = b""
        self._same = 0
        self._arrived: deque[tuple[float, int]] = deque()  # host time, pictures since the start
        self._blind = 0
        self._look: Appearance | None = None

    def is_new(self, jpeg: bytes) -> bool:
        """False where the picture is one of the last ones again: it measures nothing.

        The noise of a sensor makes each picture different. What stands before the data (a counter,
        a time) is not compared.
        """
        content = hash(jpeg[jpeg.rfind(b"\xff\xda") :])
        new = content not in self._recent
        self._recent.append(content)
        self._same = 0 if new else self._same + 1
        if not new:
            self._counts["repeated"] += 1
        self._last = jpeg
        return new

    def fault(
        self, now: float, came: int, why_slow: Callable[[], tuple[str, str]] | None
    ) -> UserError | None:
        """What is wrong at host time `now` (s), None where nothing is.

        came: how many pictures that differ the camera has sent so far, used or not. why_slow:
        its cause, as far as the source knows it, and the next step; None for a recording, which
        has its own rate and may stand still.
        """
        self._look = look_at(self._last) or self._look
        live = None if why_slow is None else self._frozen() or self._slow(now, came, why_slow)
        return live or self._shows_nothing()

    def remarks(self) -> list[str]:
        """What could be better about pictures that are of use."""
        look = self._look
        if look is None or look.level >= _DIM:
            return []
        return [f"the pictures are dim (level {look.level:.0f} of 255): switch on more light"]

    def pause(self) -> None:
        """No pictures come for now: the rate is judged again when they do."""
        self._arrived.clear()

    def _frozen(self) -> UserError | None:
        if self._same < _REMEMBERED:
            return None
        return UserError(
            f"the pictures are frozen: the last {self._same} were there before",
            "the noise of a sensor makes each one different",
            "unplug the camera for some seconds",
        )

    def _slow(
        self, now: float, came: int, why_slow: Callable[[], tuple[str, str]]
    ) -> UserError | None:
        arrived = self._arrived
        arrived.append((now, came))
        while len(arrived) > 1 and arrived[1][0] <= now - self._window:
            arrived.popleft()
        seconds = now - arrived[0][0]
        if seconds < self._window:
            return None
        rate = (came - arrived[0][1]) / seconds
        if rate >= _SLOWEST * self._rate_hz:
            return None
        why, next_step = why_slow()
        if not why and self._look is not None and self._look.level < _DIM:
            why, next_step = "the light is too dim for this exposure", "switch on more light"
        return UserError(
            f"{rate:.{0 if rate >= 3.0 else 1}f} of {self._rate_hz:g} pictures/s"
            + (f": {why}" if why else ""),
            "",
            next_step,
        )

    def _shows_nothing(self) -> UserError | None:
        look = self._look
        fault = None if look is None else _useless(look)
        self._blind = 0 if fault is None else self._blind + 1
        return fault if self._blind >= _LOOKS else None


def _useless(look: Appearance) -> UserError | None:
    if look.white > _WHITE:
        return UserError(
            f"{100 * look.white:.0f} % of the picture is white",
            "the light is too bright for the exposure, or a lamp shines into the lens",
            "keep bright light away from the lens, and start again",
        )
    if look.brightest < _BLACK:
        return UserError(
            "the pictures are black",
            "the light is off, or something covers the lens",
            "switch on the light, uncover the lens",
        )
    if look.contrast < _FLAT:
        return UserError(
            "the pictures show nothing: they are of one brightness all over",
            "something covers the lens, or the camera hangs",
            "uncover the lens; unplug the camera for some seconds",
        )
    return None
