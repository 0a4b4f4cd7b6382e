"""One wheel was driven forward: which one moved, which encoder counted, and which way?

Signs are as the robot is set up now: what is found reversed is to be toggled.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from host.config import Motors
from host.doctor.findings import Finding, Level
from host.messages import FloatArray

SIDES = ("left", "right")
MOVED_M = 0.02  # of a wheel's travel; less is no movement


@dataclass(frozen=True, slots=True)
class WheelTest:
    """side: 0 left, 1 right, of the wheel that was driven forward.

    counted (2,) m: travel of the wheels (left, right) by their encoders. seen (2,) m: the same by
    the lidar; None where it could not follow.
    """

    side: int
    counted: FloatArray
    seen: FloatArray | None


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """settings: what to change in robot.toml, by dotted key, so that it is right."""

    finding: Finding
    settings: Mapping[str, bool] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        return self.finding.level == Level.OK


def diagnose(test: WheelTest, motors: Motors) -> Diagnosis:
    """Findings from the test of one wheel about its motor and encoder."""
    name, other = SIDES[test.side], SIDES[1 - test.side]
    counted, seen = _mover(test.counted), None if test.seen is None else _mover(test.seen)
    if seen is None or test.seen is None:
        return _without_lidar(test, counted, motors)
    if seen != test.side:
        return _other_wheel(test, test.seen, counted)
    if counted is None:
        return _bad(
            f"the {name} wheel turned, but its encoder hardly counted",
            f"check the leads of the {name} encoder and its 5 V",
        )
    if counted != test.side:
        return _bad(
            f"the {name} wheel turned, and the {other} encoder counted: the encoders are exchanged",
            "exchange the leads of the two encoders",
        )
    return _which_way(test.side, test.seen[test.side] > 0.0, test.counted[test.side] > 0.0, motors)


def _other_wheel(test: WheelTest, moved: FloatArray, counted: int | None) -> Diagnosis:
    """By the lidar the other wheel turned. moved (2,) m: the wheels' travel by the lidar."""
    name, other = SIDES[test.side], SIDES[1 - test.side]
    if counted == test.side and test.counted[test.side] > 0.0 > moved[1 - test.side]:
        return _bad(
            f"the {name} encoder counted forward, but the lidar saw the {other} wheel go backward: "
            "as if the lidar looked the other way",
            f"look which wheel turns. The {name} one: heading_rad of [lidar] is off by half a "
            f"revolution, swarmloc calibrate lidar. The {other} one: exchange the motors' leads",
        )
    what = f"commanded to the {name}, the {other} wheel turned"
    if counted == test.side:
        return _bad(
            f"{what}, which the {name} encoder counted: the sides are exchanged",
            "exchange both plugs of left and right",
        )
    return _bad(f"{what}: the motors' leads are exchanged", "exchange the plugs of the two motors")


def _which_way(side: int, moved_forward: bool, counted_forward: bool, motors: Motors) -> Diagnosis:
    name = SIDES[side]
    wrong = {
        f"{name}_reversed": not moved_forward,
        f"{name}_encoder_reversed": moved_forward != counted_forward,
    }
    settings = {
        f"motors.{key}": not getattr(motors, key) for key, is_wrong in wrong.items() if is_wrong
    }
    if not settings:
        return Diagnosis(Finding("board", Level.OK, f"the {name} wheel and its encoder go forward"))
    parts = [
        part
        for part, is_wrong in zip(("motor", "encoder"), wrong.values(), strict=True)
        if is_wrong
    ]
    verb = "are" if len(parts) == 2 else "is"
    what = f"the {name} {' and the '.join(parts)} {verb} reversed"
    step = "in robot.toml set " + ", ".join(
        f"{key.partition('.')[2]} = {str(value).lower()}" for key, value in settings.items()
    )
    return Diagnosis(Finding("board", Level.FAIL, what, step), settings)


def _without_lidar(test: WheelTest, counted: int | None, motors: Motors) -> Diagnosis:
    """Findings from the encoders alone, if the lidar saw no motion."""
    name, other = SIDES[test.side], SIDES[1 - test.side]
    if counted is None:
        return _bad(
            f"the {name} wheel was driven; nothing moved, and no encoder counted",
            f"where the {other} wheel turned: the leads of the {name} motor; where none did: motor "
            "switch and motor jumpers of the board, 7.5 V at M_VIN, its fuse",
        )
    if counted != test.side:
        return _bad(
            f"commanded to the {name}, the {other} encoder counted",
            "exchange the plugs of the motors, or those of the encoders: look which wheel turns",
        )
    if test.counted[test.side] < 0.0:
        return _bad(
            f"the {name} wheel was driven forward and its encoder counted backward",
            f"look which way it turns: forward, toggle {name}_encoder_reversed in robot.toml; "
            f"backward, toggle {name}_reversed; or test on the floor, where the lidar sees it",
        )
    return Diagnosis(
        Finding(
            "board",
            Level.OK,
            f"the {name} encoder counts forward; whether the wheel did, the lidar does not show: "
            "wheels in the air, or too few revolutions",
        )
    )


def _bad(what: str, next_step: str) -> Diagnosis:
    return Diagnosis(Finding("board", Level.FAIL, what, next_step))


def _mover(travel: FloatArray) -> int | None:
    """The wheel that went further, None where neither moved, or both did."""
    further = int(np.argmax(np.abs(travel)))
    alone = abs(travel[further]) > 2.0 * abs(travel[1 - further])
    return further if alone and abs(travel[further]) >= MOVED_M else None
