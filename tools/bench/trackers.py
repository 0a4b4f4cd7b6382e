"""Our filters beside Stone Soup's GM-PHD, GNN and JPDA: GOSPA in arena4, and time at any number.

GOSPA: the same messages, positions only (what the turret search finds in the lidar's scans), in the
order in which the localizer gives them to a filter. Stone Soup's work in the frame of the odometry,
where robots drive at nearly constant velocity; they know the robot's place by its odometry, but not
that readings of a revolution have lags, nor what hides what. Nothing but motion tells a post from a
teammate, which only our filters look at.

Time: the scene of phd_update.py (n targets on a random walk, P_D 0.9, 5 false alarms a scan at
n = 20), CPU time of one scan. GNN and JPDA begin with a track on each target; JPDA is that with
loopy belief propagation, as exact JPDA has no end at n = 20.
"""

import argparse
import math
import time

import numpy as np

from host.estimator.interface import Filter
from host.estimator.phd import PhdFilter
from host.estimator.pmb import PmbFilter
from host.evaluation.labels import TruthTrack
from host.evaluation.metrics import Accumulator
from host.evaluation.monitored import MonitoredFilter
from host.evaluation.truth_scoring import score_by_track
from host.geometry import to_frame, to_parent
from host.localizer import Localizer
from host.messages import Bearings, Displacement, Estimate, Positions
from host.sessions.recordings import runs
from tools.bench.phd_update import (
    DETECTION_PROBABILITY,
    FILTER,
    LIDAR,
    NOISE_M,
    RATE_HZ,
    Scene,
    walking,
)
from tools.stone_soup import PEERS, GmPhd, Model, Tracker, constant_velocity, peer

SEEDS, SECONDS = (31, 32), 60
SCANS = {20: 20, 500: 2}

# What they are told in arena4, by GOSPA on these seeds.
_ACCELERATION = 0.1  # m²/s³
_ARENA_NOISE_M, _ARENA_CLUTTER, _SPEED_MPS = 0.02, 0.06, 0.2


def driving() -> Model:
    """Robots of arena4: nearly constant velocity, in sight for a minute, found around the robot."""
    return Model(
        constant_velocity(_ACCELERATION),
        (0, 2),
        _ARENA_NOISE_M,
        DETECTION_PROBABILITY,
        _ARENA_CLUTTER,
        survival=math.exp(-1.0 / RATE_HZ / 60.0),
        birth_weight=0.05,
        birth_covariance=np.diag([4.0, _SPEED_MPS**2] * 2),
    )


class InOdometry:
    """A peer as a filter of ours: readings go into the odometry's frame, estimates come back."""

    def __init__(self, peer: GmPhd | Tracker) -> None:
        self._peer, self._pose, self._time = peer, np.zeros(3), 0.0
        self._found = np.zeros((0, 2))

    def predict(self, motion: Displacement) -> None:
        place = to_parent(np.array([[motion.dx, motion.dy]]), self._pose)[0]
        self._pose = np.array([*place, self._pose[2] + motion.dpsi])
        self._time = motion.time

    def update(self, measurement: Positions | Bearings) -> None:
        if isinstance(measurement, Positions):
            readings = to_parent(measurement.positions, self._pose)
            self._found, _ = self._peer.step(self._time, readings)

    def estimate(self) -> Estimate:
        places = to_frame(self._found, self._pose)
        n = len(places)
        spread = np.tile(_ARENA_NOISE_M**2 * np.eye(2), (n, 1, 1))
        one, labels = np.ones(n), np.arange(n)
        return Estimate(self._time, places, spread, one, np.zeros(n), labels)


def gospa_in_arena(names: list[str], seeds: tuple[int, ...], seconds: int, posts: int) -> None:
    """Print the table of GOSPA and its parts."""
    loaded = [
        runs.simulate_scenario(f"arena4:seconds={seconds},posts={posts},seed={seed}")
        for seed in seeds
    ]
    print(f"\narena4 with {posts} posts, lidar positions only, {len(seeds)} x {seconds} s")
    print(f"{'':20}{'GOSPA m':>9}{'missed':>9}{'false':>9}{'RMSE m':>9}{'ms':>9}")
    for name in names:
        row = Accumulator.pooled(_scored(name, run) for run in loaded).row("", "", name, "")
        print(
            f"{name:20}{row.gospa_m:9.3f}{row.missed:9.2f}{row.false:9.2f}{row.rmse_m:9.3f}"
            f"{row.update_ms_median:9.2f}",
            flush=True,
        )


def _scored(name: str, run: runs.Run) -> Accumulator:
    filter_: Filter
    if name in PEERS:
        filter_ = InOdometry(peer(name, driving()))
    else:
        kind = PmbFilter if name == "pmb" else PhdFilter
        filter_ = kind(run.config.filter, run.config.lidar, run.config.camera)
    scored, estimates = Accumulator(), list[Estimate]()
    localizer = Localizer(run.config, MonitoredFilter(filter_, scored.update_seconds, estimates))
    for message in run.messages:
        if not isinstance(message, Bearings):
            localizer.handle(message)
    localizer.finish()
    score_by_track(estimates, TruthTrack(run.truths), scored)
    return scored


def scan_ms(name: str, scene: Scene, scans: int) -> float:
    """Median CPU time of a scan, ms: predict, update and estimate."""
    stream, spent = scene.scans(), []
    now, truth, _ = next(stream)
    if name in PEERS:
        measured = peer(name, walking(scene), truth)
        for _ in range(scans):
            now, _, readings = next(stream)
            spent.append(measured.step(now, readings)[1])
        return 1000.0 * float(np.median(spent[1:]))
    ours = PmbFilter(FILTER, LIDAR) if name == "pmb" else PhdFilter(FILTER, LIDAR)
    for _ in range(max(scans, 40)):
        now, _, readings = next(stream)
        noise = np.tile(NOISE_M**2 * np.eye(2), (len(readings), 1, 1))
        begin = time.process_time()
        ours.predict(Displacement(now, 1.0 / RATE_HZ, 0.0, 0.0, 0.0))
        ours.update(Positions(now, readings, noise))
        ours.estimate()
        spent.append(time.process_time() - begin)
    return 1000.0 * float(np.median(spent[10:]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="*", default=list(SEEDS))
    parser.add_argument("--posts", type=int, nargs="+", default=[2, 0])
    parser.add_argument("--seconds", type=int, default=SECONDS)
    parser.add_argument("--targets", type=int, nargs="*", default=list(SCANS), choices=list(SCANS))
    arguments = parser.parse_args()
    names = ["pmb", "phd", *PEERS]
    if arguments.seeds:
        for posts in arguments.posts:
            gospa_in_arena(names, tuple(arguments.seeds), arguments.seconds, posts)
    for n in arguments.targets:
        print(f"\n{n} targets on a random walk")
        took = {name: scan_ms(name, Scene(n, seed=1), SCANS[n]) for name in names}
        for name, ms in took.items():
            print(f"{name:20}{ms:12.3f} ms a scan, {ms / took['pmb']:8.1f} times pmb's")


if __name__ == "__main__":
    main()
