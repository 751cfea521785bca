"""The one seam through which subjects run side by side."""

from __future__ import annotations

import atexit
import os
import signal
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from numbers import Integral
from queue import SimpleQueue
from threading import Thread
from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar

from bayes_toe.errors import InputError, WorkerError

if TYPE_CHECKING:
    from distributed import Client

#: A client of a Dask cluster.
Cluster: TypeAlias = "Client"
#: Processes of this machine, None: one per processor; or a client of a Dask cluster, whose workers do the work.
Workers: TypeAlias = "int | Client | None"
#: Told the name of what is done.
Progress = Callable[[str], None]
Result = TypeVar("Result")
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
_ATTEMPTS = 2  # workers that may die of one job
_FROM_TERMINALS = [getattr(signal, name) for name in ("SIGINT", "SIGHUP") if hasattr(signal, name)]
_IDLE = 10.0  # seconds after which a worker without a job ends


@dataclass(frozen=True)
class Failed:
    """In the place of a job's result: why there is none. Its worker died, and a fresh one as well; other jobs went on."""

    reason: str


def _died(workers: int) -> Failed:
    return Failed(f"failed: {workers} workers died of it (killed, or out of memory)")


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


def of_this_machine(workers: Workers) -> int | None:
    """Processes here, also where a cluster did other work: for jobs on files, which the cluster may not see.

    Examples
    --------
    >>> of_this_machine(2)
    2
    """
    return int(workers) if isinstance(workers, Integral) else None


def run_jobs(jobs: Sequence[Callable[[], Result]], workers: Workers) -> Iterator[tuple[int, Result | Failed]]:
    """Yield (index, what the job returned) as they finish, in any order; one BLAS thread in every process.

    A job whose worker dies (killed, out of memory) is tried once more, in a fresh worker; after a second death it is :class:`Failed`. On a
    cluster its scheduler says after how many.

    A job is a call that is still to be made, `partial(function, ...)`, of a function that can be imported: worker processes receive it by
    name. On one machine this process takes its share of the jobs: it needs the same libraries anyhow, and a worker less has to load them.

    Examples
    --------
    >>> from functools import partial
    >>> list(run_jobs([partial(pow, 2, 3), partial(pow, 3, 2)], workers=1))
    [(0, 8), (1, 9)]
    """
    if workers is None or isinstance(workers, Integral):  # NumPy's too
        return _run_here(jobs, workers if workers is None else int(workers))
    from bayes_toe.cluster import run_on

    return run_on(workers, jobs, _died)


def run_in_order(
    jobs: Sequence[Callable[[], Result]], workers: Workers, progress: Progress | None, names: Sequence[tuple[str, ...]]
) -> list[Result]:
    """Results of :func:`run_jobs` in the order of the jobs; progress is told a job's names, none or some, as soon as it is done.

    Raises
    ------
    WorkerError
        If a job failed, see :func:`run_or_fail` for those that can do without.
    """
    found: list[Result] = []
    for name, result in zip(names, run_or_fail(jobs, workers, progress, names), strict=True):
        if isinstance(result, Failed):
            raise WorkerError(": ".join([*name, result.reason]))
        found.append(result)
    return found


def run_or_fail(
    jobs: Sequence[Callable[[], Result]], workers: Workers, progress: Progress | None, names: Sequence[tuple[str, ...]]
) -> list[Result | Failed]:
    """The same where others go on without a job that failed."""
    results: dict[int, Result | Failed] = {}
    for index, result in run_jobs(jobs, workers):
        results[index] = result
        tell(progress, names[index])
    return [results[index] for index in range(len(jobs))]


def tell(progress: Progress | None, names: Iterable[str]) -> None:
    """Say to whoever wants to hear it what is done."""
    if progress is not None:
        for name in names:
            progress(name)


def stop_workers() -> None:
    """End workers at once. They wait for further calls otherwise, and take their time to tidy up when this process ends."""
    with ThreadPoolExecutor() as pool:
        list(pool.map(_Lane.stop, _lanes))
    _lanes.clear()


def _run_here(jobs: Sequence[Callable[[], Result]], workers: int | None) -> Iterator[tuple[int, Result | Failed]]:
    from threadpoolctl import threadpool_limits

    count = worker_count(workers, len(jobs))
    with threadpool_limits(1):
        if count == 1:
            for index, job in enumerate(jobs):
                yield index, job()
        else:
            yield from _shared(jobs, count - 1)


