"""What devices counted while they were watched, where it is too much and not a fault of its own."""

import re
from collections.abc import Callable, Mapping

from host.doctor.findings import Finding, Level
from host.doctor.watching import Watched

Counts = Mapping[str, int]
_SHARE = 0.01  # of packets, frames or pictures; ten times as much is a fault by the drivers
_CABLE = "use a short cable, or a hub with a supply of its own"


def too_often(watched: Watched) -> list[Finding]:
    """A finding of each count that went up too far."""
    found = []
    for device in watched.health:
        counts = watched.since(device)
        for what, next_step, is_too_much in _SIGNS:
            if is_too_much(counts):
                number = {name: count for name, count in counts.items() if count}
                said = re.sub(r"\b1 times", "once", what.format_map(_Zeros(number)))
                found.append(Finding(device, Level.WARN, said, next_step))
    return found


class _Zeros(dict[str, int]):
    """Counts that are not there are none."""

    def __missing__(self, name: str) -> int:
        return 0


def _share(part: str, whole: str) -> Callable[[Counts], bool]:
    return lambda counts: counts.get(part, 0) > _SHARE * max(counts.get(whole, 0), 100)


def _any(name: str) -> Callable[[Counts], bool]:
    return lambda counts: counts.get(name, 0) > 0


# What it says, the next step, and when.
_SIGNS: tuple[tuple[str, str, Callable[[Counts], bool]], ...] = (
    (
        "its connection was lost {connections} times and came back",
        "check the plug and the cable; secure the plug against shocks",
        _any("connections"),
    ),
    (
        "it restarted {restarts} times, or its clock jumped",
        "check its supply: a motor that starts may pull it down",
        _any("restarts"),
    ),
    (
        "{checksum_errors} of {packets} packets had a wrong checksum",
        f"{_CABLE}; a weak supply does it, too",
        _share("checksum_errors", "packets"),
    ),
    (
        "{refused} of {frames} frames were damaged",
        _CABLE,
        _share("refused", "frames"),
    ),
    (
        "{lost} of its reports were lost",
        "close other programs; use another USB port",
        _share("lost", "frames"),
    ),
    (
        "{torn} of {pictures} pictures were torn",
        _CABLE,
        _share("torn", "pictures"),
    ),
    (
        "{repeated} of {pictures} pictures came twice",
        "unplug the camera for some seconds",
        _share("repeated", "pictures"),
    ),
    (
        "its clock jumped {clock_restarts} times",
        "restart Motive; let nothing set the clock of its computer during a session",
        # A lidar has the count, too: of a host that was too busy to read.
        lambda counts: counts.get("clock_restarts", 0) > 0 and "bodies" in counts,
    ),
)
