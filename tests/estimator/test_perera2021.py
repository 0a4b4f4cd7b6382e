"""The equations of Perera 2021 one by one, and all together against a filter in plain Python."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.config import BlindSector, Lidar
from host.estimator.perera2021 import Perera2021Filter
from host.messages import Bearings, Displacement, Positions

SYSTEM_NOISE_M2 = 0.02  # in 0.1 s; the thesis gives none, its author's code 0.01 in 0.05 s
NO_PILLARS = Lidar(blind_sectors=())
PILLARS = Lidar(
    blind_sectors=(
        BlindSector(centre_rad=0.8, width_rad=0.1),
        BlindSector(centre_rad=-3.1, width_rad=0.2),
    )
)
NULL_AT = 200  # a sector from which nothing came back: 20 deg to 21 deg


def seen(points, null=(), time=0.1):
    points = np.reshape(np.asarray(points, dtype=float), (-1, 2))
    clearance = np.full(360, 5.0)
    clearance[list(null)] = math.inf
    # The noise that a message brings is not the thesis': eq. 17 has its own.
    noise = np.tile(0.7 * np.eye(2), (len(points), 1, 1))
    return Positions(time, points, noise, clearance=clearance)


def heard(bearings, origin=(0.0, 0.0), time=0.1):
    bearings = np.atleast_1d(np.asarray(bearings, dtype=float))
    return Bearings(time, bearings, np.full(len(bearings), 0.7), origin)


def moved(dx=0.0, dy=0.0, dpsi=0.0, time=0.1):
    return Displacement(time, 0.1, dx, dy, dpsi)


def holding(points, lidar=NO_PILLARS):
    """A filter that knows one component of weight 1 near each of the points."""
    thesis = Perera2021Filter(lidar)
    thesis.predict(moved())
    thesis.update(seen(points))
    assert thesis.estimate().weights == pytest.approx(np.ones(len(np.reshape(points, (-1, 2)))))
    return thesis


def at(radius, degrees):
    return radius * math.cos(math.radians(degrees)), radius * math.sin(math.radians(degrees))


def detection(thesis, message):
    """P_D of the farthest component, by what an empty message leaves of it: 1 - P_D.

    Where more than 0.9 was taken nothing is reported any more; then None.
    """
    before = thesis.estimate()
    far = int(np.argmax(np.hypot(*before.positions.T)))
    thesis.update(message)
    after = thesis.estimate()
    same = np.all(after.positions == before.positions[far], axis=1)
    return 1.0 - after.weights[same][0] / before.weights[far] if np.any(same) else None


def lidar_curve(distance):
    return 1.0 / (1.02 + math.exp(8.0 * (distance - 1.5)))


def expect(probability):
    return pytest.approx(probability, rel=1e-6, abs=1e-9) if probability < 0.9 else None


def test_equations_7_and_8_carry_a_component_and_add_noise():
    thesis = holding([1.0, 0.5])
    before = thesis.estimate()
    thesis.predict(moved(0.1, -0.2, 0.3))
    after = thesis.estimate()
    c, s = math.cos(0.3), math.sin(0.3)
    turn = np.array([[c, s], [-s, c]])  # repair 1: counter-clockwise dpsi
    assert after.positions[0] == pytest.approx(turn @ (before.positions[0] - [0.1, -0.2]))
    expected = turn @ (before.covariances[0] + SYSTEM_NOISE_M2 * np.eye(2)) @ turn.T
    assert after.covariances[0] == pytest.approx(expected)


@pytest.mark.parametrize("distance", [0.5, 3.0, 4.0, 4.4])
def test_equations_9_and_10_lower_the_weight_at_every_update_whatever_its_length(distance):
    weights = []
    for interval in (0.001, 10.0):
        thesis = holding([distance, 0.0])
        (place,) = thesis.estimate().positions
        thesis.predict(Displacement(0.2, interval, 0.0, 0.0, 0.0))
        weights.append(thesis.estimate().weights[0])
    survival = 1.0 / (1.05 + math.exp(4.0 * (np.hypot(*place) - 4.0)))
    assert weights == pytest.approx([survival, survival])


def test_equation_11_puts_the_birth_on_the_observer_with_two_metres_of_sigma():
    """The first reading updates just that component, by the gain of eq. 16 and 17."""
    thesis = holding([1.0, -2.0])
    found = thesis.estimate()
    gain = 4.0 / (4.0 + 0.0025)
    assert found.positions[0] == pytest.approx([gain, -2.0 * gain])
    assert found.covariances[0] == pytest.approx((1.0 - gain) * 4.0 * np.eye(2))


def test_equations_13_to_17_update_by_a_position():
    thesis = holding([1.0, 0.5])
    before = thesis.estimate()
    reading = before.positions[0] + [0.2, -0.12]  # so far off that what was missed stays apart
    thesis.update(seen(reading))
    after = thesis.estimate()
    matrix = before.covariances[0]
    gain = matrix @ np.linalg.inv(matrix + 0.0025 * np.eye(2))
    # What was missed is still there, lighter than what was seen.
    heaviest = int(np.argmax(after.weights))
    assert after.weights[heaviest] == pytest.approx(1.0)
    assert after.positions[heaviest] == pytest.approx(
        before.positions[0] + gain @ (reading - before.positions[0])
    )
    assert after.covariances[heaviest] == pytest.approx((np.eye(2) - gain) @ matrix)


def test_equation_15_weighs_rivals_by_the_innovations_covariance():
    """Repair 3: together they have the weight 1, shared by P_D w N(l; m, p + R)."""
    thesis = holding([[1.0, 0.0], [0.0, 1.0]])
    before = thesis.estimate()
    reading = 0.5 * np.sum(before.positions, axis=0) + [0.002, -0.002]
    thesis.update(seen(reading))
    after = thesis.estimate()
    shares = []
    for mean, matrix in zip(before.positions, before.covariances, strict=True):
        off = reading - mean
        spread = matrix + 0.0025 * np.eye(2)
        shares.append(-0.5 * off @ np.linalg.solve(spread, off))  # equal P_D, w and size
    share = math.exp(shares[0] - max(shares)) / sum(math.exp(s - max(shares)) for s in shares)
    assert 0.6 < share < 0.95
    # What was missed is too light to be reported.
    assert sorted(after.weights) == pytest.approx([1.0 - share, share])


def test_what_is_close_merges_into_the_heaviest_by_matching_moments():
    """Repair 7: what was missed lies within two standard deviations of what was seen."""
    thesis = holding([1.0, 0.5])
    before = thesis.estimate()
    (mean,), (matrix,) = before.positions, before.covariances
    reading = mean + np.array([0.03, -0.02])
    thesis.update(seen(reading))
    after = thesis.estimate()
    gain = matrix @ np.linalg.inv(matrix + 0.0025 * np.eye(2))
    missed = 1.0 - lidar_curve(np.hypot(*mean))
    weights = np.array([1.0, missed]) / (1.0 + missed)
    places = np.stack((mean + gain @ (reading - mean), mean))
    assert after.weights == pytest.approx([1.0 + missed])
    assert after.positions[0] == pytest.approx(weights @ places)
    off = places[1] - places[0]
    spread = weights[0] * (np.eye(2) - gain) @ matrix + weights[1] * matrix
    spread += weights[0] * weights[1] * np.outer(off, off)
    assert after.covariances[0] == pytest.approx(spread)


@pytest.mark.parametrize("distance", [0.3, 1.3, 1.5, 1.8])
def test_equation_19_is_the_lidars_range_curve(distance):
    thesis = holding([distance, 0.0])
    (place,) = thesis.estimate().positions
    assert detection(thesis, seen([])) == expect(lidar_curve(np.hypot(*place)))


@pytest.mark.parametrize("off", [0.0, 0.05, 0.1, -0.15, 0.4])
@pytest.mark.parametrize("pillar", PILLARS.blind_sectors, ids=["0.8", "-3.1"])
def test_equation_20_is_a_product_of_unit_peaks_over_the_pillars(pillar, off):
    angle = pillar.centre_rad + off
    thesis = holding([1.4 * math.cos(angle), 1.4 * math.sin(angle)], PILLARS)
    x, y = thesis.estimate().positions[0]
    expected = lidar_curve(math.hypot(x, y))
    for other in PILLARS.blind_sectors:
        gap = math.remainder(math.atan2(y, x) - other.centre_rad, 2 * math.pi)
        expected *= 1.0 - math.exp(-(gap**2) / (2 * (other.width_rad / 2) ** 2))
    assert detection(thesis, seen([])) == expect(expected)


@pytest.mark.parametrize("apart", [0.0, 2.0, 3.0, 5.0])
@pytest.mark.parametrize("around", [0.0, 179.0])
def test_equations_21_and_22_hide_what_stands_behind_for_both_sensors(around, apart):
    clear = 1.0 - math.exp(-(apart**2) / (2 * 3.0**2))
    thesis = holding([at(0.6, around), at(1.4, around + apart)])
    distance = np.hypot(*thesis.estimate().positions.T).max()
    assert detection(thesis, seen([])) == expect(clear * lidar_curve(distance))
    thesis = holding([at(0.6, around), at(1.4, around + apart)])
    curve = 1.0 / (1.1 + math.exp(5.0 * (distance - 4.0)))
    assert detection(thesis, heard([])) == expect(clear * curve)


@pytest.mark.parametrize("degrees", [20.5, 22.0, 26.5, 60.0])
def test_equation_23_expects_less_where_nothing_comes_back(degrees):
    thesis = holding(at(1.4, degrees))
    (place,) = thesis.estimate().positions
    off = degrees - 20.5
    clear = 1.0 - 0.6 * math.exp(-(off**2) / (2 * 3.0**2))
    expected = expect(clear * lidar_curve(np.hypot(*place)))
    assert detection(thesis, seen([], null=[NULL_AT])) == expected


def test_equations_25_to_28_update_by_a_bearing():
    thesis = holding([-1.0, 0.02])
    before = thesis.estimate()
    (x, y), matrix = before.positions[0], before.covariances[0]
    bearing = -math.pi + 0.5  # across the seam; what was missed stays apart
    thesis.update(heard(bearing))
    after = thesis.estimate()
    jacobian = np.array([[-y, x]]) / (x * x + y * y)
    innovation = math.remainder(bearing - math.atan2(y, x), 2 * math.pi)
    spread = jacobian @ matrix @ jacobian.T
    gain = matrix @ jacobian.T / (spread + math.radians(5.0) ** 2)
    heaviest = int(np.argmax(after.weights))
    assert after.weights[heaviest] == pytest.approx(1.0)
    assert after.positions[heaviest] == pytest.approx([x, y] + (gain * innovation)[:, 0])
    assert after.covariances[heaviest] == pytest.approx((np.eye(2) - gain @ jacobian) @ matrix)


@pytest.mark.parametrize("distance", [3.6, 4.0, 4.4])
def test_equation_30_is_the_cameras_range_curve(distance):
    thesis = holding([distance, 0.0])
    (place,) = thesis.estimate().positions
    expected = 1.0 / (1.1 + math.exp(5.0 * (np.hypot(*place) - 4.0)))
    assert detection(thesis, heard([])) == expect(expected)


def test_the_birth_gives_no_bearing_and_is_not_updated_by_one():
    thesis = Perera2021Filter(NO_PILLARS)
    thesis.predict(moved())
    thesis.update(heard([0.5, 1.5]))
    assert len(thesis.estimate().positions) == 0


def test_chapter_6_reports_what_weighs_more_than_a_tenth():
    thesis, weights = holding([0.5, 0.0]), [1.0]
    while len(thesis.estimate().weights):
        weights.append(thesis.estimate().weights[0])
        thesis.predict(moved())
    assert min(weights) > 0.1
    assert min(weights) / 1.06 < 0.1


# All together, in plain Python.


def merged(heaviest_first):
    groups = []
    while heaviest_first:
        centre, matrix, _ = heaviest_first[0]
        inverse, near, rest = np.linalg.inv(matrix), [], []
        for component in heaviest_first:
            off = component[0] - centre
            (near if math.sqrt(off @ inverse @ off) <= 2.0 else rest).append(component)
        weight = sum(w for _, _, w in near)
        mean = sum(w * m for m, _, w in near) / weight
        spread = sum(w * (p + np.outer(m - mean, m - mean)) for m, p, w in near) / weight
        groups.append((mean, spread, weight))
        heaviest_first = rest
    return groups


class InPlainPython:
    """Equations 7 to 30 with the repairs, component by component."""

    def __init__(self, pillars):
        self.pillars = [(sector.centre_rad, sector.width_rad / 2) for sector in pillars]
        self.mixture = []  # (mean, covariance, weight)

    def predict(self, dx, dy, dpsi):
        c, s = math.cos(dpsi), math.sin(dpsi)
        turn = np.array([[c, s], [-s, c]])
        carried = []
        for mean, matrix, weight in self.mixture:
            survival = 1 / (1.05 + math.exp(4 * (np.hypot(*mean) - 4)))
            place = turn @ (mean - [dx, dy])
            carried.append(
                (place, turn @ (matrix + SYSTEM_NOISE_M2 * np.eye(2)) @ turn.T, survival * weight)
            )
        self.mixture = [*carried, (np.zeros(2), 4 * np.eye(2), 0.001)]

    def hidden(self, mean):
        clear = 1.0
        for other, _, weight in self.mixture:
            if np.hypot(*other) < np.hypot(*mean):
                gap = math.atan2(mean[1], mean[0]) - math.atan2(other[1], other[0])
                gap = math.degrees(math.remainder(gap, 2 * math.pi))
                clear *= 1 - min(weight, 1) * math.exp(-(gap**2) / 18)
        return clear

    def lidar(self, points, null):
        def detection(mean):
            angle = math.atan2(mean[1], mean[0])
            detected = self.hidden(mean) / (1.02 + math.exp(8 * (np.hypot(*mean) - 1.5)))
            for centre, sigma in self.pillars:
                gap = math.remainder(angle - centre, 2 * math.pi)
                detected *= 1 - math.exp(-(gap**2) / (2 * sigma**2))
            gaps = [math.remainder(angle - math.radians(k - 179.5), 2 * math.pi) for k in null]
            if gaps:
                nearest = min(abs(math.degrees(gap)) for gap in gaps)
                detected *= 1 - 0.6 * math.exp(-(nearest**2) / 18)
            return detected

        def updated(mean, matrix, reading):
            gain = matrix @ np.linalg.inv(matrix + 0.0025 * np.eye(2))
            off = reading - mean
            spread = matrix + 0.0025 * np.eye(2)
            size = 2 * math.pi * math.sqrt(np.linalg.det(spread))
            density = math.exp(-0.5 * off @ np.linalg.solve(spread, off)) / size
            return mean + gain @ off, (np.eye(2) - gain) @ matrix, density

        self.update(points, detection, updated)

    def cameras(self, bearings):
        def detection(mean):
            if np.hypot(*mean) < 1e-3:
                return 0.0
            return self.hidden(mean) / (1.1 + math.exp(5 * (np.hypot(*mean) - 4)))

        def updated(mean, matrix, bearing):
            x, y = mean
            square = max(x * x + y * y, 1e-6)
            jacobian = np.array([-y, x]) / square
            spread = jacobian @ matrix @ jacobian + math.radians(5) ** 2
            off = math.remainder(bearing - math.atan2(y, x), 2 * math.pi)
            gain = matrix @ jacobian / spread
            density = math.exp(-(off**2) / (2 * spread)) / math.sqrt(2 * math.pi * spread)
            return mean + gain * off, (np.eye(2) - np.outer(gain, jacobian)) @ matrix, density

        self.update(bearings, detection, updated)

    def update(self, readings, detection, updated):
        detected = [min(detection(mean), 0.98) for mean, _, _ in self.mixture]
        after = [(m, p, w * (1 - d)) for (m, p, w), d in zip(self.mixture, detected, strict=True)]
        for reading in readings:
            rivals = []
            for (mean, matrix, weight), probability in zip(self.mixture, detected, strict=True):
                place, rest, density = updated(mean, matrix, reading)
                rivals.append((place, rest, probability * weight * density))
            total = sum(weight for _, _, weight in rivals)
            after += [(m, p, w / total) for m, p, w in rivals if total > 0]
        self.mixture = merged(sorted((c for c in after if c[2] > 0.001), key=lambda c: -c[2]))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=8)
def test_a_scene_gives_what_the_equations_give_one_by_one(seed):
    random = np.random.default_rng(seed)
    plain, thesis = InPlainPython(PILLARS.blind_sectors), Perera2021Filter(PILLARS)
    places = random.uniform(-1.5, 1.5, (2, 2))
    for _ in range(5):
        motion = random.normal(0.0, 0.05, 3).tolist()
        plain.predict(*motion)
        thesis.predict(moved(*motion))
        null = random.integers(0, 360, random.integers(0, 4)).tolist()
        points = places[random.random(2) < 0.8] + random.normal(0.0, 0.05, 2)
        plain.lidar(points, null)
        thesis.update(seen(points, null))
        bearings = np.arctan2(places[:, 1], places[:, 0]) + random.normal(0.0, 0.1, 2)
        bearings = bearings[random.random(2) < 0.8]
        plain.cameras(bearings)
        thesis.update(heard(bearings))
    expected = sorted((c for c in plain.mixture if c[2] > 0.1), key=lambda c: -c[2])
    found = thesis.estimate()
    order = np.argsort(-found.weights, kind="stable")
    assert found.weights[order] == pytest.approx([w for _, _, w in expected], rel=1e-6)
    for mean, matrix, weight in expected:
        same = np.isclose(found.weights, weight, rtol=1e-5)
        same &= np.hypot(*(found.positions - mean).T) < 1e-6
        assert np.any(same)
        assert found.covariances[same][0] == pytest.approx(matrix, abs=1e-8)


def test_a_minute_of_anything_leaves_finite_estimates():
    random = np.random.default_rng(7)
    thesis, time = Perera2021Filter(), 0.0
    while time < 60.0:
        time += 0.1
        thesis.predict(moved(*random.normal(0.0, 0.05, 3), time=time))
        points = random.uniform(-3.0, 3.0, (random.integers(0, 5), 2))
        thesis.update(seen(points, random.integers(0, 360, 20), time))
        thesis.update(heard(random.uniform(-4.0, 4.0, random.integers(0, 4)), (0.05, 0.0), time))
        found = thesis.estimate()
        assert found.time == time
        for values in (found.positions, found.covariances, found.weights):
            assert np.all(np.isfinite(values))
        assert np.all(found.weights > 0.1)
        assert np.all(found.ages >= 0.0)
        assert np.all(np.linalg.eigvalsh(found.covariances) > 0.0)


def test_empty_messages_before_anything_is_known():
    thesis = Perera2021Filter()
    thesis.update(seen([]))
    thesis.update(heard([]))
    thesis.update(seen([[1.0, 0.0]]))
    thesis.update(heard([0.0]))
    assert thesis.estimate().positions.shape == (0, 2)
    assert thesis.estimate().covariances.shape == (0, 2, 2)
