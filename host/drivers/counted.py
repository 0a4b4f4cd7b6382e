"""What a device counted in the last seconds, where it is too much and not a fault of its own."""

import re
from collections import deque
from collections.abc import Callable, Mapping

Counts = Mapping[str, int]
WINDOW_S = 30.0
_SHARE = 0.01  # of packets, frames or pictures; ten times as much is a fault by the drivers
_CABLE = "use a short cable, or a powered hub"


class Counted:
    """Takes a device's counts, from its first ok on, and says which went up too far."""

    def __init__(self) -> None:
        self._past: deque[tuple[float, Counts]] = deque()  # host time, s

    def remarks(self, now: float, ok: bool, counts: Counts) -> list[str]:
        """What went up too far in the last WINDOW_S before `now` (s), each with what to do."""
        if ok or self._past:
            self._past.append((now, counts))
        while len(self._past) > 1 and self._past[1][0] <= now - WINDOW_S:
            self._past.popleft()
        if not ok:
            return []
        before = self._past[0][1]
        news = {name: count - before.get(name, 0) for name, count in counts.items()}
        return [_said(what, news) for what, is_too_much in _SIGNS if is_too_much(news)]


def _said(what: str, news: Counts) -> str:
    return re.sub(r"\b1 times", "once", what.format_map(news))


def _share(part: str, whole: str) -> Callable[[Counts], bool]:
    return lambda news: whole in news and news.get(part, 0) > _SHARE * max(news[whole], 100)


def _any(name: str) -> Callable[[Counts], bool]:
    return lambda news: news.get(name, 0) > 0


# What it says with the next step, and when.
_SIGNS: tuple[tuple[str, Callable[[Counts], bool]], ...] = (
    (
        "its connection was lost {connections} times and came back: check the plug and the cable, "
        "and secure the plug against shocks",
        _any("connections"),
    ),
    (
        "it restarted {restarts} times, or its clock jumped: check its supply, which a motor that "
        "starts may pull down",
        _any("restarts"),
    ),
    (
        "{checksum_errors} of {packets} packets had a wrong checksum: "
        f"{_CABLE}, and check the supply",
        _share("checksum_errors", "packets"),
    ),
    (
        f"{{refused}} of {{frames}} frames were damaged: {_CABLE}",
        _share("refused", "frames"),
    ),
    (
        "{lost} of its reports were lost: close other programs, or use another USB port",
        _share("lost", "frames"),
    ),
    (
        f"{{torn}} of {{pictures}} pictures were torn: {_CABLE}",
        _share("torn", "pictures"),
    ),
    (
        "{repeated} of {pictures} pictures came twice: unplug the camera for some seconds",
        _share("repeated", "pictures"),
    ),
    (
        "its clock jumped {clock_restarts} times: restart Motive, and let nothing set the clock of "
        "its computer during a session",
        # A lidar has the count, too: of a host that was too busy to read.
        lambda news: news.get("clock_restarts", 0) > 0 and "bodies" in news,
    ),
)
