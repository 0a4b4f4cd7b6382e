"""Trials on many cores: dask.distributed, on this computer or on a scheduler that runs already."""

import logging
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import groupby
from typing import TYPE_CHECKING

from host.errors import UserError
from host.experiments.records import Records
from host.experiments.trials import Record, Trial, score

if TYPE_CHECKING:
    from distributed import Client

_CONNECT_S = 10.0
_TOGETHER = 8  # so many trials are lost at most by each core when a sweep is interrupted


def sweep(
    trials: Sequence[Trial],
    records: Records,
    done: Callable[[str], None],
    scheduler: str | None = None,
    workers: int | None = None,
    plugins: Sequence[str] = (),
) -> None:
    """Run those trials that have no record yet; each record is kept as soon as it is there.

    done: called with the name of each trial that has come. scheduler: the address of a running
    one, whose workers have this version of swarmloc and see the same files; None: a process on
    each core of this computer, or `workers` of them. Raises UserError where dask.distributed is
    not installed or the scheduler does not answer, and the first of those that a trial raises.
    """
    missing = [trial for trial in trials if trial not in records]
    if not missing:
        return
    with _client(scheduler, min(workers or len(missing), len(missing))) as client:
        from distributed import as_completed

        cores = sum(client.ncores().values())
        futures = {
            client.submit(_score_all, together, plugins, pure=False): together
            for together in _chunks(missing, cores)
        }
        for future in as_completed(futures):
            for trial, record in zip(futures[future], future.result(), strict=True):
                _check_program(trial, record)
                records.add(record)
                done(f"{trial.source} {trial.filter} {trial.sensors}")


def _chunks(trials: Sequence[Trial], cores: int) -> list[list[Trial]]:
    """Trials of one source together, so that it is simulated once, where there are enough."""
    chunks = [
        list(together)
        for _, of_source in groupby(trials, lambda trial: trial.source)
        for together in _in_pieces(list(of_source))
    ]
    return chunks if len(chunks) >= 2 * cores else [[trial] for trial in trials]


def _in_pieces(trials: list[Trial]) -> list[list[Trial]]:
    return [trials[k : k + _TOGETHER] for k in range(0, len(trials), _TOGETHER)]


def _score_all(trials: Sequence[Trial], plugins: Sequence[str]) -> list[Record]:
    return [score(trial, plugins) for trial in trials]


def _check_program(trial: Trial, record: Record) -> None:
    if record["key"] != trial.key():
        raise UserError(
            "a worker's result cannot be kept",
            "it runs another version of swarmloc than this computer",
            "install this version where the workers are, and start them again",
        )


def check_installed() -> None:
    """Raise UserError where dask.distributed is not installed."""
    try:
        import distributed  # noqa: F401
    except ImportError as error:
        raise UserError(
            "a sweep needs dask.distributed", str(error), "pip install 'swarmloc[sweep]'"
        ) from error


@contextmanager
def _client(scheduler: str | None, workers: int) -> Iterator["Client"]:
    check_installed()
    from distributed import Client, LocalCluster

    if scheduler is None:
        size = min(workers, len(os.sched_getaffinity(0)))
        # Any port for its dashboard: the usual one may be taken by another sweep.
        local = {"threads_per_worker": 1, "dashboard_address": ":0"}
        local |= {"silence_logs": logging.CRITICAL}  # dask logs its own end, at Ctrl-C, as errors
        with LocalCluster(n_workers=size, **local) as cluster, Client(cluster) as client:
            yield client
        return
    try:
        remote = Client(scheduler, timeout=_CONNECT_S)
    except (OSError, ValueError) as error:
        raise UserError(
            f"no scheduler answers at {scheduler}",
            str(error),
            "start one with `dask scheduler`, workers with `dask worker ADDRESS`, and give the "
            "address that it prints, as in --scheduler tcp://192.168.0.7:8786",
        ) from error
    with remote as client:
        yield client
