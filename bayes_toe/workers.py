"""The one seam through which subjects run side by side."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import suppress
from queue import SimpleQueue
from typing import Any, TypeVar

from bayes_toe.errors import InputError

#: Told the name of what is done.
Progress = Callable[[str], None]
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


def run_in_order(
    function: Callable[[Job], Result],
    jobs: Sequence[Job],
    workers: int | None,
    progress: Progress | None,
    names: Callable[[Job], Iterable[str]],
) -> list[Result]:
    """Results of :func:`run_jobs` in the order of the jobs; progress is told the names of a job as soon as that one is done."""
    results: dict[int, Result] = {}
    for index, result in run_jobs(function, jobs, workers):
        results[index] = result
        if progress is not None:
            for name in names(jobs[index]):
                progress(name)
    return [results[index] for index in range(len(jobs))]


def stop_workers() -> None:
    """End idle workers at once. They wait for further calls otherwise, and take their time to tidy up when this process ends."""
    while _executors:
        _executors.pop().shutdown(wait=True, kill_workers=True)


_executors: list[Any] = []  # loky's, which is one for all calls


def _shared(function: Callable[[Job], Result], jobs: Sequence[Job], others: int) -> Iterator[tuple[int, Result]]:
    """Share jobs between this process and `others` workers; a worker that is done is handed the next job at once, by callback."""
    from loky import get_reusable_executor

    executor = get_reusable_executor(max_workers=others, env=dict.fromkeys(_THREADS, "1"))
    _executors[:] = [executor]
    waiting = deque(enumerate(jobs))
    done: SimpleQueue[tuple[int, Future[Result]]] = SimpleQueue()

    def hand_out() -> None:
        try:
            index, job = waiting.popleft()
        except IndexError:  # another thread may have taken the last one: only the attempt tells
            return
        executor.submit(function, job).add_done_callback(lambda future: finish(index, future))

    def finish(index: int, future: Future[Result]) -> None:
        done.put((index, future))  # first: handing out fails where the workers have died, and this call has to hear of it
        hand_out()

    try:
        for _ in range(others):
            hand_out()
        left = len(jobs)
        while left:
            own = None
            with suppress(IndexError):
                own = waiting.popleft()
            if own is not None:
                yield own[0], function(own[1])
                left -= 1
            while left and (own is None or not done.empty()):
                index, future = done.get()
                yield index, future.result()
                left -= 1
    finally:
        waiting.clear()
