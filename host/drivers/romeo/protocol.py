"""The board's frames as values: one frozen dataclass a frame.

Written by tools/generate_protocol.py from firmware/romeo_odometry/protocol.toml.
Do not edit; `framing` packs and unpacks them.
"""

from dataclasses import dataclass
from enum import IntFlag
from struct import Struct
from typing import ClassVar

PROTOCOL_HASH = 0x1ACD120C
# Major, minor, patch of the firmware in this repository.
FIRMWARE_VERSION = (0, 2, 0)
# Largest id + fields, and the same with CRC, COBS byte and delimiter, in bytes.
LARGEST_FRAME = 32
LARGEST_ENCODED = 36

# [ms] without a velocity frame for so long, both wheels stop
COMMAND_TIMEOUT_MS = 150
# [Hz] displacement frames a second, by default
REPORT_RATE_HZ = 50
# [Hz] lowest report rate
REPORT_RATE_MIN_HZ = 10
# [Hz] highest report rate
REPORT_RATE_MAX_HZ = 100
# [ticks/s] settings.full_speed by default: 160 revolutions a minute of 1920 ticks each
FULL_SPEED_TICKS_PER_S = 5120
# [ticks/s] lowest settings.full_speed
FULL_SPEED_MIN_TICKS_PER_S = 100
# [1/16] settings.proportional by default
PROPORTIONAL_16THS = 32
# [1/16 s] settings.integral by default
INTEGRAL_16THS_PER_S = 128
# [ticks/s2] settings.acceleration by default
ACCELERATION_TICKS_PER_S2 = 14000
# [ticks/s2] lowest settings.acceleration
ACCELERATION_MIN_TICKS_PER_S2 = 100
# [ms] settings.runaway by default
RUNAWAY_MS = 300
# [nm] settings.left_radius and right_radius by default: wheels of 65 mm
RADIUS_NM = 32500000
# [nm] largest settings.left_radius and right_radius
RADIUS_MAX_NM = 1000000000
# [nm] settings.track by default
TRACK_NM = 144000000
# [nm] smallest settings.track
TRACK_MIN_NM = 10000000
# [ticks] settings.counts_per_turn by default
COUNTS_PER_TURN = 1920
# [ticks] smallest settings.counts_per_turn
COUNTS_PER_TURN_MIN = 4
# [1] identity.board of a DFRobot Romeo V2
BOARD_ROMEO_V2 = 1


@dataclass(frozen=True, slots=True)
class HelloFrame:
    """Host to board. Who are you? The board answers with identity, at any time and as often as
    asked."""

    ID: ClassVar[int] = 0x01
    LAYOUT: ClassVar[Struct] = Struct("<B")


@dataclass(frozen=True, slots=True)
class IdentityFrame:
    """Board to host. The answer to hello.

    protocol_hash [1]: hash of the definition the firmware was built with.
    version_major [1]: firmware version.
    version_minor [1]: firmware version.
    version_patch [1]: firmware version.
    board [1]: kind of board, one of the board_ constants.
    edges_per_period [1]: encoder edges that are counted in one period of a channel: 2 or 4.
    """

    ID: ClassVar[int] = 0x02
    LAYOUT: ClassVar[Struct] = Struct("<BIBBBBB")

    protocol_hash: int
    version_major: int
    version_minor: int
    version_patch: int
    board: int
    edges_per_period: int


class DisplacementStatus(IntFlag):
    """Bits of `DisplacementFrame.status`."""

    # no hello since start: a host that has said hello learns from it that the board restarted
    FRESH = 0x01
    # the last velocity is older than the command timeout: wheels stopped; clear before the first
    COMMAND_TIMED_OUT = 0x02
    # the stored settings were missing or damaged: defaults are in force until the next write
    SETTINGS_DEFAULTED = 0x04
    # the left motor was driven hard and its encoder did not follow for settings.runaway: both
    # motors are off until a velocity frame of zero
    LEFT_RUNAWAY = 0x08
    # the same of the right motor
    RIGHT_RUNAWAY = 0x10


