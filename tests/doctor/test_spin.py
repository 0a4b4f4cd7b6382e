"""The wheels at work: which motor and which encoder is the other way round, by the lidar."""

import re
from collections.abc import Mapping

import numpy as np
import pytest

from host.config import Motors, RobotConfig
from host.doctor.delays import sensor_delays
from host.doctor.findings import Finding, Level
from host.doctor.lidar_motion import LidarMotion
from host.doctor.spin import Spin
from host.doctor.watching import Watched
from host.doctor.wheels import WheelTest, diagnose
from host.drivers.romeo.differential_drive import wheel_speeds
from host.drivers.romeo.session import BoardSession
from host.drivers.x4.commands import SCAN
from host.drivers.x4.protocol import ScanDecoder
from host.geometry import wrap
from host.messages import Bearings, Displacement, Scan
from tests.doctor.benches import x4
from tests.doctor.driven import DrivenRobot, Wiring

LEFT, RIGHT = 0, 1
NOTHING_SEEN = LidarMotion(np.zeros(0), np.zeros((0, 3)))
# Words of each finding and of its next step, and what is to be written.
Said = list[tuple[str, str]]
WIRINGS: dict[str, tuple[Wiring, Said, dict[str, bool]]] = {
    "swapped encoder channels, mirrored side": (
        Wiring(encoder=(-1, -1), motor=(1, -1)),
        [
            ("the left encoder is reversed", "left_encoder_reversed = true"),
            ("the right motor and the encoder are", "right_reversed = true"),
        ],
        {
            "motors.left_encoder_reversed": True,
            "motors.right_reversed": True,
            "motors.right_encoder_reversed": True,
        },
    ),
    "reversed motor, dead encoder": (
        Wiring(motor=(-1, 1), encoder=(1, 0)),
        [
            ("the left motor is reversed", "left_reversed = true"),
            (
                "the right wheel turned, but its encoder hardly counted",
                "check the leads of the right encoder",
            ),
        ],
        {"motors.left_reversed": True},
    ),
    "dead motor": (
        Wiring(motor=(0, 1)),
        [("the left wheel was driven; nothing moved", "the leads of the left motor")],
        {},
    ),
    "exchanged wheels": (
        Wiring(drives=(1, 0), counts=(1, 0)),
        [("the sides are exchanged", "exchange both plugs")],
        {},
    ),
    "healthy": (Wiring(), [], {}),
}


class Robot:
    """Drivers' sessions and simulated devices, in virtual time: `sleep` lets it pass."""

    def __init__(self, wiring: Wiring) -> None:
        self.config = RobotConfig()
        self.watched, self.now = Watched(), 0.0
        self._robot = DrivenRobot(wiring, self.config.wheels)
        self._lidar, self._decoder = x4(self._robot.sense), ScanDecoder()
        self._session, self._command = BoardSession(self.config), (0, 0)
        self._session.connect(0.0)
        self._lidar.receive(SCAN, 0.0)
        self.sleep(2.0)

    def drive(self, speed: float, turn_rate: float) -> None:
        left, right = wheel_speeds(self.config.wheels, speed, turn_rate)
        self._command = round(left), round(right)

    def sleep(self, seconds: float) -> None:
        end = self.now + seconds
        while self.now < end:
            self.now += 0.01
            for at, data in self._robot.board.transmit(self.now):
                for step in self._session.receive(data, at):
                    self.watched.take(step)
            said = self._session.transmit(self.now, self._command)
            self._robot.board.receive(said, self.now)
            for at, data in self._lidar.transmit(self.now):
                for scan in self._decoder.feed(data, at):
                    self.watched.take(scan)


Examined = tuple[list[Finding], Mapping[str, bool]]


@pytest.fixture(scope="module")
def examined() -> dict[str, Examined]:
    found = {}
    for name, (wiring, *_) in WIRINGS.items():
        robot = Robot(wiring)
        spin = Spin(robot.drive, robot.config, lambda robot=robot: robot.now, robot.sleep)
        spin.run(robot.watched)
        found[name] = spin.findings(robot.watched)
    return found


@pytest.mark.parametrize("name", [name for name in WIRINGS if name != "healthy"])
def test_a_wheel_that_is_wired_otherwise(name: str, examined: dict[str, Examined]) -> None:
    _, said, settings = WIRINGS[name]
    findings, changes = examined[name]
    found = [f for f in findings if f.level == Level.FAIL]
    for what, step in said:
        assert any(what in f.what and step in f.next_step for f in found), findings
    assert changes == settings


def test_a_robot_in_order_raises_no_alarm_and_its_sensors_are_in_time(
    examined: dict[str, Examined],
) -> None:
    found, changes = examined["healthy"]
    assert [f for f in found if f.level != Level.OK] == []
    said = "; ".join(f.what for f in found)
    assert "the left wheel and its encoder go forward" in said
    assert "the right wheel and its encoder go forward" in said
    (late,) = re.findall(r"(\d+) ms (?:late|early) against the wheels", said)
    assert int(late) <= 50
    assert changes == {}


