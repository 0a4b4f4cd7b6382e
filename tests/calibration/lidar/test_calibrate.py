"""The lidar's mounting and delay, from teammates it saw while motion capture did."""

import math
import os
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from host.calibration.chain import BODY, Entry
from host.calibration.gathered import Gathered
from host.calibration.lidar.calibrate import calibrate, lidar_advice
from host.calibration.report.text import check_cells
from host.calibration.result import Calibration
from host.config import Lidar, RobotConfig
from host.errors import UserError
from host.geometry import Path
from host.messages import Bodies, FloatArray, Positions, Scan
from host.perception.turrets import turrets
from host.simulation.offline import Simulation
from host.simulation.world.scenarios import parse_scenario

LIMITS = np.array([math.radians(0.1), 0.003, 0.003, 0.005])
RADIUS_M = 0.0325
TURN_S, SAMPLES = 1.0 / 7.0, 480

Course = Callable[[FloatArray], FloatArray]  # times (k,) -> poses (k, 3) on the floor


@dataclass(frozen=True)
class Bench:
    """A robot and teammates on courses, without a simulator: posts and walls are not needed.

    mounting: x, y (m), heading (rad), delay (s) of the lidar. wrong: share of turrets that are
    shown somewhere else.
    """

    own: Course
    teammates: tuple[Course, ...]
    mounting: tuple[float, float, float, float] = (0.01, 0.0, math.radians(3.0), 0.08)
    wrong: float = 0.0
    seconds: float = 36.0
    noise_m: float = 0.003
    seed: int = 0

    def gather(self, config: RobotConfig | None = None) -> Gathered:
        gathered = Gathered(config or RobotConfig())
        for message in (*self._bodies(), *self._scans()):
            gathered.take(message)
        return gathered

    def _bodies(self) -> list[Bodies]:
        times = np.arange(-0.5, self.seconds + 0.5, 0.01)
        poses = np.stack([course(times) for course in (self.own, *self.teammates)], axis=1)
        numbers = np.arange(1, len(self.teammates) + 2)
        return [Bodies(float(t), numbers, p) for t, p in zip(times, poses, strict=True)]

    def _scans(self) -> list[Scan]:
        random = np.random.default_rng(self.seed)
        x, y, heading, delay = self.mounting
        angles = -math.pi + np.arange(SAMPLES) * (math.tau / SAMPLES)
        scans = []
        for start in np.arange(0.0, self.seconds, TURN_S):
            times = start + TURN_S * np.arange(SAMPLES) / SAMPLES
            own = self.own(times)
            lidar = own[:, :2].copy()
            lidar[:, 0] += x * np.cos(own[:, 2]) - y * np.sin(own[:, 2])
            lidar[:, 1] += x * np.sin(own[:, 2]) + y * np.cos(own[:, 2])
            beam = np.exp(1j * (angles + heading + own[:, 2]))
            ranges = np.full(SAMPLES, math.inf)
            for course in self.teammates:
                offset = course(times)[:, :2] - lidar
                turned = (offset[:, 0] + 1j * offset[:, 1]) / beam
                half = RADIUS_M**2 - turned.imag**2
                hit = (half > 0.0) & (turned.real > 0.0)
                if random.random() < self.wrong:
                    hit = np.roll(hit, random.integers(SAMPLES))
                    ranges = np.where(hit, random.uniform(0.4, 2.3), ranges)
                    continue
                near = turned.real - np.sqrt(np.maximum(half, 0.0))
                ranges = np.where(hit, np.minimum(ranges, near), ranges)
            returned = np.isfinite(ranges)
            noise = self.noise_m * random.standard_normal(SAMPLES)
            ranges = np.where(returned, ranges + noise, 0.0)
            scans.append(Scan(float(times[-1]) + delay, times + delay, angles, ranges))
        return scans


def standing(x: float, y: float) -> Course:
    return lambda times: np.tile((x, y, 0.0), (len(times), 1))


