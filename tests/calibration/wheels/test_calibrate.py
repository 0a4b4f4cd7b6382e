"""Calibration of the wheels: against drives of known geometry, the simulation, recorded runs."""

import math

import numpy as np
import pytest
from scipy.signal import lfilter

from host.calibration.gathered import Gathered
from host.calibration.report.text import check_cells
from host.calibration.wheels.calibrate import calibrate
from host.calibration.wheels.drives import drive_of_run, drives_of, wheels_advice
from host.calibration.wheels.model import Drive
from host.calibration.wheels.unseen import apply_fit, end_error, score_unseen
from host.config import Mocap, RobotConfig, Wheels
from host.drivers.romeo.differential_drive import displacement
from host.errors import UserError
from host.messages import Bodies
from host.recording.elsewhere import optiodom
from host.simulation.world.arena import Arena
from host.simulation.world.scenarios import parse_scenario
from host.simulation.world.sensors import SimulatedEncoders

TRUE = Wheels(left_radius_m=0.0331, right_radius_m=0.0321, track_m=0.151)
MOUNTED = Mocap(x_m=0.03, y_m=-0.02, heading_rad=1.2)
LAG_S = 0.03
STEP_S = 0.01
NAMES = ("wheels.left_radius_m", "wheels.right_radius_m", "wheels.track_m")
BODY = ("mocap.x_m", "mocap.y_m", "mocap.heading_rad")


def wander(random, seconds):
    """Speed (m/s) and turn rate (rad/s) at every step: new ones every 3 s."""
    count = round(seconds / STEP_S)
    pieces = math.ceil(seconds / 3.0)
    wanted = (
        random.uniform(0.1, 0.35, pieces),
        random.permutation(np.resize([0.0, 1.0, -1.0, 1.5, -1.2, 0.0], pieces)),
    )
    return [lfilter([0.05], [1.0, -0.95], np.repeat(w, 300)[:count]) for w in wanted]


def drive(speeds, turn_rates, random, *, wheels=TRUE, mocap=MOUNTED, slip=0.01, noise=(3e-4, 2e-3)):
    """Ticks and truth of a robot that drives so; a wheel's relative slip lasts 0.5 s.

    The path is summed up in small straight steps, unlike that of the code under test.
    """
    count = len(speeds)
    heading = np.cumsum(turn_rates) * STEP_S
    middle = heading - 0.5 * turn_rates * STEP_S
    x, y = (np.cumsum(speeds * side(middle)) * STEP_S for side in (np.cos, np.sin))
    keep = math.exp(-STEP_S / 0.5)
    kicks = slip * math.sqrt(1.0 - keep**2) * random.standard_normal((count, 2))
    kicks[0] = slip * random.standard_normal(2)
    slips = lfilter([1.0], [1.0, -keep], kicks, axis=0)
    ways = np.stack([speeds + s * turn_rates * wheels.track_m / 2.0 for s in (-1.0, 1.0)], axis=1)
    radii = np.array([wheels.left_radius_m, wheels.right_radius_m])
    turns = np.cumsum(ways * (1.0 + slips), axis=0) * STEP_S / (math.tau * radii)
    c, s = np.cos(heading), np.sin(heading)
    body = (
        x + c * mocap.x_m - s * mocap.y_m,
        y + s * mocap.x_m + c * mocap.y_m,
        heading + mocap.heading_rad,
    )
    truth = np.stack(body, axis=1)[::4]
    truth = truth + random.standard_normal(truth.shape) * (noise[0], noise[0], noise[1])
    times = np.arange(count) * STEP_S
    ticks = np.floor(turns * wheels.counts_per_turn).astype(np.int64)
    return Drive(times[::4] + LAG_S, ticks[::4], times[::4], truth, "made up")


def wandering(seed, seconds=60.0, **how):
    random = np.random.default_rng(seed)
    return drive(*wander(random, seconds), random, **how)


def circles(seconds, *turn_rates):
    """One drive per turn rate, all at 0.1 m/s."""
    count = round(seconds / STEP_S)
    return [
        drive(np.full(count, 0.1), np.full(count, rate), np.random.default_rng(7), noise=(0, 1e-3))
        for rate in turn_rates
    ]


def normalised(calibration, wheels, mocap):
    """Errors (6,) over their sigmas."""
    true = [wheels.left_radius_m, wheels.right_radius_m, wheels.track_m]
    true += [mocap.x_m, mocap.y_m, mocap.heading_rad]
    rows = calibration.fitted[:6]
    return np.array([(row.value - t) / row.sigma for row, t in zip(rows, true, strict=True)])