@dataclass(frozen=True, slots=True)
class DisplacementFrame:
    """Board to host. How far the wheels have turned; sent at the report rate, whether or not
    they move.

    sequence [frames]: counts up by one a frame, dropped ones included.
    board_time_us [us]: micros() when both counters were read; wraps after 71.6 min.
    left_ticks [ticks]: running count of the left encoder since start, forward positive, modulo
    2^32.
    right_ticks [ticks]: running count of the right encoder since start, forward positive, modulo
    2^32.
    distance_um [um]: running distance since start, forward positive, modulo 2^32.
    heading_urad [urad]: running heading since start, counter-clockwise positive, modulo 2^32
    (not modulo a rotation).
    status [bits]: see the bits.
    left_illegal [edges]: illegal transitions of the left encoder since start, modulo 2^16: too
    short or too fast for a wheel, so noise or missed edges.
    right_illegal [edges]: the same of the right encoder; with 4 edges a period, one too short to
    show whose it was is counted for both.
    dropped_frames [frames]: not sent since start because the host did not read; stays at 65535.
    bad_frames [frames]: received since start and refused (COBS, CRC, id or length); stays at
    65535.
    """

    ID: ClassVar[int] = 0x10
    LAYOUT: ClassVar[Struct] = Struct("<BHIiiiiBHHHH")

    sequence: int
    board_time_us: int
    left_ticks: int
    right_ticks: int
    distance_um: int
    heading_urad: int
    status: int
    left_illegal: int
    right_illegal: int
    dropped_frames: int
    bad_frames: int


@dataclass(frozen=True, slots=True)
class VelocityFrame:
    """Host to board. Target wheel speeds, in force until the next one or the command timeout.
    Both zero is the stop command, which also ends the runaway state.

    left_ticks_per_s [ticks/s]: left wheel, forward positive.
    right_ticks_per_s [ticks/s]: right wheel, forward positive.
    """

    ID: ClassVar[int] = 0x11
    LAYOUT: ClassVar[Struct] = Struct("<Bhh")

    left_ticks_per_s: int
    right_ticks_per_s: int


@dataclass(frozen=True, slots=True)
class ReadSettingsFrame:
    """Host to board. The board answers with settings."""

    ID: ClassVar[int] = 0x20
    LAYOUT: ClassVar[Struct] = Struct("<B")


class SettingsReversed(IntFlag):
    """Bits of `SettingsFrame.reversed`."""

    # level high on the left direction pin drives backward
    LEFT_MOTOR = 0x01
    # level high on the right direction pin drives backward
    RIGHT_MOTOR = 0x02
    # the left encoder counts down when driving forward
    LEFT_ENCODER = 0x04
    # the right encoder counts down when driving forward
    RIGHT_ENCODER = 0x08


@dataclass(frozen=True, slots=True)
class SettingsFrame:
    """Both ways. To the board: store these and use them from now on. From the board: those in
    force; its answer to read_settings and to a write (values out of range are brought to the
    nearest bound).

    report_rate_hz [Hz]: displacement frames a second, between report_rate_min_hz and
    report_rate_max_hz.
    reversed [bits]: what is wired the other way round, see the bits.
    full_speed [ticks/s]: of a wheel that runs freely at full duty; the control's feed-forward is
    target / full_speed.
    proportional [1/16]: control: share of full duty for an error of full_speed.
    integral [1/16 s]: control: share of full duty for each second of an error of full_speed.
    acceleration [ticks/s2]: the target speed is followed no faster; a command timeout stops at
    once.
    runaway [ms]: a motor that is driven hard for so long while its encoder makes less than a
    quarter of the target speed, or counts the other way, switches both off; 0 for boards without
    encoders: never.
    left_radius [nm]: rolling radius of the left wheel.
    right_radius [nm]: rolling radius of the right wheel.
    track [nm]: distance between the left and the right wheel.
    counts_per_turn [ticks]: of one revolution of a wheel.
    """

    ID: ClassVar[int] = 0x21
    LAYOUT: ClassVar[Struct] = Struct("<BBBHBBHHIIII")

    report_rate_hz: int
    reversed: int
    full_speed: int
    proportional: int
    integral: int
    acceleration: int
    runaway: int
    left_radius: int
    right_radius: int
    track: int
    counts_per_turn: int


Frame = (
    HelloFrame
    | IdentityFrame
    | DisplacementFrame
    | VelocityFrame
    | ReadSettingsFrame
    | SettingsFrame
)
FRAMES: dict[int, type[Frame]] = {
    HelloFrame.ID: HelloFrame,
    IdentityFrame.ID: IdentityFrame,
    DisplacementFrame.ID: DisplacementFrame,
    VelocityFrame.ID: VelocityFrame,
    ReadSettingsFrame.ID: ReadSettingsFrame,
    SettingsFrame.ID: SettingsFrame,
}
