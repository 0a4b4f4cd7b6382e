"""The state of an X4 as text: why it is silent, and what is wrong with its bytes."""

from dataclasses import dataclass

from host.drivers.x4.commands import X4_MODELS, DeviceInfo
from host.drivers.x4.formats import unknown_format
from host.errors import UserError

_DAMAGED_SHARE = 0.1
_LOST_SHARE = 0.02


@dataclass(frozen=True, slots=True)
class Identity:
    """Which lidar it is. one_way: it answers no command; info: as far as it answered."""

    one_way: bool
    info: DeviceInfo | None


def why_silent(refused: bytes, samples_came: bool, identity: Identity) -> UserError:
    """Why no sound packet comes. refused: the last bytes, where bytes came that are none."""
    if refused:
        return _format_error(refused) or UserError(
            "the lidar sends only damaged packets",
            "the cable is poor, the supply too weak, or another program reads the same port",
            "use a short cable and a supply of 1 A or more; sudo fuser -v PORT names programs",
        )
    if samples_came:
        return UserError(
            "the lidar stopped sending",
            "its motor stands still or its supply failed",
            "check that it turns freely and has 1 A or more at the POWER lead",
        )
    if identity.one_way:
        return UserError(
            "the lidar sends nothing",
            "it has no power, its cable to the adapter is loose, or the port is another's",
            "check its supply and leads, and model and port in [lidar] of robot.toml",
        )
    return UserError(
        "the lidar answers but sends no samples",
        "its motor does not turn: it is powered by a separate lead",
        "connect the second USB lead (POWER, USB_PWR) to a supply of 1 A or more",
    )


def damage(change: dict[str, int], recent: bytes) -> UserError | None:
    """What is wrong with the last bytes. change: of the counts in a second; recent: some 4 kB."""
    bad = change["checksum_errors"] + change["implausible_packets"]
    share = bad / max(1, bad + change["packets"])
    if share <= _DAMAGED_SHARE:
        return None
    return _format_error(recent) or UserError(
        f"{100 * share:.0f} % of the packets are damaged: use a short cable and a supply "
        "of 1 A or more, and close other programs on the port"
    )


def _format_error(recent: bytes) -> UserError | None:
    found = unknown_format(recent)
    if found is None:
        return None
    return UserError(
        "the lidar's packets have an unknown format",
        f"it sends {found}",
        "check the label below the lidar: X4 and X4 Pro are supported",
    )


def in_words(change: dict[str, int], rate_hz: float, identity: Identity, motor_switch: bool) -> str:
    """How a lidar does that does well. change: what was counted in the last second."""
    words = [f"scanning at {rate_hz:.1f} revolutions/s" if rate_hz else "scanning"]
    lost = change["points_lost"] / max(1, change["points_lost"] + change["points"])
    if lost > _LOST_SHARE:
        words.append(f"{100 * lost:.0f} % of the samples are lost")
    info = identity.info
    if identity.one_way:
        words.append("answers no command, as an X4 Pro")
    elif info is not None:
        words.append(f"firmware {info.firmware}")
        if info.model not in X4_MODELS:
            words.append(f"unknown model code {info.model}, read as an X4")
    if not motor_switch:
        words.append("motor stays on")
    elif info is not None:  # both would not fit on a line of the screen
        words.append(f"serial {info.serial}")
    return ", ".join(words)
