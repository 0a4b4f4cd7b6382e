"""How good estimates are: GOSPA with its parts, and the figures papers on this problem report.

A row of figures is one filter on one run. `time_over_30cm` rewards a filter that reports
everywhere, so it stands beside the counts of false estimates: `false` as GOSPA counts them, and
`stray`, which excuses none: what is reported on furniture, posts or walls.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from host.messages import BoolArray, Estimate, FloatArray, IntArray, Truth

# The cut-offs c of GOSPA, by what is scored: where truth is known at every time, and in MR.CLAM,
# whose ranges err by 0.1 to 0.2 m.
CUT_OFF_M = 0.5
MRCLAM_CUT_OFF_M = 1.0
OVER_M = 0.30  # the bound of Perera 2021, section 6


@dataclass(frozen=True, slots=True)
class Gospa:
    """One GOSPA distance (m), its localisation part (m) and the counts of its other parts."""

    distance: float
    localisation: float
    missed: int
    false: int


@dataclass(frozen=True, slots=True)
class Instant:
    """What was scored at one time. wanted (m,): which of all teammates were to be reported."""

    truth: Truth
    wanted: BoolArray
    estimate: Estimate
    gospa: Gospa


@dataclass(frozen=True, slots=True)
class Row:
    """The figures of one filter on one run; each is a mean over the scored instants.

    Figures of matched pairs are NaN where no estimate was matched.
    """

    source: str  # the recording, scenario or dataset
    observer: str  # the robot that estimates; "all" where several are pooled
    filter: str
    sensors: str
    seconds: float  # from the first to the last scored instant, s; summed where pooled
    gospa_m: float  # GOSPA, m
    localisation_m: float  # its localisation part (sum of d^p over matched pairs)^(1/p), m
    missed: float  # teammates without an estimate, per instant
    false: float  # estimates of nothing, per instant
    stray: float  # estimates over 0.30 m from every teammate, at any range, per instant
    time_over_30cm: float  # share (0..1) of teammates whose nearest estimate is over 0.30 m away
    rmse_m: float  # root mean square distance of matched pairs, m
    p67_m: float  # 67th percentile of the distance of matched pairs, m (Belaroussi)
    cardinality_error: float  # matched + false - teammates, signed, per instant
    label_changes: float  # of a teammate's label, per teammate and minute in range
    anees: float  # mean over matched pairs of e^T P^-1 e / 2: 1 consistent, more = overconfident
    update_ms_median: float  # one predict and update of the filter, ms
    update_ms_p99: float  # its 99th percentile, ms

    def as_json(self) -> dict[str, str | float | None]:
        """The row as JSON values: a figure that does not exist is null."""
        return {key: _or_null(value) for key, value in asdict(self).items()}


def gospa_pairs(
    truth: FloatArray, estimates: FloatArray, p: float, c: float
) -> tuple[IntArray, ...]:
    """Indices (truths, estimates) of the pairs under `c` in the least sum of min(d, c)^p.

    truth (m, 2), estimates (n, 2), c in metres.
    """
    distances = np.linalg.norm(truth[:, None] - estimates[None], axis=2)
    i, j = linear_sum_assignment(np.minimum(distances, c) ** p)
    under = distances[i, j] < c
    return i[under], j[under]


def gospa(
    truth: FloatArray,
    estimates: FloatArray,
    p: float = 2.0,
    c: float = CUT_OFF_M,
) -> Gospa:
    """GOSPA of two sets of positions (m, 2) and (n, 2) with alpha = 2, cut off at c metres.

    Source: Rahmathullah, García-Fernández & Svensson 2017, eq. 1 in the form of proposition 1:
    (sum of d^p over the matched pairs + c^p / 2 (missed + false))^(1/p).
    """
    i, j = gospa_pairs(truth, estimates, p, c)
    return _parts(np.linalg.norm(truth[i] - estimates[j], axis=1), len(truth), len(estimates), p, c)


def _parts(distances: FloatArray, truths: int, estimates: int, p: float, c: float) -> Gospa:
    missed, false = truths - len(distances), estimates - len(distances)
    localisation = float(np.sum(distances**p))
    return Gospa(
        distance=(localisation + c**p / 2.0 * (missed + false)) ** (1.0 / p),
        localisation=localisation ** (1.0 / p),
        missed=missed,
        false=false,
    )


@dataclass
class Accumulator:
    """Gathers scored instants of one filter, and makes them a `Row`.

    p, c: as in `gospa`. update_seconds: what each predict and update took, filled by the runner.
    instants: what was scored, filled by whoever knows the teammates' names; for curves over time.
    """

    p: float = 2.0
    c: float = CUT_OFF_M
    seconds: float = 0.0
    update_seconds: list[float] = field(default_factory=list)
    instants: list[Instant] = field(default_factory=list)
    _last_time: float = math.nan
    _gospas: list[Gospa] = field(default_factory=list)
    _distances: list[FloatArray] = field(default_factory=list)
    _nearest: list[FloatArray] = field(default_factory=list)
    _nees: list[FloatArray] = field(default_factory=list)
    _stray: list[int] = field(default_factory=list)

    def add(
        self,
        truth: FloatArray,
        dont_care: FloatArray,
        estimate: Estimate,
        teammates: FloatArray | None = None,
    ) -> Gospa:
        """Score one instant, all positions in the same frame; instants come in time order.

        truth (m, 2): where teammates are that the filter should report. dont_care (k, 2): where
        something is whose report is no error; each excuses one estimate within c metres that no
        teammate needs. teammates (l, 2): all there are, where `truth` is a part of them.
        """
        positions = estimate.positions
        i, j = gospa_pairs(truth, positions, self.p, self.c)
        errors = positions[j] - truth[i]
        spare = np.delete(positions, j, axis=0)
        excused = len(gospa_pairs(dont_care, spare, self.p, self.c)[0])
        distances = np.linalg.norm(errors, axis=1)
        scored = _parts(distances, len(truth), len(positions) - excused, self.p, self.c)
        self._gospas.append(scored)
        self._distances.append(distances)
        self._nearest.append(nearest(truth, positions))
        everyone = truth if teammates is None else teammates
        self._stray.append(int(np.sum(nearest(positions, everyone) > OVER_M)))
        self._nees.append(_nees(errors, estimate.covariances[j]))
        if not math.isnan(self._last_time):
            self.seconds += estimate.time - self._last_time
        self._last_time = estimate.time
        return scored

    @classmethod
    def pooled(cls, parts: Iterable["Accumulator"]) -> "Accumulator":
        """All instants of several runs (observers, seeds) as if they were one."""
        runs = list(parts)
        whole = cls(runs[0].p, runs[0].c) if runs else cls()
        for run in runs:
            if (run.p, run.c) != (whole.p, whole.c):
                raise ValueError("runs scored with different p or c cannot be pooled")
            whole.seconds += run.seconds
            whole.update_seconds += run.update_seconds
            whole.instants += run.instants
            whole._gospas += run._gospas
            whole._distances += run._distances
            whole._nearest += run._nearest
            whole._nees += run._nees
            whole._stray += run._stray
        return whole

    def row(self, source: str, observer: str, filter_name: str, sensors: str) -> Row:
        """The figures of all instants so far."""
        distances = np.concatenate([*self._distances, np.zeros(0)])
        farther = np.concatenate([*self._nearest, np.zeros(0)])
        update_ms = 1000.0 * np.array(self.update_seconds)
        missed = _mean([g.missed for g in self._gospas])
        false = _mean([g.false for g in self._gospas])
        return Row(
            source=source,
            observer=observer,
            filter=filter_name,
            sensors=sensors,
            seconds=self.seconds,
            gospa_m=_mean([g.distance for g in self._gospas]),
            localisation_m=_mean([g.localisation for g in self._gospas]),
            missed=missed,
            false=false,
            stray=_mean(self._stray),
            time_over_30cm=_mean(farther > OVER_M),
            rmse_m=math.sqrt(_mean(distances**2)),
            p67_m=percentile(distances, 67.0),
            cardinality_error=false - missed,
            label_changes=label_changes(self.instants, self.c),
            anees=_mean(np.concatenate([*self._nees, np.zeros(0)])),
            update_ms_median=percentile(update_ms, 50.0),
            update_ms_p99=percentile(update_ms, 99.0),
        )


def label_changes(instants: Sequence[Instant], c: float = CUT_OFF_M) -> float:
    """How often a teammate's label changes, per teammate and minute in which it is to be reported.

    Its label is that of the estimate it is matched with, in GOSPA's matching with cut-off c; time
    without a match changes nothing, and a later label is compared with the last one. Where time
    goes back another run begins. nan where no time is known.
    """
    last: dict[int, int] = {}
    changes, seconds, before = 0, 0.0, math.inf
    for at in instants:
        if at.estimate.time < before:
            last.clear()
        else:
            seconds += (at.estimate.time - before) * float(np.sum(at.wanted))
        before = at.estimate.time
        who = at.truth.identities[at.wanted]
        i, j = gospa_pairs(at.truth.positions[at.wanted], at.estimate.positions, 2.0, c)
        for teammate, label in zip(who[i].tolist(), at.estimate.labels[j].tolist(), strict=True):
            changes += int(last.get(teammate, label) != label)
            last[teammate] = label
    return 60.0 * changes / seconds if seconds else math.nan


def nearest(truth: FloatArray, estimates: FloatArray) -> FloatArray:
    """Distance (m,) of each truth to its nearest estimate, or the reverse; inf where none."""
    distances = np.linalg.norm(truth[:, None] - estimates[None], axis=2)
    return np.asarray(np.min(distances, axis=1, initial=math.inf))


def _nees(errors: FloatArray, covariances: FloatArray) -> FloatArray:
    """e^T P^-1 e / 2 (n,) of errors (n, 2) m, covariances (n, 2, 2) m²; inf where P is singular."""
    found = np.full(len(errors), math.inf)
    sound = np.linalg.det(covariances) > 0.0
    errors = errors[sound]
    weighted = np.linalg.solve(covariances[sound], errors[:, :, None])[:, :, 0]
    found[sound] = np.sum(errors * weighted, axis=1) / 2.0
    return found


def _or_null(value: str | float) -> str | float | None:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _mean(values: FloatArray | NDArray[np.bool_] | list[float] | list[int]) -> float:
    return float(np.mean(values)) if len(values) else math.nan


def percentile(values: FloatArray, percent: float) -> float:
    """Of values (n,); nan for none."""
    return float(np.percentile(values, percent)) if len(values) else math.nan
