"""Independent jobs in parallel: by processes of this machine (joblib), or on a Dask cluster.

`run_in_order` returns all results, and `run_jobs` yields each result when its job is done.
"""

from __future__ import annotations

import os
import signal
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from math import ceil
from multiprocessing import resource_tracker
from numbers import Integral
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, TypeAlias, TypeVar

from joblib import Parallel, cpu_count, delayed, parallel_config
from threadpoolctl import threadpool_limits

from bayes_toe.arrays import Texts
from bayes_toe.cluster import DEAD_WORKER, Jobs, Outcomes, count_workers, run_on
from bayes_toe.errors import NumericalError, WorkerError, require_number
from bayes_toe.libraries import import_without_folder_settings

if TYPE_CHECKING:
    from distributed import Client

#: Processes of this machine, by default a process per processor; or a client of a Dask cluster.
Workers: TypeAlias = "int | Client | None"
#: Called with the name of each subject or data set when it is finished.
Progress = Callable[[str], None]
Result = TypeVar("Result")
Value = TypeVar("Value")
_TERMINAL_SIGNALS = [
    getattr(signal, name) for name in ("SIGINT", "SIGHUP") if hasattr(signal, name)
]
#: Keeps Python from putting the working folder on the search path.
_SAFE_PATH = "PYTHONSAFEPATH"
#: The number of this process, if it has started workers. A process that is forked from it gets a
#: copy of this set, but no workers. It cannot start any either, and does its jobs itself.
_parents: set[int] = set()


def local_processes(workers: Workers) -> int | None:
    """The number of processes for jobs that this machine must do: `workers`, if it is a number.

    For a cluster it is None, which means one process per core: the workers of a cluster may not see
    the files of this machine.
    """
    return int(workers) if isinstance(workers, Integral) else None


def count_processes(workers: Workers) -> int:
    """The number of processes, of this machine or of the cluster."""
    if workers is None:
        return cpu_count()
    if not isinstance(workers, Integral):  # NumPy's integers too
        return count_workers(workers)
    require_number("workers", workers)
    return int(workers)


def in_batches(values: Sequence[Value], largest: int, workers: Workers) -> list[Sequence[Value]]:
    """Values in batches of at most `largest`, so small that each process gets a batch if possible.

    Examples
    --------
    >>> in_batches("abcdefg", 8, workers=2), in_batches("abcdefg", 3, workers=2)
    (['abcd', 'efg'], ['abc', 'def', 'g'])
    """
    size = max(1, min(largest, ceil(len(values) / count_processes(workers))))
    return [values[start : start + size] for start in range(0, len(values), size)]


def run_jobs(jobs: Jobs[Result], workers: Workers) -> Outcomes[Result]:
    """Yield the index of each job with its result, in the order in which jobs finish.

    Every process uses one BLAS thread. Jobs run in this process if one suffices.

    Parameters
    ----------
    jobs : sequence of callable
        ``partial(function, ...)`` of a function that can be imported.
    workers : int or distributed.Client, optional

    Raises
    ------
    WorkerError
        If a worker dies (killed, out of memory).

    Examples
    --------
    >>> from functools import partial
    >>> list(run_jobs([partial(pow, 2, 3), partial(pow, 3, 2)], workers=1))
    [(0, 8), (1, 9)]
    """
    if workers is not None and not isinstance(workers, Integral):
        return run_on(workers, jobs)

    n_processes = min(count_processes(workers), len(jobs))
    # A process that was forked has a copy of `_parents`, with the number of its parent.
    is_copy_of_parent = bool(_parents - {os.getpid()})
    if n_processes <= 1 or is_copy_of_parent:
        return _run_here(jobs)
    return _run_in_processes(jobs, n_processes)


def run_in_order(
    jobs: Jobs[Result],
    workers: Workers,
    progress: Progress | None,
    names: Sequence[Texts],
) -> list[Result]:
    """Return the results in the order of the jobs.

    Parameters
    ----------
    jobs, workers
        As :func:`run_jobs` takes them.
    progress : callable, optional
        Called with the names of each job when the job is done.
    names : sequence of tuple of str
        The names of each job; a job may have none.
    """
    results = {}
    with closing(run_jobs(jobs, workers)) as outcomes:
        for index, result in outcomes:
            results[index] = result
            report_progress(progress, names[index])
    return [results[index] for index in range(len(jobs))]