def failed(calibration):
    return [check.name for check in calibration.checks if not check.passed]


def test_without_noise_every_number_comes_back():
    found = calibrate([wandering(1, slip=0.0, noise=(0.0, 0.0))], Wheels(), Mocap())
    assert found.failures == []
    values = {row.key: row.value for row in found.fitted}
    assert [values[key] for key in NAMES] == pytest.approx([0.0331, 0.0321, 0.151], rel=2e-4)
    assert [values[key] for key in BODY] == pytest.approx([0.03, -0.02, 1.2], abs=2e-4)
    (lag,) = (row for row in found.fitted if "odometry's delay" in row.name)
    assert lag.value == pytest.approx(LAG_S, abs=1e-3)
    assert set(found.new_settings()) == {
        *NAMES,
        *BODY,
        "wheels.distance_noise_m",
        "wheels.heading_noise_rad",
        "wheels.drift_noise_rad",
    }


@pytest.fixture(scope="module")
def thirty():
    return [calibrate([wandering(k, 45.0)], Wheels(), Mocap()) for k in range(30)]


def test_sigmas_are_honest_over_30_drives(thirty):
    errors = np.array([normalised(found, TRUE, MOUNTED) for found in thirty])
    squares = (errors**2).mean(axis=0)
    assert 0.8 <= math.sqrt(squares.mean()) <= 1.25, squares


def test_sigmas_of_the_noises_are_how_far_these_scatter(thirty):
    for k in (-3, -2, -1):
        rows = [found.fitted[k] for found in thirty]
        scatter = np.std([row.value for row in rows], ddof=1)
        assert 0.6 <= np.median([row.sigma for row in rows]) / scatter <= 1.6, rows[0].name


def test_noise_is_that_of_the_slip():
    # What a slip that lasts t adds to the way in a time T: variance 2 t T (slip * speed)² a wheel.
    count = 8000
    found = calibrate(
        [
            drive(np.full(count, 0.25), np.full(count, rate), np.random.default_rng(k))
            for k, rate in enumerate((0.7, -0.7))
        ],
        Wheels(),
        Mocap(),
    )
    values = {row.key: row.value for row in found.fitted}
    wheels = np.array([0.25 - 0.7 * 0.151 / 2.0, 0.25 + 0.7 * 0.151 / 2.0])
    rate = 2.0 * 0.5 * 0.01**2 * np.sum(wheels**2)
    way = math.sqrt(rate / 4.0 / 0.25)
    heading = math.sqrt(rate / 0.151**2 / (0.7 + 0.1 * 0.25))
    assert values["wheels.distance_noise_m"] == pytest.approx(way, rel=0.3)
    assert values["wheels.heading_noise_rad"] == pytest.approx(heading, rel=0.3)