def test_a_lidar_that_could_not_follow_decides_nothing() -> None:
    robot = Robot(Wiring(drives=(1, 0), counts=(1, 0)))
    spin = Spin(robot.drive, robot.config, lambda: robot.now, robot.sleep)
    keep = robot.watched.take
    robot.watched.take = lambda m: None if isinstance(m, Scan) and m.time % 1.0 < 0.6 else keep(m)
    spin.run(robot.watched)
    found, changes = spin.findings(robot.watched)
    assert [f for f in found if f.level == Level.FAIL] == []
    assert "the lidar does not show" in found[0].what
    assert changes == {}


@pytest.mark.parametrize(
    ("counted", "seen", "what", "step"),
    [
        ((0.1, 0.0), (0.0, 0.1), "the sides are exchanged", "exchange both plugs"),
        ((0.0, 0.1), (0.0, 0.1), "the motors' leads are exchanged", "plugs of the two motors"),
        ((0.0, 0.1), (0.1, 0.0), "the encoders are exchanged", "leads of the two encoders"),
        ((0.1, 0.0), (0.0, -0.1), "as if the lidar looked the other way", "heading_rad of [lidar]"),
        ((0.0, 0.0), (0.0, 0.0), "nothing moved, and no encoder counted", "7.5 V at M_VIN"),
        ((-0.1, 0.0), (0.0, 0.0), "counted backward", "toggle left_encoder_reversed"),
        ((-0.1, 0.0), None, "counted backward", "backward, toggle left_reversed"),
        ((0.0, 0.1), None, "commanded to the left, the right encoder counted", "look which"),
    ],
)
def test_where_the_wires_go(
    counted: tuple[float, float], seen: tuple[float, float] | None, what: str, step: str
) -> None:
    wheel = WheelTest(LEFT, np.array(counted), None if seen is None else np.array(seen))
    diagnosis = diagnose(wheel, Motors())
    assert diagnosis.finding.level == Level.FAIL
    assert what in diagnosis.finding.what
    assert step in diagnosis.finding.next_step
    assert diagnosis.settings == {}


@pytest.mark.parametrize("motor_forward", [True, False])
@pytest.mark.parametrize("counts_forward", [True, False])
@pytest.mark.parametrize("before", [Motors(), Motors(right_reversed=True)])
def test_settings_that_are_written_make_it_right(
    motor_forward: bool, counts_forward: bool, before: Motors
) -> None:
    """Toggling changes motor and encoder as the board applies them: both then go forward."""
    seen = np.array([0.0, 0.1 if motor_forward else -0.1])
    counted = np.array([0.0, 0.1 if counts_forward else -0.1])
    changes = diagnose(WheelTest(RIGHT, counted, seen), before).settings
    toggled_motor = "motors.right_reversed" in changes
    toggled_encoder = "motors.right_encoder_reversed" in changes
    after_seen = seen * (-1.0 if toggled_motor else 1.0)
    after_counted = counted * (-1.0 if toggled_motor != toggled_encoder else 1.0)
    again = diagnose(WheelTest(RIGHT, after_counted, after_seen), before)
    assert again.ok
    for key, value in changes.items():
        assert value != getattr(before, key.partition(".")[2])


@pytest.mark.parametrize("delay", [-0.06, 0.0, 0.12, 0.2])
def test_a_camera_that_is_late_is_named_by_how_teammates_move_in_its_pictures(
    delay: float,
) -> None:
    """Teammates that walk while the robot rotates to both sides, found in four of five pictures."""
    random = np.random.default_rng(7)
    times = np.arange(0.0, 12.0, 0.02)
    rates = np.where((times > 1) & (times < 4.5), 1.0, 0.0) - ((times > 6) & (times < 9.5))
    headings = np.cumsum(rates) * 0.02
    watched = Watched()
    for at, before, heading in zip(times, [0.0, *headings], headings, strict=False):
        watched.take(Displacement(at, 0.02, 0.0, 0.0, heading - before))
    for taken in np.arange(0.5, 11.5, 0.1):
        directions = np.array([0.4, 1.9, -1.2]) + np.array([0.1, -0.15, 0.05]) * taken
        seen = wrap(directions - np.interp(taken, times, headings))
        seen = (seen + random.normal(0.0, 0.01, 3))[random.random(3) < 0.8]
        watched.take(
            Bearings(taken + delay, seen, np.full(len(seen), 1e-4), (0.0, 0.0), (0.0, 6.3),
                     camera="front")
        )  # fmt: skip
    (found,) = sensor_delays(watched, NOTHING_SEEN, (0.0, 13.0), 1)
    assert found.part == "front camera"
    (late,) = re.findall(r"(\d+) ms (?:late|early)", found.what)
    assert int(late) == pytest.approx(1e3 * abs(delay), abs=15)
    assert (found.level == Level.OK) == (abs(delay) < 0.08)
    assert found.level == Level.OK or "swarmloc calibrate camera" in found.next_step
    assert ("late" in found.what) == (delay > 0.0) or abs(delay) < 0.01
