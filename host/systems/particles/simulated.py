"""An intruder among robots that measure their distance to it (Lee 2012, section IV)."""

import math
from dataclasses import dataclass

import numpy as np

from host.messages import FloatArray
from host.simulation.world.settings import bounded
from host.systems.particles.kalman import RangeKalman
from host.systems.particles.particle_filter import ParticleFilter, ParticleSettings
from host.systems.particles.start import trilaterate

_STEP_S = 0.1
_WARM_UP_STEPS = 20


@dataclass(frozen=True, slots=True)
class IntruderScenario:
    """robots on a circle of radius_m around the centre, an intruder that wanders at speed_mps.

    sigma_m: of a distance. outlier: share of distances that are anything up to 5 m.
    """

    robots: int = bounded(6, 3, 60)
    seconds: float = bounded(60.0, 3.0, 7200.0)
    seed: int = bounded(1, 0, 2**32 - 1)
    radius_m: float = bounded(1.2, 0.1, 20.0)
    speed_mps: float = bounded(0.15, 0.0, 2.0)
    sigma_m: float = bounded(0.1, 0.001, 1.0)
    outlier: float = bounded(0.0, 0.0, 0.9)


def tracked(scenario: IntruderScenario) -> dict[str, dict[str, float]]:
    """Three estimates from the same distances: mean error m, and its ratio to trilateration's."""
    random = np.random.default_rng(scenario.seed)
    angles = 2.0 * math.pi * np.arange(scenario.robots) / scenario.robots
    places = scenario.radius_m * np.column_stack((np.cos(angles), np.sin(angles)))
    settings = ParticleSettings(
        speed_mps=scenario.speed_mps / math.sqrt(2.0), outlier=max(0.02, scenario.outlier)
    )
    particles = ParticleFilter(settings, scenario.seed)
    kalman: RangeKalman | None = None
    errors: dict[str, list[float]] = {"particles": [], "kalman": [], "trilateration": []}
    for step, intruder in enumerate(_walk(scenario, random)):
        ranges = _measured(scenario, np.hypot(*(intruder - places).T), random)
        raw = trilaterate(places, ranges)
        found = {"particles": particles.step(_STEP_S, places, ranges, scenario.sigma_m)}
        if raw is None:
            continue
        kalman = kalman or RangeKalman(raw, settings)
        found["kalman"] = kalman.step(_STEP_S, places, ranges, scenario.sigma_m)
        found["trilateration"] = raw
        if step >= _WARM_UP_STEPS:
            for name, position in found.items():
                errors[name].append(float(np.hypot(*(position - intruder))))
    means = {name: float(np.mean(each)) for name, each in errors.items()}
    raw_m = means["trilateration"]
    return {name: {"error_m": mean, "ratio": mean / raw_m} for name, mean in means.items()}


def _walk(scenario: IntruderScenario, random: np.random.Generator) -> FloatArray:
    """Where the intruder is at every step, (k, 2) m: it turns back where it leaves the middle."""
    count = round(scenario.seconds / _STEP_S)
    position, heading = np.zeros(2), random.uniform(-math.pi, math.pi)
    walked = []
    for _ in range(count):
        heading += random.normal(0.0, 0.15)
        if np.hypot(*position) > 0.8 * scenario.radius_m:
            heading = math.atan2(-position[1], -position[0])
        step = scenario.speed_mps * _STEP_S
        position = position + step * np.array([math.cos(heading), math.sin(heading)])
        walked.append(position)
    return np.array(walked)


def _measured(
    scenario: IntruderScenario, distances: FloatArray, random: np.random.Generator
) -> FloatArray:
    noisy = distances + random.normal(0.0, scenario.sigma_m, len(distances))
    wrong = random.uniform(size=len(distances)) < scenario.outlier
    return np.abs(np.where(wrong, random.uniform(0.0, 5.0, len(distances)), noisy))