def test_drift_is_told_from_the_noise_of_turning():
    random, count = np.random.default_rng(2), 30000
    straight = np.tile(np.repeat([1.0, 0.0], 800), count // 1600 + 1)[:count]
    rates = (1.0 - straight) * 1.5 * np.where(np.arange(count) // 1600 % 2, 1.0, -1.0)
    speeds = 0.3 * straight + 0.02
    found = calibrate([drive(speeds, rates, random)], Wheels(), Mocap())
    values = {row.key: row.value for row in found.fitted}
    drift = math.sqrt(2.0 * 0.5 * 0.01**2 * 2.0 * 0.32**2 / 0.151**2 / 0.32)
    wheels = np.array([0.02 - 1.5 * 0.151 / 2.0, 0.02 + 1.5 * 0.151 / 2.0])
    turning = 2.0 * 0.5 * 0.01**2 * np.sum(wheels**2) / 0.151**2
    heading = math.sqrt((turning - drift**2 * 0.02) / 1.5)
    assert values["wheels.drift_noise_rad"] == pytest.approx(drift, rel=0.35)
    assert values["wheels.heading_noise_rad"] == pytest.approx(heading, rel=0.5)


def test_pushes_are_left_out():
    pushed = wandering(3)
    truth = pushed.truth.copy()
    for index in range(100, len(truth), 350):
        away = truth[index:, :2] - truth[index, :2]
        c, s = math.cos(0.5), math.sin(0.5)
        turned = np.stack((c * away[:, 0] - s * away[:, 1], s * away[:, 0] + c * away[:, 1]), 1)
        truth[index:, :2] = truth[index, :2] + (0.2, -0.1) + turned
        truth[index:, 2] += 0.5
    found = calibrate(
        [Drive(pushed.times, pushed.ticks, pushed.truth_times, truth)], Wheels(), Mocap()
    )
    assert failed(found) == []
    assert found.figures["windows_used"] < 0.95 * found.figures["windows"]
    assert np.abs(normalised(found, TRUE, MOUNTED)).max() < 4.0


@pytest.mark.parametrize("jump", [(5000, 0), (-300, 300), (65536, 65536), (0, 2_000_000_000)])
def test_one_corrupt_row_of_ticks_does_not_spoil_a_fit(jump, thirty):
    whole = wandering(1, 45.0)
    ticks = whole.ticks.copy()
    ticks[500:] += np.array(jump)
    found = calibrate(
        [Drive(whole.times, ticks, whole.truth_times, whole.truth)], Wheels(), Mocap()
    )
    for row, sound in zip(found.fitted[:6], thirty[1].fitted[:6], strict=True):
        assert row.value == pytest.approx(sound.value, abs=0.3 * sound.sigma), row.name
    assert "1 row(s) of ticks" in found.warnings[0]


def test_many_corrupt_rows_of_ticks_fail_a_check():
    whole = wandering(1, 15.0)
    steps = np.diff(whole.ticks, axis=0, prepend=0)
    steps[100:300:20] *= -1
    ticks = np.cumsum(steps, axis=0)
    found = calibrate(
        [Drive(whole.times, ticks, whole.truth_times, whole.truth)], Wheels(), Mocap()
    )
    assert "rows of ticks that no wheel can count" in failed(found)


@pytest.mark.parametrize(
    ("name", "speeds", "turn_rates"),
    [
        ("one circle", 0.1, 0.5),
        ("straight", 0.3, 0.0),
        ("one direction, with straights", 0.2, np.resize(np.repeat([0.0, 1.0], 300), 6000)),
    ],
)
def test_a_path_that_does_not_separate_track_from_radii_is_refused(name, speeds, turn_rates):
    random = np.random.default_rng(5)
    ones = np.ones(6000)
    found = calibrate([drive(speeds * ones, turn_rates * ones, random)], Wheels(), Mocap())
    assert "rotation to the right" in failed(found), name
    assert any("does not separate the track" in failure for failure in found.failures)


def test_a_short_drive_is_refused():
    found = calibrate([wandering(2, 8.0)], Wheels(), Mocap())
    assert "distance driven" in failed(found)


def test_a_robot_that_stood_still_is_told_so():
    still = drive(np.zeros(3000), np.zeros(3000), np.random.default_rng(0))
    with pytest.raises(UserError, match="hardly moved"):
        calibrate([still], Wheels(), Mocap())
    with pytest.raises(UserError, match="hardly moved"):
        calibrate([], Wheels(), Mocap())


def test_circles_of_one_radius_are_warned_of():
    alike = calibrate(circles(40.0, 0.4, -0.4), Wheels(), Mocap())
    assert failed(alike) == []
    assert "transfer badly" in alike.warnings[0]
    assert len(alike.warnings) == 1
    varied = calibrate([wandering(4)], Wheels(), Mocap())
    assert varied.warnings == ()


@pytest.mark.parametrize("factor", [4, 2])
def test_counts_that_are_decoded_otherwise_are_written_and_radii_kept(factor):
    told = Wheels(counts_per_turn=TRUE.counts_per_turn // factor, periods_per_turn=0)
    found = calibrate([wandering(1)], told, Mocap())
    assert found.settings == {"wheels.counts_per_turn": TRUE.counts_per_turn}
    wheels, _ = apply_fit(found, told, Mocap())
    assert wheels.counts_per_turn == TRUE.counts_per_turn
    assert wheels.left_radius_m == pytest.approx(TRUE.left_radius_m, rel=0.01)
    fine = calibrate([wandering(1)], Wheels(counts_per_turn=4 * TRUE.counts_per_turn), Mocap())
    assert fine.settings == {"wheels.counts_per_turn": TRUE.counts_per_turn}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda ticks: ticks * (-1, 1), "the left encoder counts the wrong way"),
        (lambda ticks: ticks * (1, -1), "the right encoder counts the wrong way"),
        (lambda ticks: ticks[:, ::-1], "exchanged"),
    ],
)
def test_encoders_wired_otherwise_are_found(change, message):
    good = wandering(1)
    with pytest.raises(UserError, match=message):
        calibrate(
            [Drive(good.times, change(good.ticks), good.truth_times, good.truth)], Wheels(), Mocap()
        )


