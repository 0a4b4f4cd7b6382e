"""Exposure, white balance, gain and focus of a camera: chosen from its pictures, and held.

Times are set as multiples of a half period of the mains, at which lamps on it do not beat. Pictures
decide what suits the light, and whether the camera does what it reads back.
"""

from collections.abc import Generator

from host.drivers.camera.appearance import Appearance, look_at, mean_of
from host.drivers.camera.held_controls import (
    AUTO_EXPOSURE,
    AUTO_FOCUS,
    AUTO_GAIN,
    AUTO_WHITE,
    DYNAMIC_RATE,
    EXPOSURE,
    EXPOSURE_UNIT_S,
    FOCUS,
    GAIN,
    MAINS,
    MANUAL_EXPOSURE,
    NAMES,
    NEEDED,
    PLAIN,
    TOLERANCE,
    WHITE,
    Adjustable,
    HeldControls,
    read,
    said,
)

_DARK, _BRIGHT = 70.0, 190.0  # levels between which a picture is exposed well
_VISIBLE, _SATURATED = 12.0, 245.0  # levels at which a change of exposure shows
_HALVINGS = 6  # of the interval of gains
_SHORTER = 4  # how often the exposure is halved in light too bright for the least gain
_SKIPPED, _AVERAGED = 4, 3  # pictures: until a setting shows in them, and to be averaged
_FOLLOWS = 1.1  # times as bright at four times the exposure, at the least
_STEADY, _LONGEST_WHITE = 0.01, 12  # warmth's change between two looks; how many looks
HELD = "exposure, white balance and gain held"  # what is said where all is well
_JUMP = 0.08  # of the warmth, when the white balance is held


