"""The one seam through which subjects run side by side: joblib's workers on this machine, Dask's on a cluster."""

from __future__ import annotations

import os
import signal
import time
import warnings
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from dataclasses import dataclass
from multiprocessing import resource_tracker
from numbers import Integral
from threading import Thread
from typing import TYPE_CHECKING, TypeAlias, TypeVar

from joblib import Parallel, cpu_count, delayed, parallel_config
from threadpoolctl import threadpool_limits

from bayes_toe.errors import InputError, WorkerError
from bayes_toe.library_settings import ignore_settings_of_folder

if TYPE_CHECKING:
    from distributed import Client

#: Processes of this machine, None: one per processor; or a client of a Dask cluster, whose workers do the work.
Workers: TypeAlias = "int | Client | None"
#: Told the name of what is done.
Progress = Callable[[str], None]
Result = TypeVar("Result")
_FROM_TERMINALS = [getattr(signal, name) for name in ("SIGINT", "SIGHUP") if hasattr(signal, name)]
#: Keeps Python from putting the working folder on the search path.
_SAFE_PATH = "PYTHONSAFEPATH"
#: Processes: a copy made by fork has the mark of its parent, but none of its workers, and may not begin others.
_have_begun_workers: set[int] = set()


@dataclass(frozen=True)
class Failed:
    """In the place of a job's result: why there is none. Its worker died, and a fresh one as well; other jobs went on."""

    reason: str


def _died(workers: int) -> Failed:
    return Failed(f"failed: {workers} workers died of it (killed, or out of memory)")


def of_this_machine(workers: Workers) -> int | None:
    """Processes here, also where a cluster did other work: for jobs on files, which the cluster may not see."""
    return int(workers) if isinstance(workers, Integral) else None


def run_jobs(
    jobs: Sequence[Callable[[], Result]], workers: Workers
) -> Generator[tuple[int, Result | Failed]]:
    """Yield (index, what the job returned) as they finish, in any order; one BLAS thread in every process.

    A job is a call that is still to be made, `partial(function, ...)`, of a function that can be imported. Where a worker dies (killed,
    out of memory), each job that was under way is tried once more, alone: the one that its worker dies of again is :class:`Failed`.

    Examples
    --------
    >>> from functools import partial
    >>> list(run_jobs([partial(pow, 2, 3), partial(pow, 3, 2)], workers=1))
    [(0, 8), (1, 9)]
    """
    if not (workers is None or isinstance(workers, Integral)):  # NumPy's too
        from bayes_toe.cluster import run_on

        return run_on(workers, jobs, _died)
    if workers is not None and workers < 1:
        raise InputError(f"workers={workers} must be at least 1")
    count = min(cpu_count() if workers is None else int(workers), len(jobs))
    return (
        _here(jobs) if count <= 1 or _have_begun_workers - {os.getpid()} else _shared(jobs, count)
    )


def run_in_order(
    jobs: Sequence[Callable[[], Result]],
    workers: Workers,
    progress: Progress | None,
    names: Sequence[tuple[str, ...]],
) -> list[Result]:
    """Results of :func:`run_jobs` in the order of the jobs; progress is told a job's names, none or some, as soon as it is done.

    A WorkerError where a job failed, see :func:`run_or_fail` for those that can do without.
    """
    found: list[Result] = []
    for name, result in zip(names, run_or_fail(jobs, workers, progress, names), strict=True):
        if isinstance(result, Failed):
            raise WorkerError(": ".join([*name, result.reason]))
        found.append(result)
    return found


def run_or_fail(
    jobs: Sequence[Callable[[], Result]],
    workers: Workers,
    progress: Progress | None,
    names: Sequence[tuple[str, ...]],
) -> list[Result | Failed]:
    """The same where others go on without a job that failed."""
    results: dict[int, Result | Failed] = {}
    with closing(run_jobs(jobs, workers)) as found:
        for index, result in found:
            results[index] = result
            tell(progress, names[index])
    return [results[index] for index in range(len(jobs))]


def tell(progress: Progress | None, names: Iterable[str]) -> None:
    """Say to whoever wants to hear it what is done."""
    if progress is not None:
        for name in names:
            progress(name)


def _here(jobs: Sequence[Callable[[], Result]]) -> Generator[tuple[int, Result | Failed]]:
    with threadpool_limits(1):
        for index, job in enumerate(jobs):
            yield index, job()


def _shared(
    jobs: Sequence[Callable[[], Result]], count: int
) -> Generator[tuple[int, Result | Failed]]:
    waiting, at_work = deque(enumerate(jobs)), set[int]()

    def handed_out() -> Iterator[tuple[int, Callable[[], Result]]]:
        while waiting:
            at_work.add(waiting[0][0])
            yield waiting.popleft()

    while waiting:
        try:
            with closing(_by_processes(handed_out(), count)) as results:
                for index, result in results:
                    at_work.remove(index)
                    yield index, result
        except BrokenProcessPool:
            for index in sorted(at_work):
                yield index, _alone(jobs[index])
            at_work.clear()


def _alone(job: Callable[[], Result]) -> Result | Failed:
    try:
        ((_, result),) = _by_processes(
            [(0, job)], 2
        )  # of a single one joblib would do the work in this process
    except BrokenProcessPool:
        return _died(2)
    return result


def _by_processes(
    jobs: Iterable[tuple[int, Callable[[], Result]]], count: int
) -> Generator[tuple[int, Result]]:
    """Results of numbered jobs by so many processes, which are kept for the next call."""
    with parallel_config(
        "loky", n_jobs=count, inner_max_num_threads=1, initializer=_begin, initargs=(os.getpid(),)
    ):
        parallel = Parallel(
            return_as="generator_unordered", batch_size=1, pre_dispatch="n_jobs", max_nbytes=None
        )
    _have_begun_workers.add(os.getpid())
    results: Generator[tuple[int, Result]] | None = None
    try:
        with _safe_path():
            with _signals_held_back():
                results = parallel(delayed(_numbered)(index, job) for index, job in jobs)
            for found in results:  # noqa: UP028  `yield from` would close it before joblib's warning is silenced
                yield found
    finally:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # joblib's, where nobody wants what is left
            if results is not None:
                results.close()


def _numbered(index: int, job: Callable[[], Result]) -> tuple[int, Result]:
    return index, job()


@contextmanager
def _safe_path() -> Iterator[None]:
    """Workers that start meanwhile import nothing from the working folder, a json.py for instance."""
    before = os.environ.get(_SAFE_PATH)
    os.environ[_SAFE_PATH] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[_SAFE_PATH]
        else:
            os.environ[_SAFE_PATH] = before


@contextmanager
def _signals_held_back() -> Iterator[None]:
    """A Python that begins meanwhile would die of what a terminal says to all, with many lines, and joblib warn of it."""
    before = None
    if hasattr(signal, "pthread_sigmask"):
        resource_tracker.ensure_running()  # joblib would begin it next, and Python 3.11 and 3.12 hear interrupts again once it has begun
        before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM, *_FROM_TERMINALS])
    try:
        yield
    finally:
        if before is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(parent: int) -> None:
    """In a worker, first: no worker answers a terminal or outlives its parent."""
    ignore_settings_of_folder()
    for one in _FROM_TERMINALS:
        signal.signal(one, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGTERM])
    Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    """A parent that is killed cannot say so: look whether it is there."""
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)