def test_pictures_have_the_same_length_in_x_and_y():
    found = calibrate([wandering(1)], Wheels(), Mocap())
    assert len(found.pictures) == 4
    for picture in found.pictures:
        for series in picture.series:
            assert series.role
            assert len(series.x) == len(series.y) > 0, picture.title
            assert np.isfinite(series.x).all()
            assert np.isfinite(series.y).all()


def test_the_end_error_is_nothing_with_the_true_geometry_and_that_of_an_arc_otherwise():
    round_trip = wandering(6, 30.0, slip=0.0, noise=(0.0, 0.0))
    assert end_error(round_trip, TRUE, MOUNTED, (LAG_S, LAG_S)) < 0.005
    straight = drive(
        np.full(3000, 0.1), np.zeros(3000), np.random.default_rng(0), slip=0.0, noise=(0.0, 0.0)
    )
    larger = TRUE.model_copy(
        update={"left_radius_m": 1.02 * 0.0331, "right_radius_m": 1.02 * 0.0321}
    )
    assert end_error(straight, larger, MOUNTED) == pytest.approx(0.02 * 3.0, rel=0.03)
    report = score_unseen("x", [straight], (larger, MOUNTED), (TRUE, MOUNTED))
    assert report["source"] == "x"
    assert report["nominal_end_error_m"] > 10.0 * report["fitted_end_error_m"]
    assert [run["name"] for run in report["runs"]] == ["made up"]


@pytest.mark.parametrize("late_s", [1000.0, math.inf])
def test_a_drive_without_a_true_path_is_not_scored(late_s):
    made = wandering(6, 10.0)
    seen = made.truth_times + late_s < math.inf
    torn = Drive(made.times, made.ticks, (made.truth_times + late_s)[seen], made.truth[seen])
    with pytest.raises(UserError, match="far cannot be scored"):
        score_unseen("far", [torn], (TRUE, MOUNTED), (TRUE, MOUNTED))


def gathered(made, config):
    """The messages of a made-up drive."""
    all_of_it = Gathered(config)
    for k in range(1, len(made.times)):
        interval = float(made.times[k] - made.times[k - 1])
        left, right = (made.ticks[k] - made.ticks[k - 1]).tolist()
        all_of_it.take(displacement(config.wheels, float(made.times[k]), interval, left, right))
    for time, pose in zip(made.truth_times, made.truth, strict=True):
        all_of_it.take(Bodies(float(time), np.array([1]), pose[None]))
    return all_of_it


def test_a_drive_is_made_of_messages():
    made = wandering(1, 20.0)
    (found,) = drives_of(gathered(made, RobotConfig()))
    assert np.array_equal(np.diff(found.ticks, axis=0), np.diff(made.ticks, axis=0))
    assert found.times == pytest.approx(made.times)
    assert found.truth[:, :2] == pytest.approx(made.truth[:, :2])
    assert np.cos(found.truth[:, 2]) == pytest.approx(np.cos(made.truth[:, 2]))
    holed = gathered(made, RobotConfig())
    del holed.displacements[200:260]
    first, second = drives_of(holed)
    assert first.times[-1] == pytest.approx(made.times[200])
    assert second.times[0] == pytest.approx(made.times[260])
    assert second.truth_times[0] > first.truth_times[0]
    empty = Gathered(RobotConfig())
    with pytest.raises(UserError, match="no wheel ticks"):
        drives_of(empty)


def test_a_radius_far_below_the_configured_one_is_refused_with_its_bound_above():
    found = calibrate([wandering(1)], Wheels(right_radius_m=0.04), Mocap())
    (check,) = (check for check in found.checks if "radius" in check.name)
    assert not check.passed
    assert check.value == pytest.approx(100.0 * (1.0 - 0.0321 / 0.04), abs=1.0)
    assert check_cells(check)[1] == "≤ 15 %"
    assert "the right wheel's radius comes out -1" in check.advice


