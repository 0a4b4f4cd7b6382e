"""The wheels at work: which motor and which encoder is the other way round, by the lidar."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from host.config import Motors, RobotConfig
from host.doctor.examine import Examined, examine
from host.doctor.findings import Level
from host.doctor.spin import Spin
from host.doctor.wheels import WheelTest, diagnose
from host.drivers.computer import Computer
from host.drivers.romeo.device import Romeo
from host.drivers.x4.device import X4
from host.sources.rig import Rig
from tests.doctor.benches import Bench, x4
from tests.doctor.driven import DrivenRobot, Wiring
from tests.doctor.test_faults import alarms, cool

LEFT, RIGHT = 0, 1
# Words of each finding and of its next step, and what is to be written.
Said = list[tuple[str, str]]
WIRINGS: dict[str, tuple[Wiring, Said, dict[str, bool]]] = {
    "swapped encoder channels, mirrored side": (
        Wiring(encoder=(-1, -1), motor=(1, -1)),
        [
            ("the left encoder is the other way round", "left_encoder_reversed = true"),
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
            ("the left motor is the other way round", "left_reversed = true"),
            (
                "the right wheel turned, but its encoder counted next to nothing",
                "check the leads of the right encoder",
            ),
        ],
        {"motors.left_reversed": True},
    ),
    "exchanged wheels": (
        Wiring(drives=(1, 0), counts=(1, 0)),
        [("the sides are exchanged", "exchange both plugs")],
        {},
    ),
    "healthy": (Wiring(), [], {}),
}


def driven_rig(bench: Bench, wiring: Wiring) -> Rig:
    config = RobotConfig()
    robot = DrivenRobot(wiring, config.wheels)
    ports = {"board": bench.plug(robot.board), "lidar": bench.plug(x4(robot.sense))}
    config = config.model_copy(
        update={
            name: getattr(config, name).model_copy(update={"port": port})
            for name, port in ports.items()
        }
    )
    sources = {"lidar": X4(config.lidar), "board": Romeo(config)}
    return Rig("robot", config, "lidar", sources)


@pytest.fixture(scope="module")
def examined(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Examined]]:
    folder = tmp_path_factory.mktemp("driven")
    with Bench(folder) as bench, ThreadPoolExecutor(len(WIRINGS)) as pool:
        found = {}
        for name, (wiring, *_) in WIRINGS.items():
            rig = driven_rig(bench, wiring)
            spin = Spin(rig.sources["board"].command, rig.config)  # type: ignore[attr-defined]
            found[name] = pool.submit(examine, rig, folder, Computer(look=cool), 1.5, spin=spin)
        yield {name: future.result() for name, future in found.items()}


@pytest.mark.parametrize("name", [name for name in WIRINGS if name != "healthy"])
def test_a_wheel_that_is_wired_otherwise(name: str, examined: dict[str, Examined]) -> None:
    _, said, settings = WIRINGS[name]
    found = [f for f in examined[name].findings if f.level == Level.FAIL]
    for what, step in said:
        assert any(what in f.what and step in f.next_step for f in found), examined[name].findings
    assert examined[name].settings == settings


def test_a_robot_in_order_raises_no_alarm_and_its_sensors_are_in_time(
    examined: dict[str, Examined],
) -> None:
    found = examined["healthy"].findings
    assert [f for f in alarms(found) if f.part != "lidar"] == []  # whose pillars it sees through
    said = "; ".join(f.what for f in found)
    assert "the left wheel and its encoder go forward" in said
    assert "the right wheel and its encoder go forward" in said
    assert "ms late against the wheels" in said or "ms early against the wheels" in said
    assert examined["healthy"].settings == {}


@pytest.mark.parametrize(
    ("counted", "seen", "what", "step"),
    [
        ((0.1, 0.0), (0.0, 0.1), "the sides are exchanged", "exchange both plugs"),
        ((0.0, 0.1), (0.0, 0.1), "the motors' leads are exchanged", "plugs of the two motors"),
        ((0.0, 0.1), (0.1, 0.0), "the encoders are exchanged", "leads of the two encoders"),
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