class _Lane:
    """One worker process in an executor of its own: where it dies, it is known of which job."""

    def __init__(self) -> None:
        self._executor = self._fresh()

    def submit(self, job: Callable[[], Result]) -> Future[Result]:
        from loky import BrokenProcessPool

        # A worker that was idle has ended. An executor that starts another by itself may not notice when that one dies: its thread waits
        # for processes that it knew when it began to wait.
        if not self._executor._processes:
            self.renew()
        try:
            return self._submitted(job)
        except BrokenProcessPool:  # the worker died while it had nothing to do
            self.renew()
            return self._submitted(job)

    def renew(self) -> None:
        """A fresh worker in the place of one that died."""
        self._executor = self._fresh()

    def stop(self) -> None:
        self._executor.shutdown(wait=True, kill_workers=True)

    def _submitted(self, job: Callable[[], Result]) -> Future[Result]:
        with _not_for_workers():
            future: Future[Result] = self._executor.submit(job)
        return future

    def _fresh(self) -> Any:
        from loky import ProcessPoolExecutor

        env = dict.fromkeys(_THREADS, "1")
        return ProcessPoolExecutor(max_workers=1, timeout=_IDLE, env=env, initializer=_begin, initargs=(os.getpid(),))


_lanes: list[_Lane] = []  # kept from call to call
atexit.register(_lanes.clear)  # while the libraries that executors need to go are still there


@contextmanager
def _not_for_workers() -> Iterator[None]:
    """Start a process that holds back what a terminal says until :func:`_begin`: Python, beginning, would die of it with many lines."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    from loky.backend import resource_tracker as of_loky

    for tracker in (resource_tracker, of_loky):
        tracker.ensure_running()  # each ends, when it begins, what is held back
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _FROM_TERMINALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(parent: int) -> None:
    """In a worker, first: what a terminal says to all its processes is for the parent to answer, and no worker outlives its parent."""
    for one in _FROM_TERMINALS:
        signal.signal(one, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _FROM_TERMINALS)
    Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    """A parent that is killed cannot say so: look whether it is there."""
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)


def _shared(jobs: Sequence[Callable[[], Result]], others: int) -> Iterator[tuple[int, Result | Failed]]:
    """Share jobs between this process and `others` workers."""
    _lanes.extend(_Lane() for _ in range(others - len(_lanes)))
    sharing = _Sharing(jobs)
    try:
        for lane in _lanes[:others]:
            sharing.hand_out(lane)
        left = len(jobs)
        while left:
            own = sharing.next()
            if own is not None:
                yield own, _apart(jobs[own])()
                left -= 1
            while left and (own is None or not sharing.done.empty()):
                found = sharing.heard()
                if found is not None:
                    yield found
                    left -= 1
    except KeyboardInterrupt:
        stop_workers()  # the session may go on, and nobody waits for what they are at
        raise
    finally:
        sharing.waiting.clear()


def _apart(job: Callable[[], Result]) -> Callable[[], Result]:
    """A job as a worker receives it.

    A thread makes others ready to be sent meanwhile, and what jobs share must not change under it: objects remember what they computed.
    """
    from cloudpickle import dumps, loads

    copy: Callable[[], Result] = loads(dumps(job))
    return copy


class _Sharing(Generic[Result]):
    """Jobs that wait, and what workers have done; a worker that is done is handed the next job at once, by callback.

    A job that a worker died of goes to a worker again, never to this process.
    """

    def __init__(self, jobs: Sequence[Callable[[], Result]]) -> None:
        self.jobs, self.waiting, self.died = jobs, deque(range(len(jobs))), Counter[int]()
        self.done: SimpleQueue[tuple[_Lane, int, Future[Result]]] = SimpleQueue()

    def next(self) -> int | None:
        """A job that waits; another thread may take the last one: only the attempt tells."""
        with suppress(IndexError):
            return self.waiting.popleft()
        return None

    def hand_out(self, lane: _Lane) -> None:
        index = self.next()
        if index is not None:
            self._start(lane, index)

    def heard(self) -> tuple[int, Result | Failed] | None:
        """Wait for a worker; None where it died and the job is tried again."""
        from loky.process_executor import TerminatedWorkerError

        lane, index, future = self.done.get()
        if not isinstance(future.exception(), TerminatedWorkerError):
            return index, future.result()
        self.died[index] += 1
        lane.renew()
        if self.died[index] < _ATTEMPTS:
            self._start(lane, index)
            return None
        self.hand_out(lane)
        return index, _died(_ATTEMPTS)

    def _start(self, lane: _Lane, index: int) -> None:
        from loky.process_executor import ShutdownExecutorError

        with suppress(ShutdownExecutorError):  # all is being stopped
            lane.submit(self.jobs[index]).add_done_callback(lambda future: self._finish(lane, index, future))

    def _finish(self, lane: _Lane, index: int, future: Future[Result]) -> None:
        self.done.put((lane, index, future))
        if future.exception() is None:
            self.hand_out(lane)