def lawn_mower(times: FloatArray) -> FloatArray:
    """To and fro over 1.6 x 1.2 m at changing speed, with a turn left or right at each end."""
    phase = 0.35 * times + 0.3 * np.sin(0.4 * times)
    x = 0.8 * np.sin(phase)
    y = 0.6 * np.sin(0.23 * phase)
    heading = 1.6 * np.sin(phase + 0.5) + 2.2 * np.sin(0.31 * times)
    return np.stack((x, y, heading), axis=1)


def circle(times: FloatArray) -> FloatArray:
    """A circle of 0.5 m at 0.3 m/s."""
    angle = 0.6 * times
    return np.stack((0.5 * np.cos(angle), 0.5 * np.sin(angle), angle + 0.5 * math.pi), axis=1)


def misses(found: Calibration, mounting: tuple[float, float, float, float]) -> FloatArray:
    """Errors (4,) of heading, x, y, delay, in units of what is allowed."""
    x, y, heading, delay = mounting
    rows = {row.key: row.value for row in found.fitted}
    names = ("heading_rad", "x_m", "y_m", "delay_s")
    values = np.array([rows[f"lidar.{name}"] for name in names])
    miss = values - (heading, x, y, delay)
    miss[0] = (miss[0] + math.pi) % math.tau - math.pi
    return np.abs(miss) / LIMITS


@pytest.mark.parametrize("wrong", [0.0, 0.3, 0.6])
def test_mounting_and_delay_are_found_though_sightings_are_wrong(wrong: float) -> None:
    bench = Bench(lawn_mower, (standing(1.3, 0.4),), wrong=wrong, seconds=60.0)
    found = calibrate(bench.gather())
    assert np.all(misses(found, bench.mounting) < 1.0)
    assert found.failures == []
    # Of the wrong ones some do not look like a turret: the search for candidates refuses them.
    assert found.figures["used"] / found.figures["candidates"] > 0.9 - wrong


@pytest.mark.parametrize("turned_deg", [-90.0, 180.0])
def test_a_lidar_turned_by_any_angle_is_found(turned_deg: float) -> None:
    mounting = (-0.06, 0.03, math.radians(turned_deg), 0.25)
    teammates = (standing(1.3, 0.4), standing(-0.9, -1.2), standing(-1.0, 1.1))
    bench = Bench(lawn_mower, teammates, mounting, wrong=0.2, seconds=24.0)
    found = calibrate(bench.gather())
    assert np.all(misses(found, mounting) < 1.0)
    assert abs(found.new_settings()["lidar.heading_rad"]) <= math.pi


def test_the_configured_delay_is_in_the_times_already() -> None:
    bench = Bench(lawn_mower, (standing(1.3, 0.4),), (0.0, 0.0, 0.0, 0.03))
    config = RobotConfig(lidar=Lidar(delay_s=0.05, x_m=0.2))
    found = calibrate(bench.gather(config))
    assert np.all(misses(found, (0.0, 0.0, 0.0, 0.08)) < 1.0)
    before = {row.key: row.before for row in found.fitted}
    assert before["lidar.delay_s"] == 0.05
    assert before["lidar.x_m"] == 0.2


def test_a_delay_beyond_those_searched_is_refused_in_words_that_fit() -> None:
    found = calibrate(Bench(lawn_mower, (standing(1.3, 0.4),), (0.0, 0.0, 0.0, 1.03)).gather())
    beyond = next(check for check in found.checks if check.name.startswith("delays searched"))
    assert (beyond.value, beyond.side, beyond.passed) == (0.0, "at least", False)
    assert "-500 to 1000 ms, the longest fits" in beyond.advice
    assert check_cells(beyond)[1:] == ("≥ 10 ms", "fails")