def try_each(
    function: Callable[[Value], Result], values: Iterable[Value]
) -> list[Result | NumericalError]:
    """The result of a function for each value, or the NumericalError that the function raised."""
    results: list[Result | NumericalError] = []
    for value in values:
        try:
            results.append(function(value))
        except NumericalError as error:
            results.append(error)
    return results


def without_failed(
    names: Iterable[str], results: Iterable[Result | Path | NumericalError]
) -> tuple[list[Result | Path], dict[str, str]]:
    """Split results into results of jobs that did not fail, and the errors of the other jobs.

    A job that failed has its error in `results`. The second value has the text of this error by the
    name of the job.

    Raises
    ------
    WorkerError
        If all jobs failed.
    """
    finished = []
    failed = {}
    for name, result in zip(names, results, strict=True):
        if isinstance(result, NumericalError):
            failed[name] = str(result)
        else:
            finished.append(result)
    if not finished:
        raise WorkerError("\n".join(f"{name}: {reason}" for name, reason in failed.items()))
    return finished, failed


def report_progress(progress: Progress | None, names: Iterable[str]) -> None:
    """Call `progress`, if there is one, with each name."""
    if progress is not None:
        for name in names:
            progress(name)


def _run_here(jobs: Jobs[Result]) -> Outcomes[Result]:
    """Run the jobs in this process, one after the other; yield each index with its result."""
    with threadpool_limits(1):
        for index, job in enumerate(jobs):
            yield index, job()


def _run_in_processes(jobs: Jobs[Result], n_processes: int) -> Outcomes[Result]:
    """Run the jobs by joblib, as :func:`run_jobs` does.

    The processes stay when the jobs are done, and wait for the jobs of the next call.
    """
    with parallel_config(
        "loky",
        n_jobs=n_processes,
        inner_max_num_threads=1,
        initializer=_start_worker,
        initargs=(os.getpid(),),
    ):
        # A process gets one job at a time, and arrays as copies, not as files in memory.
        parallel = Parallel(
            return_as="generator_unordered", batch_size=1, pre_dispatch="n_jobs", max_nbytes=None
        )

    _parents.add(os.getpid())  # A later copy of this process cannot start workers.

    try:
        with _safe_path():
            with _signals_held_back():
                results = parallel(delayed(_run_numbered)(*job) for job in enumerate(jobs))
            try:
                # If the caller stops early, `yield from` would close the results, with joblib's
                # warning of results that nobody takes. They are closed below, without the warning.
                for numbered_result in results:  # noqa: UP028
                    yield numbered_result
            finally:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    results.close()
    except BrokenProcessPool as error:
        raise WorkerError(DEAD_WORKER) from error


def _run_numbered(index: int, job: Callable[[], Result]) -> tuple[int, Result]:
    """Run a job; return its index with the result, because results come in any order."""
    return index, job()


@contextmanager
def _safe_path() -> Iterator[None]:
    """Keep workers that start in the block from importing files of the working folder.

    A worker reads the variable when it starts; this process keeps its own search path.
    """
    earlier_value = os.environ.get(_SAFE_PATH)
    os.environ[_SAFE_PATH] = "1"
    try:
        yield
    finally:
        if earlier_value is None:
            del os.environ[_SAFE_PATH]
        else:
            os.environ[_SAFE_PATH] = earlier_value


@contextmanager
def _signals_held_back() -> Iterator[None]:
    """Hold back signals while workers start.

    A signal would end a worker that starts, with many lines of output.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return

    # joblib would start this tracker while signals are blocked. But Python 3.11 and 3.12 unblock
    # interrupts when they start the tracker, so it is started before.
    resource_tracker.ensure_running()
    earlier_mask = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM, *_TERMINAL_SIGNALS])

    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, earlier_mask)


def _start_worker(parent: int) -> None:
    """Prepare a worker: it ignores signals of the terminal and ends with its parent.

    `parent` is the number of the process that starts the worker.
    """
    # Jobs may import matplotlib and ArviZ, which read settings files of the working folder. If
    # there are such files, both are imported here without them.
    import_without_folder_settings()
    for number in _TERMINAL_SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    # _signals_held_back blocks SIGTERM in the parent, and a worker inherits that. SIGTERM is
    # unblocked here, so that it can end the worker.
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGTERM])
    Thread(target=_end_with_parent, args=(parent,), daemon=True).start()


def _end_with_parent(parent: int) -> None:
    """End this worker when its parent is gone: a parent that is killed cannot end its workers."""
    while os.getppid() == parent:  # The system gives an orphan another parent.
        time.sleep(1.0)
    os._exit(1)
