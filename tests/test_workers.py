"""Work shared between processes."""

import os
import signal
import time
from functools import partial

import pytest
from processes import die

from bayes_toe.errors import WorkerError
from bayes_toe.workers import Failed, run_in_order, run_or_fail

FATAL = "failed: 2 workers died of it (killed, or out of memory)"


def slow(value):
    time.sleep(0.3)
    return value


@pytest.mark.parametrize(("deaths", "expected"), [(1, "alive"), (9, Failed(FATAL))], ids=["once", "always"])
@pytest.mark.parametrize("workers", [2, 3])
def test_a_job_whose_worker_dies_is_tried_once_more_and_no_other_job_suffers(tmp_path, workers, deaths, expected):
    jobs = [partial(die, os.getpid(), tmp_path / "marks", deaths), *(partial(slow, k) for k in range(6))]
    said, names = [], [(str(k),) for k in range(7)]
    assert run_or_fail(jobs, workers, said.append, names) == [expected, *range(6)]
    assert (tmp_path / "marks").stat().st_size == 2
    assert sorted(said) == sorted(str(k) for k in range(7))


def test_where_every_result_is_needed_the_one_that_is_missing_is_named(tmp_path):
    jobs = [partial(die, os.getpid(), tmp_path / "marks", 9), partial(slow, 1)]
    with pytest.raises(WorkerError) as error:
        run_in_order(jobs, 2, None, [("S01",), ("S02",)])
    assert str(error.value) == f"S01: {FATAL}"


def test_a_worker_that_died_without_work_is_replaced():
    from bayes_toe.workers import _lanes

    jobs = [partial(os.getpid), partial(slow, 1)]
    idle, _ = run_in_order(jobs, 2, None, [(), ()])
    assert len(_lanes) >= 1
    os.kill(idle, signal.SIGKILL)
    time.sleep(0.2)
    fresh, _ = run_in_order(jobs, 2, None, [(), ()])
    assert fresh not in (idle, os.getpid())


def interrupted():
    raise KeyboardInterrupt


def test_an_interrupt_leaves_no_worker_at_work():
    from bayes_toe.workers import _lanes

    with pytest.raises(KeyboardInterrupt):
        run_in_order([partial(slow, 1), partial(interrupted)], 2, None, [(), ()])
    assert not _lanes


@pytest.mark.parametrize("workers", [1, 2])
def test_results_are_in_the_order_of_the_jobs_and_progress_hears_each_name_once(workers):
    said = []
    names = [("a",), (), ("b", "c"), ("d",)]
    assert run_in_order([partial(pow, 2, k) for k in range(4)], workers, said.append, names) == [1, 2, 4, 8]
    assert sorted(said) == ["a", "b", "c", "d"]


class Remembering:
    """An object that grows while it is used, as one with cached properties does."""

    def __init__(self):
        self.size = 3000

    def used(self, index):
        for k in range(self.size):
            setattr(self, f"{index}_{k}", k)
        return index


def test_jobs_may_share_what_remembers_what_it_computed():
    shared = Remembering()
    jobs = [partial(shared.used, index) for index in range(40)]
    assert run_in_order(jobs, 2, None, [()] * 40) == list(range(40))
    assert vars(shared) == {"size": 3000}
