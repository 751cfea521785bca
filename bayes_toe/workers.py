"""The one seam through which subjects run side by side."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import suppress
from queue import SimpleQueue
from typing import Any, TypeVar

from bayes_toe.errors import InputError

#: Told the name of what is done.
Progress = Callable[[str], None]
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


def run_jobs(jobs: Sequence[Callable[[], Result]], workers: int | None) -> Iterator[tuple[int, Result]]:
    """Yield (index, what the job returned) as they finish, in any order; one BLAS thread in every process.

    A job is a call that is still to be made, `partial(function, ...)`, of a function that can be imported: worker processes receive it by
    name. This process takes its share of the jobs: it needs the same libraries anyhow, and a worker less has to load them.

    Examples
    --------
    >>> from functools import partial
    >>> list(run_jobs([partial(pow, 2, 3), partial(pow, 3, 2)], workers=1))
    [(0, 8), (1, 9)]
    """
    from threadpoolctl import threadpool_limits

    count = worker_count(workers, len(jobs))
    with threadpool_limits(1):
        if count == 1:
            for index, job in enumerate(jobs):
                yield index, job()
        else:
            yield from _shared(jobs, count - 1)


def run_in_order(
    jobs: Sequence[Callable[[], Result]], workers: int | None, progress: Progress | None, names: Sequence[tuple[str, ...]]
) -> list[Result]:
    """Results of :func:`run_jobs` in the order of the jobs; progress is told a job's names, none or some, as soon as it is done."""
    results: dict[int, Result] = {}
    for index, result in run_jobs(jobs, workers):
        results[index] = result
        if progress is not None:
            for name in names[index]:
                progress(name)
    return [results[index] for index in range(len(jobs))]


def stop_workers() -> None:
    """End idle workers at once. They wait for further calls otherwise, and take their time to tidy up when this process ends."""
    while _executors:
        _executors.pop().shutdown(wait=True, kill_workers=True)


_executors: list[Any] = []  # loky's, which is one for all calls


def _shared(jobs: Sequence[Callable[[], Result]], others: int) -> Iterator[tuple[int, Result]]:
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
        executor.submit(job).add_done_callback(lambda future: finish(index, future))

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
                yield own[0], own[1]()
                left -= 1
            while left and (own is None or not done.empty()):
                index, future = done.get()
                yield index, future.result()
                left -= 1
    finally:
        waiting.clear()
