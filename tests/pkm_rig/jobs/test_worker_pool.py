"""Work in this process, in others and on a Dask cluster: the same results, and a failure is that of one task."""

from __future__ import annotations

import logging
import os
import sys

import pytest

from calibration.base.errors import InputError
from pkm_rig.errors import WorkersGone
from pkm_rig.jobs import worker_pool as module
from pkm_rig.jobs.worker_pool import AHEAD, KILLED, Attempt, DaskCluster, LocalProcesses, OneByOne, Task, worker_pool
from tests.pkm_rig.jobs import pool_tasks

NUMBERS = range(2, 9)
WANTED = sorted(
    [*(Attempt(f"t{n}", n * n) for n in NUMBERS), Attempt("refused", failure="1: too few readings"),
     Attempt("failed", failure="internal error: ZeroDivisionError: division by zero; please report it")],
    key=lambda attempt: attempt.name,
)  # fmt: skip


@pytest.fixture(scope="module")
def scheduler():
    """The address of a scheduler with two workers, which are processes of their own."""
    distributed = pytest.importorskip("distributed")
    import dask  # noqa: PLC0415

    former = logging.getLogger("distributed").level
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
    ):
        yield cluster.scheduler_address
    logging.getLogger("distributed").setLevel(former)


@pytest.fixture(params=["here", "processes", "cluster"])
def pool(request):
    if request.param == "here":
        yield OneByOne()
    elif request.param == "processes":
        yield LocalProcesses(2)
    else:
        with worker_pool(9, None, request.getfixturevalue("scheduler")) as pool:
            assert isinstance(pool, DaskCluster)
            yield pool


def tasks():
    yield Task("refused", pool_tasks.refuse, (1,))
    for number in NUMBERS:
        yield Task(f"t{number}", pool_tasks.square, (number,))
        if number == 4:
            yield Task("failed", pool_tasks.fail, (1,))


def by_name(attempts):
    return sorted(attempts, key=lambda attempt: attempt.name)


def test_all_ways_give_the_same_and_name_what_failed(pool):
    assert by_name(pool.attempts(tasks())) == WANTED
    assert list(pool.attempts(iter(()))) == []


@pytest.mark.parametrize("kind", ["processes", "cluster"])
def test_a_task_that_kills_its_process_is_named_and_ends_no_other(kind, request):
    def with_killer():
        for number, task in enumerate(tasks()):
            yield task
            if number == 1:
                yield Task("killer", pool_tasks.die, (9,))

    address = request.getfixturevalue("scheduler") if kind == "cluster" else None
    with worker_pool(10, None if address else 2, address) as pool:
        found = by_name(pool.attempts(with_killer()))
    assert [attempt for attempt in found if attempt.name == "killer"] == [Attempt("killer", failure=KILLED)]
    assert [attempt for attempt in found if attempt.name != "killer"] == WANTED


def test_few_tasks_are_asked_for_ahead(pool):
    """Recordings travel with their tasks: thousands must not be in memory at once, however slowly results are taken."""
    taken, ahead = [], []

    def many():
        for number in range(60):
            ahead.append(number + 1 - len(taken))
            yield Task(f"t{number}", pool_tasks.square, (number,))

    for done in pool.attempts(many()):
        taken.append(done)
    assert max(ahead) <= 2 * AHEAD
    assert len(taken) == 60


def test_processes_end_where_nobody_takes_the_rest():
    attempts = LocalProcesses(2).attempts(Task(f"t{n}", pool_tasks.own_process) for n in NUMBERS)
    process = next(attempts).value
    os.kill(process, 0)
    attempts.close()
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)


def test_processes_end_also_just_when_tasks_were_given_to_them():
    """A thread of the executor that stumbled over one of them would end the test."""
    for _ in range(8):
        executor = LocalProcesses(2)._executor()
        given = [module._submitted(executor, Task(f"t{n}", pool_tasks.own_process)) for n in range(2 * AHEAD)]
        module._end(executor, given)
        assert all(future.done() for future in given)


def test_a_pool_has_no_more_processes_than_tasks():
    with worker_pool(1, None, None) as pool:
        assert isinstance(pool, OneByOne)
    with worker_pool(5, 1, None) as pool:
        assert isinstance(pool, OneByOne)
    with worker_pool(5, 2, None) as pool:
        assert isinstance(pool, LocalProcesses)


@pytest.mark.parametrize(
    ("jobs", "scheduler", "message"),
    [(0, None, "give 1 or more"), (2, "tcp://h:1", "give one of them"), (None, "host:8786", "no address"),
     (None, "http://h:1", "no address"), (None, "tcp://", "no address")],
)  # fmt: skip
def test_wishes_without_sense_are_refused(jobs, scheduler, message):
    with pytest.raises(InputError, match=message), worker_pool(5, jobs, scheduler):
        pass


def test_without_the_extra_it_computes_here_or_says_what_is_missing(monkeypatch):
    for name in ("joblib", "distributed"):
        monkeypatch.setitem(sys.modules, name, None)
    with worker_pool(5, None, None) as pool:
        assert isinstance(pool, OneByOne)
    for jobs, scheduler in ((2, None), (None, "tcp://127.0.0.1:1")):
        with pytest.raises(InputError, match=r"pip install 'pkm-rig\[fleet\]'"), worker_pool(5, jobs, scheduler):
            pass


def test_a_scheduler_that_is_not_there_is_named():
    pytest.importorskip("distributed")
    with pytest.raises(WorkersGone, match=r"no Dask scheduler answers at tcp://127.0.0.1:1; start it with `dask"):
        worker_pool(5, None, "tcp://127.0.0.1:1").__enter__()


def test_workers_of_another_version_are_refused(scheduler, monkeypatch):
    monkeypatch.setattr(module, "__version__", "0.0.9")
    with pytest.raises(WorkersGone, match=r"have pkm-rig .*; install 0.0.9 there"):
        worker_pool(5, None, scheduler).__enter__()