def test_a_circle_at_constant_speed_is_refused() -> None:
    found = calibrate(Bench(circle, (standing(1.3, 0.4),)).gather())
    delay = next(check for check in found.checks if check.name.startswith("delay"))
    assert not delay.passed
    assert "rotate both ways" in delay.advice
    assert any("delay" in failure for failure in found.failures)
    low, high = found.figures["plausible_delays_s"]
    assert high - low > 0.5
    assert all(row.sigma > limit for row, limit in zip(found.fitted[:4], LIMITS, strict=True))
    assert "rotate to the right by 180 deg: 0 so far" in lidar_advice(
        Bench(circle, (standing(1.3, 0.4),)).gather()
    )


def test_a_robot_that_stands_learns_no_mounting() -> None:
    gathered = Bench(standing(0.0, 0.0), (standing(1.0, 0.2),), seconds=30.0).gather()
    try:
        failures = calibrate(gathered).failures
    except UserError as error:
        failures = [str(error)]
    assert failures
    wanted = " ".join(lidar_advice(gathered))
    for words in ("rotate to the left", "rotate to the right", "behind", "come from 0.5 to 2 m"):
        assert words in wanted


def test_a_teammate_seen_ahead_alone_is_not_enough() -> None:
    def facing(times: FloatArray) -> FloatArray:
        poses = lawn_mower(times)
        poses[:, 2] = 0.5 * np.sin(0.9 * times)
        return poses

    found = calibrate(Bench(facing, (standing(2.0, 0.0),)).gather())
    bearings = next(check for check in found.checks if check.name == "bearings covered")
    assert not bearings.passed
    assert "behind" in bearings.advice


def test_pictures_and_halves_tell_the_same_story() -> None:
    bench = Bench(lawn_mower, (standing(1.3, 0.4),), wrong=0.2)
    found = calibrate(bench.gather())
    for row, limit in zip(found.fitted[:4], LIMITS, strict=True):
        assert row.halves is not None
        assert abs(row.halves[0] - row.halves[1]) < 2.0 * limit
        assert 0.0 < row.sigma < limit
    titles = [picture.title for picture in found.pictures]
    assert titles == [
        "Coverage",
        "Residuals by range",
        "Residuals by bearing",
        "Delay",
        "Before and after",
    ]
    curve = found.pictures[3].series[0]
    assert curve.x[np.argmin(curve.y)] == pytest.approx(80.0, abs=10.1)
    before, after = (np.hypot(s.x, s.y) for s in found.pictures[4].series)
    assert np.median(before) > 10.0 * np.median(after)
    for picture in found.pictures:
        for series in picture.series:
            assert series.role
            assert series.x.shape == series.y.shape
            assert np.isfinite(series.x).all()
            assert np.isfinite(series.y).all()


def test_a_bias_along_the_beam_is_told_and_does_not_move_the_mounting() -> None:
    bench = Bench(lawn_mower, (standing(1.3, 0.4),))
    gathered = bench.gather()
    gathered.scans = [
        replace(turn, ranges=np.where(turn.ranges > 0.0, turn.ranges + 0.015, 0.0))
        for turn in gathered.scans
    ]
    found = calibrate(gathered)
    too_far = found.fitted[-1]
    assert too_far.key == ""
    assert too_far.value == pytest.approx(0.015, abs=0.004)
    assert "too far along the beam" in found.pictures[1].caption
    assert np.all(misses(found, bench.mounting) < 1.0)


def test_nothing_to_fit_is_told_in_words() -> None:
    full = Bench(lawn_mower, (standing(1.3, 0.4),), seconds=5.0).gather()
    alone = Bench(lawn_mower, (), seconds=5.0).gather()
    with pytest.raises(UserError, match="no teammate"):
        calibrate(alone)
    blind = Gathered(RobotConfig())
    blind.bodies = full.bodies
    with pytest.raises(UserError, match="no turrets"):
        calibrate(blind)
    dark = Gathered(RobotConfig())
    dark.scans = full.scans
    with pytest.raises(UserError, match="no motion capture"):
        calibrate(dark)
    late = Gathered(RobotConfig())
    late.scans = full.scans
    late.bodies = [replace(frame, time=frame.time + 100.0) for frame in full.bodies]
    with pytest.raises(UserError, match="no mounting"):
        calibrate(late)
    assert lidar_advice(blind) == ["no revolution of the lidar yet"]
    assert lidar_advice(dark) == ["motion capture has seen nothing yet"]


