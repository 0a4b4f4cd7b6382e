"""Robots named from above: how soon all are, how well, and what is believed of those alike."""

import numpy as np

from host.messages import FloatArray
from host.systems.id_phd.id_phd import IdPhd
from host.systems.id_phd.overhead import Overhead, OverheadScenario
from host.systems.id_phd.printed import PrintedIdPhd
from host.systems.id_phd.scoring import SURE, Sample, samples
from host.systems.id_phd.settings import IdPhdSettings

_LOOK_STEPS = 5  # five looks a second
_GOOD_M, _GOOD_RAD = 0.12, np.radians(10.0)  # the paper's figures


def overhead_settings(scenario: OverheadScenario) -> IdPhdSettings:
    """What an observer knows of its camera."""
    reach = scenario.height_m * np.tan(scenario.half_view_rad - scenario.tilt_rad)
    return IdPhdSettings(
        detection=scenario.detection,
        reach_m=float(reach),
        area_m2=float(4.0 * reach**2),
        clutter=max(scenario.clutter, 0.01),
        false_things=scenario.false_things + 1,
        alike=5.0,  # a picture's error of attitude is in all of its readings
        restart=1e-3,
        exchange=0.01,
        hypotheses=300,
    )


def looks(scenario: OverheadScenario, printed: bool = False) -> list[list[Sample]]:
    """What is believed of each robot, five times per second."""
    above = Overhead(scenario)
    settings = overhead_settings(scenario)
    localizer = PrintedIdPhd(settings) if printed else IdPhd(settings)
    found = []
    for step in range(1, above.steps + 1):
        localizer.drive(above.own_motion(step))
        for robot in range(scenario.robots):
            localizer.hear(robot, above.odometry(robot, step))
        localizer.update(above.readings(step))
        if step % _LOOK_STEPS == 0:
            truth = dict(enumerate(above.truth(step)))
            found.append(samples(localizer.beliefs(), truth, range(scenario.robots)))
    return found


def overhead_score(scenario: OverheadScenario, printed: bool = False) -> dict[str, float]:
    """converged_s: from then on all robots that drive are within 12 cm and 10 degrees of where they
    are; beyond the run's length if never. error_m, heading_deg: mean over the last quarter.
    wrong_sure: share of beliefs above .9 that name another robot. alike, standing: the highest
    belief in robots while they drive the same, in robots that stand.
    """
    found = looks(scenario, printed)
    driving = scenario.robots - scenario.standing
    off = np.array([[_off(sample) for sample in look[:driving]] for look in found])
    bad = np.flatnonzero(np.any(off > (_GOOD_M, _GOOD_RAD), axis=(1, 2)))
    sure = [s for look in found for s in look[:driving] if s.probability > SURE]
    period = scenario.seconds / len(found)
    alike = found[: round(scenario.alike_s / period)]
    end = np.mean(off[-(len(off) // 4) :], axis=(0, 1))
    return {
        "converged_s": float(bad[-1] + 2) * period if len(bad) else period,
        "error_m": float(end[0]),
        "heading_deg": float(np.degrees(end[1])),
        "wrong_sure": sum(not s.right for s in sure) / max(1, len(sure)),
        "alike": max((s.probability for look in alike for s in look[:2]), default=0.0),
        "standing": max((s.probability for look in found for s in look[driving:]), default=0.0),
    }


def _off(sample: Sample) -> FloatArray:
    return np.asarray(np.nan_to_num([sample.error_m, sample.error_rad], nan=np.inf))
