"""The one seam through which subjects run side by side."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import TypeVar

from bayes_toe.errors import InputError

Job = TypeVar("Job")
Result = TypeVar("Result")
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


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

    `function` must be importable from a module: worker processes receive it by name. This process takes its share of the jobs: it needs
    the same libraries anyhow, and a worker less has to load them.
    """
    from threadpoolctl import threadpool_limits

    count = worker_count(workers, len(jobs))
    with threadpool_limits(1):
        if count == 1:
            for index, job in enumerate(jobs):
                yield index, function(job)
        else:
            yield from _shared(function, jobs, count - 1)


def _shared(function: Callable[[Job], Result], jobs: Sequence[Job], others: int) -> Iterator[tuple[int, Result]]:
    """Share jobs between this process and `others` workers, each of which has one job to do and one in hand."""
    from loky import get_reusable_executor

    executor = get_reusable_executor(max_workers=others, env=dict.fromkeys(_THREADS, "1"))
    waiting = deque(enumerate(jobs))
    running: dict[Future[Result], int] = {}
    try:
        while waiting or running:
            while waiting and len(running) < 2 * others:
                index, job = waiting.popleft()
                running[executor.submit(function, job)] = index
            if waiting:
                index, job = waiting.popleft()
                yield index, function(job)
            else:
                wait(running, return_when=FIRST_COMPLETED)
            for future in [future for future in running if future.done()]:
                yield running.pop(future), future.result()
    finally:
        for future in running:
            future.cancel()