class Controls:
    """What was chosen for one camera; it outlives replugging, which resets the camera itself.

    mains_hz: of the mains that lamps are on.
    """

    def __init__(self, mains_hz: int) -> None:
        self._half_period = 1.0 / (2 * mains_hz) / EXPOSURE_UNIT_S
        self._mains = 1 if mains_hz == 50 else 2
        self._controls = HeldControls()
        self._choice: Generator[None, Appearance, None] | None = None
        self._chosen = False

    @property
    def exposure_is_automatic(self) -> bool:
        """Could its automatic exposure not be switched off?"""
        return AUTO_EXPOSURE in self._controls.remarks

    def begin(self, camera: Adjustable) -> None:
        """Set what needs no picture, once it is opened. Raises OSError where it is gone."""
        self._choice = None
        for control in PLAIN:
            self._controls.reset(camera, control)
        for control in (DYNAMIC_RATE, AUTO_GAIN, AUTO_FOCUS):
            self._controls.hold(camera, control, 0)
        self._controls.hold(camera, MAINS, self._mains)
        self._controls.hold(camera, AUTO_EXPOSURE, MANUAL_EXPOSURE)
        self._controls.reset(camera, FOCUS)
        if self._chosen:
            for control, value in tuple(self._controls.held.items()):
                self._controls.hold(camera, control, value)
            return
        self._controls.reset(camera, GAIN)
        self._controls.set(camera, AUTO_WHITE, 1)
        for control in NEEDED:
            if camera.range_of(control) is None:
                self._controls.remarks[control] = (
                    f"{NAMES[control]} not held: the camera has no such control"
                )

    def advance(self, camera: Adjustable, jpeg: bytes) -> bool:
        """Take the next picture into account; True once all is chosen. Raises OSError."""
        if self._chosen:
            return True
        look = look_at(jpeg)
        if look is None:
            return False
        try:
            if self._choice is None:
                self._choice = self._choose(camera)
                next(self._choice)
            else:
                self._choice.send(look)
        except StopIteration:
            self._chosen = True
        return self._chosen

    def _choose(self, camera: Adjustable) -> Generator[None, Appearance, None]:
        """Each yield takes the next picture."""
        if camera.range_of(EXPOSURE) is not None:
            yield from self._choose_exposure(camera)
        yield from self._choose_white(camera)

    def _choose_exposure(self, camera: Adjustable) -> Generator[None, Appearance, None]:
        half = self._half_period
        short = yield from self._look(camera, EXPOSURE, half / 4)
        look = yield from self._look(camera, EXPOSURE, half)
        if _VISIBLE < look.level < _FOLLOWS * short.level and short.level < _SATURATED:
            self._controls.remarks["exposure"] = (
                "exposure not held: the pictures do not follow what the camera reads back"
            )
        if look.level < _DARK:
            look = yield from self._look(camera, EXPOSURE, 2 * half)
        gain = camera.range_of(GAIN)
        if gain is not None and look.level < _DARK:
            look = yield from self._choose_gain(camera, gain.default, gain.maximum)
        elif gain is not None and look.level > _BRIGHT:
            look = yield from self._choose_gain(camera, gain.minimum, gain.default)
        for k in range(1, _SHORTER + 1):
            if look.level <= _BRIGHT:
                break
            look = yield from self._look(camera, EXPOSURE, half / 2**k)
        self._remark_on_light(look)

    def _remark_on_light(self, look: Appearance) -> None:
        exposure = self._controls.held.get(EXPOSURE, 0)
        held = said(EXPOSURE, exposure)
        if look.level < _DARK:
            self._controls.remarks["light"] = (
                f"the light is dim for {held} and the highest gain: add some"
            )
        elif look.level > _BRIGHT:
            self._controls.remarks["light"] = (
                f"the light is too bright for {held} and the lowest gain"
            )
        elif exposure < (1.0 - TOLERANCE) * self._half_period:
            self._controls.remarks["light"] = (
                f"exposure is {held} in so bright light: lamps may flicker"
            )

    def _choose_gain(
        self, camera: Adjustable, darker: int, brighter: int
    ) -> Generator[None, Appearance, Appearance]:
        """Halve the interval of gains until pictures are well exposed."""
        for _ in range(_HALVINGS):
            middle = (darker + brighter + 1) // 2
            look = yield from self._look(camera, GAIN, middle)
            if look.level < _DARK:
                darker = middle
            elif look.level > _BRIGHT:
                brighter = middle
            else:
                break
        return look

    def _choose_white(self, camera: Adjustable) -> Generator[None, Appearance, None]:
        """Hold the white balance where the automatic comes to rest."""
        before = yield from self._next()
        for _ in range(_LONGEST_WHITE):
            look = yield from self._next()
            if abs(look.warmth - before.warmth) < _STEADY:
                break
            before = look
        if camera.range_of(WHITE) is None:
            return
        self._controls.hold(camera, AUTO_WHITE, 0)
        reached = read(camera, WHITE)
        if reached is not None:
            self._controls.hold(camera, WHITE, reached)
        held = yield from self._next()
        if abs(held.warmth - look.warmth) > _JUMP:
            self._controls.remarks["white"] = (
                "white balance held, but the colours jumped: calibrate the strip's colour again"
            )

    def _look(
        self, camera: Adjustable, control: int, value: float
    ) -> Generator[None, Appearance, Appearance]:
        """How pictures look once a control is set."""
        self._controls.hold(camera, control, value)
        return (yield from self._next())

    @staticmethod
    def _next() -> Generator[None, Appearance, Appearance]:
        """The mean of some pictures, after those that were on their way."""
        for _ in range(_SKIPPED):
            yield
        looks = []
        for _ in range(_AVERAGED):
            looks.append((yield))
        return mean_of(looks)

    def check(self, camera: Adjustable) -> list[str]:
        """Read back all that is held, set again what drifted; returns remarks.

        Raises OSError where the camera is gone.
        """
        if not self._chosen:
            return ["its exposure and white balance are being set"]
        remarks = [*self._controls.check(camera), *self._controls.remarks.values()]
        return remarks or [HELD]

    def exposure_s(self, camera: Adjustable) -> float | None:
        """How long it exposes, None where it does not say."""
        value = read(camera, EXPOSURE) if camera.range_of(EXPOSURE) else None
        return value * EXPOSURE_UNIT_S if value is not None else None

    def release(self, camera: Adjustable) -> None:
        """Leave all as it was found."""
        self._controls.release(camera)
