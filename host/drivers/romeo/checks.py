"""What a board reports of itself, held against robot.toml and against its own ticks. Pure."""

from collections import deque

from host.config import Wheels
from host.drivers.romeo.protocol import FIRMWARE_VERSION, DisplacementFrame, IdentityFrame
from host.drivers.romeo.runaway import WHEELS, difference
from host.messages import Displacement

# Of counts_per_turn against edges and periods: tyres and gears vary by less, wirings by twice.
FITTING = (0.8, 1.25)
NOISE_S, NOISY_EDGES = 10.0, 10  # so many illegal transitions in so many seconds are reported
# The board rounds to 1 um or urad at both ends of an interval, its settings to 1 nm.
ROUNDING, RELATIVE = 3e-6, 1e-6
SHOWN_S = 10.0
_FLASH = "run `swarmloc flash`"


def illegal_transitions(frame: DisplacementFrame, base: DisplacementFrame) -> tuple[int, int]:
    """Illegal transitions of the encoders (left, right) from one frame to a later one."""
    return (
        (frame.left_illegal - base.left_illegal) % (1 << 16),
        (frame.right_illegal - base.right_illegal) % (1 << 16),
    )


def wrong_edges(identity: IdentityFrame, wheels: Wheels) -> tuple[str, str]:
    """Do the edges the firmware counts fit counts_per_turn? A fault and a remark, or "".

    Twice or half is the other wiring's value, and every distance is wrong: a fault. Another misfit
    may be another motor.
    """
    periods, edges, counts = (
        wheels.periods_per_turn,
        identity.edges_per_period,
        wheels.counts_per_turn,
    )
    if not periods or not edges:
        return "", ""
    expected = periods * edges
    ratio = counts / expected
    if FITTING[0] < ratio < FITTING[1]:
        return "", ""
    finding = (
        f"the firmware counts {edges} edges in each of {periods} periods a revolution of a wheel, "
        f"which makes {expected}, but counts_per_turn is {counts}"
    )
    for factor, other in ((2.0, edges // 2), (0.5, edges * 2)):
        if FITTING[0] < ratio * factor < FITTING[1] and other in (2, 4):
            return (
                f"{finding}, as for {other} edges: set counts_per_turn = {expected}, or build the "
                f"firmware with ENCODER_EDGES {other}"
            ), ""
    return "", f"{finding}: for another motor set periods_per_turn, too"


def firmware_version(identity: IdentityFrame) -> str:
    """As it is written: 1.2.3."""
    return f"{identity.version_major}.{identity.version_minor}.{identity.version_patch}"


def old_version(identity: IdentityFrame) -> str:
    """Names firmware that is older than this program's; "" where it is not."""
    version = identity.version_major, identity.version_minor, identity.version_patch
    if version >= FIRMWARE_VERSION:
        return ""
    return f"older than this program's {'.'.join(map(str, FIRMWARE_VERSION))}: {_FLASH}"


class ReportChecks:
    """Each report against the one before: noise of the encoders, and the board's own odometry."""

    def __init__(self) -> None:
        self.illegal = [0, 0]
        self.disagreements = 0
        self._noise: deque[tuple[float, tuple[int, int]]] = deque()
        self._disagreement = ("", 0.0)

    def noise(self, illegal: tuple[int, int], now: float) -> None:
        """Count illegal transitions (left, right)."""
        if any(illegal):
            self._noise.append((now, illegal))
            self.illegal = [before + new for before, new in zip(self.illegal, illegal, strict=True)]
        while self._noise and self._noise[0][0] < now - NOISE_S:
            self._noise.popleft()

    def compare(
        self,
        base: DisplacementFrame,
        frame: DisplacementFrame,
        step: Displacement,
        way: float,
        now: float,
    ) -> None:
        """Hold the board's distance and heading against those of the ticks.

        step: from the ticks between both frames. way: what it was long, m.
        """
        distance = 1e-6 * difference(frame.distance_um, base.distance_um)
        heading = 1e-6 * difference(frame.heading_urad, base.heading_urad)
        turned = abs(step.dpsi)
        if abs(distance - way) > ROUNDING + RELATIVE * (abs(way) + turned) or abs(
            heading - step.dpsi
        ) > ROUNDING + RELATIVE * (abs(way) + turned):
            self.disagreements += 1
            self._disagreement = (
                f"the board's own distance and heading ({distance:.6f} m, {heading:.6f} rad) do "
                f"not follow from its ticks ({way:.6f} m, {step.dpsi:.6f} rad), which are used: "
                f"press its reset button; if that does not help, {_FLASH}",
                now,
            )

    def fault(self, now: float) -> str:
        """Of the odometry, "" where both agree."""
        reason, at = self._disagreement
        return reason if reason and now < at + SHOWN_S else ""

    def remarks(self) -> list[str]:
        """Of each encoder that was noisy in the last NOISE_S."""
        sums = [sum(one[wheel] for _, one in self._noise) for wheel in (0, 1)]
        return [
            f"{WHEELS[wheel]} encoder: {count} illegal transitions in {NOISE_S:.0f} s, by noise on "
            "its leads or a loose one: screen them (docs/hardware.md)"
            for wheel, count in enumerate(sums)
            if count >= NOISY_EDGES
        ]
