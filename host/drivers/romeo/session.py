"""The conversation with the board: greet it, set it up, take displacements, send speeds. Pure.

Bytes and times in, displacements and bytes out; so the same code serves the device, a replay and
the tests.
"""

from dataclasses import asdict

from host.config import RobotConfig
from host.drivers.clock import ClockSync
from host.drivers.romeo.checks import (
    ReportChecks,
    firmware_version,
    illegal_transitions,
    old_version,
    wrong_edges,
)
from host.drivers.romeo.differential_drive import displacement, distance, wheel_speeds
from host.drivers.romeo.framing import DELIMITER, BoardDecoder, encode
from host.drivers.romeo.protocol import (
    PROTOCOL_HASH,
    DisplacementFrame,
    DisplacementStatus,
    HelloFrame,
    IdentityFrame,
    SettingsFrame,
    SettingsReversed,
    VelocityFrame,
)
from host.drivers.romeo.runaway import RunawayWatch, difference
from host.messages import Displacement

ASK_PERIOD_S = 0.5  # hello, and the settings, until they are answered
VELOCITY_PERIOD_S = 0.05  # well within the board's command timeout
PATIENCE_S = 1.0  # to wait for an answer or a displacement before it is called missing
RESTART_S = 0.5  # a clock so far from what it should show restarted; frames are later by less
STILL = (0, 0)
_FLASH = "run `swarmloc flash`"