def test_advice_says_what_is_missing_until_enough_was_driven():
    assert "motion capture" in wheels_advice(Gathered(RobotConfig()))[0]
    (circle,) = circles(10.0, 0.4)
    said = "\n".join(wheels_advice(gathered(circle, RobotConfig())))
    assert "drive further than 3 m: 1.0 m so far" in said
    assert "rotate to the right" in said
    assert "straight" in said
    assert wheels_advice(gathered(wandering(1), RobotConfig())) == []


def test_in_the_simulation_sigmas_are_honest():
    config = RobotConfig()
    told = config.wheels.model_copy(
        update={"left_radius_m": 0.0319, "right_radius_m": 0.0331, "track_m": 0.151}
    )
    errors = []
    for seed in range(8):
        scenario = parse_scenario(f"arena4:seed={seed},robots=1")
        arena = Arena(scenario)
        times = np.arange(0.0, 45.0, 0.04)
        truth = arena.poses(times)[:, 0]
        encoders = SimulatedEncoders(Arena(scenario), 0, scenario, config.wheels)
        ticks = np.array([encoders.ticks(float(time)) for time in times])
        noise = np.random.default_rng(seed).standard_normal(truth.shape) * (2e-4, 2e-4, 2e-3)
        found = calibrate([Drive(times, ticks, times, truth + noise)], told, config.mocap)
        errors.append(normalised(found, config.wheels, config.mocap))
    assert 0.8 <= math.sqrt(np.mean(np.square(errors))) <= 1.25


# --- recorded runs of a real robot


def half(whole, second):
    first, last = whole.span
    middle = 0.5 * (first + last)
    return whole.part(middle, last) if second else whole.part(first, middle)


@pytest.fixture(scope="module")
def sessions(recorded):
    read = {
        name: optiodom.read_runs(recorded(f"optiodom/{name}"))
        for name in ("circular", "free", "square")
    }
    nominal = read["free"][0].wheels
    return nominal, {name: [drive_of_run(run) for run in runs] for name, runs in read.items()}


@pytest.fixture(scope="module")
def fits(sessions):
    """The fit of each session: of free paths, circles, squares."""
    wheels, drives = sessions
    return {name: calibrate(runs, wheels, Mocap()) for name, runs in drives.items()}


def left_over(drives, nominal, fitted):
    """End error of the fit over that of the nominal geometry."""
    found = score_unseen("test", drives, nominal, fitted)
    return found["fitted_end_error_m"] / found["nominal_end_error_m"]


def test_a_fit_to_half_of_each_session_carries_over_to_the_other_half(sessions):
    wheels, drives = sessions
    nominal = wheels, Mocap()
    kept = []
    for runs in drives.values():
        for second in (False, True):
            found = calibrate([half(run, second) for run in runs], *nominal)
            assert found.failures == []
            fitted = apply_fit(found, *nominal)
            kept.append(left_over([half(run, not second) for run in runs], nominal, fitted))
    assert np.mean(kept) <= 0.30, kept


def test_sigmas_hold_across_kinds_of_paths(fits):
    for k in range(3):
        rows = [found.fitted[k] for found in fits.values()]
        values, weights = np.array([(row.value, row.sigma**-2.0) for row in rows]).T
        mean = np.average(values, weights=weights)
        assert np.sum(weights * (values - mean) ** 2) / (len(rows) - 1) <= 1.5, rows[0].name
    assert fits["free"].fitted[2].sigma < 0.6 * fits["circular"].fitted[2].sigma


def test_squares_are_warned_of(fits):
    assert "straight lines and rotations on the spot" in fits["square"].warnings[0]


def test_a_fit_to_free_driving_carries_over_and_says_so(sessions, fits):
    wheels, drives = sessions
    nominal = wheels, Mocap()
    found = fits["free"]
    assert found.failures == []
    assert found.warnings == ()
    fitted = apply_fit(found, *nominal)
    assert left_over(drives["circular"], nominal, fitted) <= 0.40
    assert left_over(drives["square"], nominal, fitted) <= 0.50
    # Windows of two seconds or the whole way: the rows of halves agree within their limits.
    for row in found.fitted[:3]:
        assert abs(row.halves[0] - row.halves[1]) <= 2.0 * row.limit


def test_what_circles_alone_do_not_tell_is_said(sessions, fits):
    wheels, drives = sessions
    both = fits["circular"]
    assert both.failures == []
    assert "transfer badly" in both.warnings[0]
    for run in (*drives["circular"], *drives["square"]):
        alone = calibrate([run], wheels, Mocap())
        assert any("does not separate the track" in failure for failure in alone.failures), run.name