MOUNTED = (0.01, 0.0, math.radians(3.0), 0.08)


def simulated(seed: int, seconds: float) -> Gathered:
    """What a robot of arena4 gathers, by the bytes of its simulated devices."""
    x, y, heading, delay = MOUNTED
    config = RobotConfig(lidar=Lidar(x_m=x, y_m=y, heading_rad=heading))
    scenario = parse_scenario(f"arena4:seconds={seconds},seed={seed},camera_hz=0.1,mocap_hz=100")
    gathered = Gathered(RobotConfig())
    for message in Simulation(scenario, config).messages():
        if isinstance(message, Scan):
            message = replace(message, time=message.time + delay, times=message.times + delay)
        gathered.take(message)
    return gathered


@pytest.fixture
def _third_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of all turrets that are found (posts are among them), 30 % are somewhere else."""
    random = np.random.default_rng(7)
    find = turrets.find

    def spoilt(turn: Scan, lidar: Lidar, path: Path) -> Positions:
        found = find(turn, lidar, path)
        positions = found.positions.copy()
        wrong = random.random(len(positions)) < 0.3
        reach, angle = random.uniform((0.2, -math.pi), (2.5, math.pi), (wrong.sum(), 2)).T
        positions[wrong] = np.stack((reach * np.cos(angle), reach * np.sin(angle)), axis=1)
        return replace(found, positions=positions)

    monkeypatch.setattr(turrets, "find", spoilt)


@pytest.mark.usefixtures("_third_wrong")
def test_the_simulated_robot_finds_its_lidar() -> None:
    gathered = simulated(0, 45.0)
    assert lidar_advice(gathered) == []
    found = calibrate(gathered)
    assert np.all(misses(found, MOUNTED) < 1.0)
    assert found.failures == []


@pytest.mark.slow
@pytest.mark.usefixtures("_third_wrong")
def test_sigmas_are_honest_over_simulated_drives() -> None:
    """SWARMLOC_SEEDS=30 drives more of them, and -s shows what comes out."""
    normalised = []
    for seed in range(1, 1 + int(os.environ.get("SWARMLOC_SEEDS", "4"))):
        found = calibrate(simulated(seed, 45.0))
        sigmas = np.array([row.sigma for row in found.fitted[:4]]) / LIMITS
        miss = misses(found, MOUNTED)
        assert np.all(miss < 1.0), seed
        normalised.append((miss / sigmas) ** 2)
    squares = np.mean(normalised, axis=0)
    print("normalised squared error of heading, x, y, delay:", squares, "mean", squares.mean())
    assert 0.5 < squares.mean() < 2.0


def test_sigma_carries_how_well_the_tracked_body_is_known() -> None:
    bench = Bench(lawn_mower, (standing(1.3, 0.4),), seconds=24.0)
    alone = {row.key: row.sigma for row in calibrate(bench.gather()).fitted}
    gathered = bench.gather()
    covariance = np.diag([1e-3, 2e-3, 4e-3]) ** 2
    gathered.chain.entries["wheels"] = Entry(BODY, np.zeros(3), covariance)
    gathered.truth_time_sigma = 3e-3
    chained = {row.key: row.sigma for row in calibrate(gathered).fitted}
    for key, more in (
        ("lidar.heading_rad", 4e-3),
        ("lidar.x_m", 1e-3),
        ("lidar.y_m", math.hypot(2e-3, 4e-3 * 0.01)),
        ("lidar.delay_s", 3e-3),
    ):
        assert chained[key] == pytest.approx(math.hypot(alone[key], more), rel=0.01), key