class BoardSession:
    """What is known of the board, from one connection to the next."""

    def __init__(self, robot: RobotConfig) -> None:
        self._wheels = robot.wheels
        self._wanted_settings = settings_for(robot)
        self._decoder = BoardDecoder()
        self._clock = ClockSync()
        self._counts = {"connections": 0, "restarts": 0, "lost": 0}
        self._by_board = {"dropped_by_board": 0, "refused_by_board": 0}
        self._checks = ReportChecks()
        self._runaway = RunawayWatch(robot.motors.runaway_s)
        self._connected, self._heard, self._restarted = 0.0, False, False
        # The board's clock (us) when it was last heard at a host time, over all connections.
        self._heard_clock: tuple[int, float] | None = None
        self._greet(0.0)

    def connect(self, now: float) -> None:
        """A port was opened at `now` (s): ask the device for its identity."""
        self._counts["connections"] += 1
        self._decoder.feed(DELIMITER)
        self._connected, self._heard, self._restarted = now, False, False
        self._greet(now)

    def _greet(self, now: float) -> None:
        self._identity: IdentityFrame | None = None
        self._settings: SettingsFrame | None = None  # as the board answered
        self._lost_settings = False
        self._next_question = now
        self._last_report = now
        self._next_velocity = now
        self._sent = STILL
        # The last frame that a displacement ended with, and the host time of it.
        self._base: tuple[DisplacementFrame, float] | None = None
        self._last: DisplacementFrame | None = None
        self._clock.forget()
        self._runaway.connected()

    @property
    def greeted(self) -> bool:
        """Has the board introduced itself, and does it speak the host's protocol?"""
        return self._identity is not None and self._identity.protocol_hash == PROTOCOL_HASH

    def identity(self) -> dict[str, str]:
        """The board's identity, by name; empty before it has sent it."""
        found = self._identity
        if found is None:
            return {}
        return {
            "firmware": firmware_version(found),
            "protocol": f"{found.protocol_hash:08x}",
            "board": str(found.board),
            "edges_per_period": str(found.edges_per_period),
        }

    def receive(self, data: bytes, now: float) -> list[Displacement]:
        """The displacements that end in `data`, which arrived at `now` (s)."""
        self._heard = self._heard or bool(data)
        found = []
        for frame in self._decoder.feed(data):
            if isinstance(frame, IdentityFrame):
                self._introduce(frame, now)
            elif isinstance(frame, SettingsFrame) and self.greeted:
                # Before, it would be an answer to the last connection that nobody had read.
                self._settings = frame
            elif isinstance(frame, DisplacementFrame) and self.greeted:
                step = self._step(frame, now)
                if step is not None:
                    found.append(step)
        return found

    def _introduce(self, frame: IdentityFrame, now: float) -> None:
        before = self.greeted
        self._identity = frame
        if self.greeted and not before:
            self._last_report = self._next_question = now
        self._restarted = False

    def _step(self, frame: DisplacementFrame, now: float) -> Displacement | None:
        restarts = self._clock.restarts
        time = self._clock.update(frame.board_time_us, now)
        if frame.status & DisplacementStatus.FRESH or self._clock.restarts != restarts:
            self._counts["restarts"] += 1
            self._restarted = True
            self._heard_clock = None
            self._greet(now)
            return None
        if self._last is None:
            self._counts["restarts"] += self._restarted_unseen(frame.board_time_us, now)
        else:
            self._counts["lost"] += (frame.sequence - self._last.sequence - 1) % (1 << 16)
            self._checks.noise(illegal_transitions(frame, self._last), now)
        self._runaway.take(frame, self._sent, now)
        self._last, self._last_report = frame, now
        self._heard_clock = frame.board_time_us, now
        self._by_board = {
            "dropped_by_board": frame.dropped_frames,
            "refused_by_board": frame.bad_frames,
        }
        if frame.status & DisplacementStatus.SETTINGS_DEFAULTED:
            self._lost_settings = True
        if self._settings is None:
            return None
        if self._base is None:
            self._base = frame, time
            return None
        base, base_time = self._base
        if time <= base_time:
            # The clock has just learned that frames travel faster than it took them to; the
            # counters run on, so the next displacement brings these ticks too.
            return None
        self._base = frame, time
        left = difference(frame.left_ticks, base.left_ticks)
        right = difference(frame.right_ticks, base.right_ticks)
        illegal = illegal_transitions(frame, base)
        step = displacement(self._wheels, time, time - base_time, left, right, illegal)
        self._checks.compare(base, frame, step, distance(self._wheels, left, right), now)
        return step

    def _restarted_unseen(self, board_time_us: int, now: float) -> bool:
        """Did the board restart since the last connection? Its USB port goes with it."""
        if self._heard_clock is None:
            return False
        before_us, then = self._heard_clock
        gone_s = difference(board_time_us, before_us + round((now - then) * 1e6)) * 1e-6
        return abs(gone_s) > RESTART_S + ClockSync.LARGEST_DRIFT * (now - then)

    def transmit(self, now: float, wanted: tuple[int, int] | None) -> bytes:
        """What to send at `now` (s). wanted: ticks/s (left, right), or None to command nothing."""
        if not self.greeted:
            return self._ask(HelloFrame(), now)
        if self._settings is None:
            # Not before its first report, which shows whether it had lost the stored ones.
            return self._ask(self._wanted_settings, now) if self._last else b""
        if self._runaway.active and (wanted is None or self._runaway.retry(now)):
            return self._end_runaway(now)
        if wanted is None:
            return self.stop() if self._sent != STILL else b""
        if wanted == self._sent and now < self._next_velocity:
            return b""
        self._sent, self._next_velocity = wanted, now + VELOCITY_PERIOD_S
        return encode(VelocityFrame(*wanted))

    def _end_runaway(self, now: float) -> bytes:
        """A stop command, once a while, until the board no longer reports the runaway state."""
        if now < self._next_velocity:
            return b""
        self._next_velocity = now + VELOCITY_PERIOD_S
        self._runaway.stopped(now)
        return self.stop()

    def _ask(self, question: HelloFrame | SettingsFrame, now: float) -> bytes:
        if now < self._next_question:
            return b""
        self._next_question = now + ASK_PERIOD_S
        return DELIMITER + encode(question)

    def stop(self) -> bytes:
        """What stops the wheels; nothing where the board would not understand it."""
        self._sent = STILL
        return encode(VelocityFrame(*STILL)) if self.greeted else b""

    def state(self, now: float) -> tuple[bool, str]:
        """Whether the board works; if not, why and what to do, as text."""
        identity = self._identity
        if identity is None:
            return False, self._unanswered(now)
        if not self.greeted:
            return False, (
                f"firmware speaks {identity.protocol_hash:08x}, host speaks {PROTOCOL_HASH:08x}: "
                + _FLASH
            )
        if now > self._last_report + PATIENCE_S:
            return False, "the board fell silent: check its power, press its reset button"
        if self._settings is None:
            return False, "sending the board its settings"
        return self._findings(identity, self._settings, now)

    def _findings(
        self, identity: IdentityFrame, settings: SettingsFrame, now: float
    ) -> tuple[bool, str]:
        """Of a board that reports: what makes its reports or its motors useless, else remarks."""
        edges_fault, edges_remark = wrong_edges(identity, self._wheels)
        faults = [self._runaway.fault(now), edges_fault, self._checks.fault(now)]
        stored = ", settings sent from robot.toml" * self._lost_settings
        remarks = [
            f"firmware {firmware_version(identity)}{stored}",
            old_version(identity),
            *self._about_settings(settings),
            edges_remark,
            *self._checks.remarks(),
            self._runaway.remark(now),
        ]
        reasons = [reason for reason in (*faults, *remarks) if reason]
        return not any(faults), "; ".join(reasons)

    def _about_settings(self, settings: SettingsFrame) -> list[str]:
        wanted = asdict(self._wanted_settings)
        others = [
            f"{name} {value} instead of {wanted[name]}"
            for name, value in asdict(settings).items()
            if value != wanted[name]
        ]
        return ["it can only set " + ", ".join(others)] * bool(others)

    def _unanswered(self, now: float) -> str:
        if self._restarted and now < self._last_report + PATIENCE_S:
            return (
                "the board restarted (power dip, reset button or watchdog) or its clock stood "
                "still: greeting it again"
            )
        if now < self._connected + PATIENCE_S:
            return "waiting for the board to answer"
        if self._heard:
            return f"it sends bytes, but not this firmware's: {_FLASH}"
        return "the board does not answer: press its reset button; if that does not help, " + _FLASH

    def counts(self) -> dict[str, int]:
        """Frames and events since the session was made, by name."""
        decoded = self._decoder.counts
        return {
            "frames": decoded.accepted,
            "refused": decoded.refused,
            "frames_delayed": self._clock.late,
            **self._counts,
            **self._by_board,
            "illegal_left": self._checks.illegal[0],
            "illegal_right": self._checks.illegal[1],
            "runaways": self._runaway.count,
            "odometry_disagreements": self._checks.disagreements,
        }


