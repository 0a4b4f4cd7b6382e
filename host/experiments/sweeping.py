"""Trials on many cores: dask.distributed, on this computer or on a scheduler that runs already."""

import logging
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from host.errors import UserError
from host.experiments.records import Records
from host.experiments.trials import Trial, score

if TYPE_CHECKING:
    from distributed import Client

_CONNECT_S = 10.0


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

        futures = {client.submit(score, trial, plugins, pure=False): trial for trial in missing}
        for future in as_completed(futures):
            records.add(future.result())
            trial = futures[future]
            done(f"{trial.source} {trial.filter} {trial.sensors}")


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
        # No dashboard: its port may be taken, and it needs another package.
        local = {"threads_per_worker": 1, "dashboard_address": None, "silence_logs": logging.ERROR}
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
