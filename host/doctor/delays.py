"""How late each sensor is against the wheels, by headings while the robot rotates.

Scans are matched as they are, not corrected for the rotation within them: that alone makes up 40 ms
at 1 rad/s in simulation, so only more than that is called a delay. Cameras show how far a teammate
moved in the picture; where the rotation begins and ends that says when.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from host.doctor.findings import Finding, Level
from host.doctor.lidar_motion import LidarMotion
from host.doctor.watching import Watched
from host.drivers.natnet.client import MOCAP
from host.drivers.x4.device import LIDAR
from host.geometry import wrap
from host.messages import Bearings, FloatArray

_DELAYS_S = np.arange(-0.3, 0.3001, 0.005)
_LATE_S = 0.08  # 5 deg of a bearing at 1 rad/s
_FEWEST, _LEAST_RAD = 20, 1.0
_APART_S = (0.2, 0.6)  # between two pictures that are compared
_WALK_RADPS = 0.15  # of a teammate, by what it walks itself
_ELSEWHERE = 3.0**2  # squared sigmas; further from where it should be now it is another one
_SURE = 60.0  # by so much the sum of those falls, where a delay is one; pairs share pictures


def sensor_delays(
    watched: Watched, motion: LidarMotion, interval: tuple[float, float], body: int
) -> list[Finding]:
    """Delays of each sensor that robot.toml does not know, in an interval (s).

    body: the number of this robot's own body.
    """
    times = np.array([step.time for step in watched.steps])
    headings = np.cumsum([step.dpsi for step in watched.steps])
    inside = (motion.times > interval[0]) & (motion.times < interval[1])
    found = [_of(LIDAR, motion.times[inside], motion.poses[inside, 2], times, headings)]
    own = [
        (bodies.time, float(bodies.poses[bodies.identities == body][0, 2]))
        for bodies in watched.bodies
        if body in bodies.identities and interval[0] < bodies.time < interval[1]
    ]
    if own:
        stamps, seen = np.array(own).T
        found.append(_of(MOCAP, stamps, np.unwrap(seen), times, headings))
    for name in sorted({bearings.camera for bearings in watched.bearings}):
        pictures = [
            bearings
            for bearings in watched.bearings
            if bearings.camera == name and interval[0] < bearings.time < interval[1]
        ]
        found.append(_of_camera(name, pictures, times, headings))
    return [finding for finding in found if finding is not None]


def _of(
    part: str, stamps: FloatArray, seen: FloatArray, times: FloatArray, headings: FloatArray
) -> Finding | None:
    if len(stamps) < _FEWEST or len(times) < _FEWEST or np.ptp(seen) < _LEAST_RAD:
        return None
    return _finding(part, delay_s(stamps, seen, lambda at: np.interp(at, times, headings)))


def _of_camera(
    name: str, pictures: Sequence[Bearings], times: FloatArray, headings: FloatArray
) -> Finding | None:
    pairs = list(_pairs([picture for picture in pictures if len(picture.bearings)]))
    if len(pairs) < _FEWEST or len(times) < _FEWEST or np.ptp(headings) < _LEAST_RAD:
        return None
    delay = camera_delay_s(pairs, lambda at: np.interp(at, times, headings))
    return None if delay is None else _finding(f"{name} camera".strip(), delay)


def _pairs(pictures: Sequence[Bearings]) -> Iterator[tuple[Bearings, Bearings]]:
    """Pictures that are far enough apart in time, and not too far."""
    for number, before in enumerate(pictures):
        for after in pictures[number + 1 :]:
            apart = after.time - before.time
            if apart > _APART_S[1]:
                break
            if apart > _APART_S[0]:
                yield before, after


def _finding(part: str, delay: float) -> Finding:
    what = f"{1e3 * abs(delay):.0f} ms {'late' if delay > 0.0 else 'early'} against the wheels"
    if abs(delay) <= _LATE_S:
        return Finding(part, Level.OK, what)
    fit, section = {LIDAR: ("lidar", "lidar"), MOCAP: ("wheels", "mocap")}.get(
        part, ("camera", "camera")
    )
    return Finding(
        part,
        Level.WARN,
        what,
        f"swarmloc calibrate {fit}, which fits the delay of [{section}]",
    )


def delay_s(
    stamps: FloatArray, seen: FloatArray, heading_at: Callable[[FloatArray], FloatArray]
) -> float:
    """The delay (s) of headings `seen` (n,) rad at `stamps` (n,) s.

    heading_at: by the wheels, at times (n,) s; up to a constant and a scale.
    """
    costs = []
    for delay in _DELAYS_S:
        said = heading_at(stamps - delay)
        design = np.column_stack((said, np.ones(len(said))))
        _, residual, *_ = np.linalg.lstsq(design, seen, rcond=None)
        costs.append(float(residual[0]) if len(residual) else np.inf)
    return float(_DELAYS_S[int(np.argmin(costs))])


def camera_delay_s(
    pairs: Sequence[tuple[Bearings, Bearings]], heading_at: Callable[[FloatArray], FloatArray]
) -> float | None:
    """The delay (s) of pictures, by how far each teammate moved between two; None: not sure.

    heading_at: by the wheels, at times (n,) s. Which teammate is which need not be known: each is
    compared with the one nearest to where it should be, and who has none there counts alike. Not
    sure where another delay within _LATE_S would do as well as any.
    """
    ends = np.array([(before.time, after.time) for before, after in pairs])
    befores, afters = (_rows([pair[k].bearings for pair in pairs]) for k in (0, 1))
    moved = afters[:, :, None] - befores[:, None, :]  # (pairs, after, before)
    noise = np.array([before.variances.mean() + after.variances.mean() for before, after in pairs])
    variances = (noise + (_WALK_RADPS * np.ptp(ends, axis=1)) ** 2)[:, None, None]
    costs = []
    for delay in _DELAYS_S:
        rotated = np.diff(heading_at((ends - delay).ravel()).reshape(-1, 2))[:, :, None]
        squares = np.nan_to_num(wrap(moved + rotated) ** 2 / variances, nan=np.inf).min(axis=2)
        known = np.isfinite(squares)
        costs.append(float(np.minimum(squares[known], _ELSEWHERE).sum()))
    best = int(np.argmin(costs))
    delay = float(_DELAYS_S[best])
    in_time = min(cost for at, cost in zip(_DELAYS_S, costs, strict=True) if abs(at) <= _LATE_S)
    sure = abs(delay) <= _LATE_S or in_time - costs[best] > _SURE
    return delay if sure else None


def _rows(arrays: Sequence[FloatArray]) -> FloatArray:
    """One row each, as long as the longest; NaN where there is nothing."""
    rows = np.full((len(arrays), max(map(len, arrays))), np.nan)
    for row, values in zip(rows, arrays, strict=True):
        row[: len(values)] = values
    return rows