def settings_for(robot: RobotConfig) -> SettingsFrame:
    """The board's settings: of [motors], [board] and [wheels]; speeds in ticks of these wheels."""
    motors = robot.motors
    ticks_per_metre = sum(wheel_speeds(robot.wheels, 1.0, 0.0)) / 2.0
    return SettingsFrame(
        report_rate_hz=robot.board.report_rate_hz,
        reversed=(
            motors.left_reversed * SettingsReversed.LEFT_MOTOR
            | motors.right_reversed * SettingsReversed.RIGHT_MOTOR
            | motors.left_encoder_reversed * SettingsReversed.LEFT_ENCODER
            | motors.right_encoder_reversed * SettingsReversed.RIGHT_ENCODER
        ),
        full_speed=min(round(motors.full_speed_mps * ticks_per_metre), 0xFFFF),
        proportional=round(16.0 * motors.proportional),
        integral=round(16.0 * motors.integral_per_s),
        acceleration=min(round(motors.acceleration_mps2 * ticks_per_metre), 0xFFFF),
        runaway=round(1e3 * motors.runaway_s),
        left_radius=round(1e9 * robot.wheels.left_radius_m),
        right_radius=round(1e9 * robot.wheels.right_radius_m),
        track=round(1e9 * robot.wheels.track_m),
        counts_per_turn=robot.wheels.counts_per_turn,
    )
