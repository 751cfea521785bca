"""The one seam through which subjects run side by side; another joblib backend (Dask, say) can take its place here."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

from bayes_toe.errors import InputError

Job = TypeVar("Job")
Result = TypeVar("Result")


def worker_count(workers: int | None, jobs: int) -> int:
    """Processes to use: those asked for, or one per processor and never more than jobs.

    Examples
    --------
    >>> worker_count(8, jobs=2)
    2
    """
    if workers is not None and workers < 1:
        raise InputError(f"workers={workers} must be at least 1")
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    wanted = workers if workers is not None else (available if available is not None else 1)
    return max(1, min(wanted, jobs))


def run_jobs(function: Callable[[Job], Result], jobs: Sequence[Job], workers: int | None) -> Iterator[tuple[int, Result]]:
    """Yield (index, function(job)) as they finish, in any order; one BLAS thread in every process.

    `function` must be importable from a module: worker processes receive it by name.
    """
    from joblib import Parallel, delayed, parallel_config
    from threadpoolctl import threadpool_limits

    count = worker_count(workers, len(jobs))
    if count == 1:
        with threadpool_limits(1):
            for index, job in enumerate(jobs):
                yield index, function(job)
        return
    with parallel_config("loky", inner_max_num_threads=1):
        pool = Parallel(n_jobs=count, return_as="generator_unordered")
        yield from pool(delayed(_numbered)(function, index, job) for index, job in enumerate(jobs))


def _numbered(function: Callable[[Job], Result], index: int, job: Job) -> tuple[int, Result]:
    return index, function(job)
