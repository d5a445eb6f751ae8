"""The same work on many things: one after the other, in processes of this computer (joblib), or on a Dask cluster.

A failure is that of one thing and ends no other, also where it kills the process that works on it.
"""

from __future__ import annotations

import logging
import os
import socket
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Protocol
from urllib.parse import urlsplit

from calibration.base.errors import InputError
from pkm_rig.errors import CampaignRefused, StoreError, WorkersGone
from pkm_rig.version import __version__

MISSING = "needs the extra [fleet]; install it with: pip install 'pkm-rig[fleet]'"
KILLED = "the process that worked on it ended: killed, or out of memory"
WAIT_S = 10.0  # for the scheduler, and for a first worker
AHEAD = 2  # tasks that are given out for each core
IDLE_S = 300.0  # after which an idle process ends, as under joblib's `Parallel`
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
MOMENTS, MOMENT_S = 1000, 1e-3  # for which tasks may wait for a place in the executor's queue
SCHEMES, DASK_PORT = ("tcp", "tls"), 8786


@dataclass(frozen=True)
class Task:
    """What is to be done with one thing; all of it can be sent to another computer."""

    name: str
    function: Callable[..., Any]
    arguments: tuple[Any, ...] = ()


@dataclass(frozen=True)
class Attempt:
    """What came of it; `failure` is one line, empty if it went well."""

    name: str
    value: Any = None
    failure: str = ""


class Pool(Protocol):
    """Who does tasks."""

    def attempts(self, tasks: Iterable[Task]) -> Iterator[Attempt]:
        """Each task's, as they come; tasks are asked for a few at a time. WorkersGone if nobody is left to do them."""
        ...


def attempt(task: Task) -> Attempt:
    """Do a task; whatever it raises is its failure."""
    try:
        return Attempt(task.name, task.function(*task.arguments))
    except (InputError, StoreError, CampaignRefused) as error:
        return Attempt(task.name, failure=str(error))
    except Exception as error:
        return Attempt(task.name, failure=f"internal error: {type(error).__name__}: {error}; please report it")


class OneByOne:
    """In this process."""

    def attempts(self, tasks: Iterable[Task]) -> Iterator[Attempt]:
        """In their order."""
        return map(attempt, tasks)


class LocalProcesses:
    """Processes of this computer.

    joblib's executor, not its `Parallel`, which asks for a task whenever one is done, even if nobody takes the results.
    """

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs

    def attempts(self, tasks: Iterable[Task]) -> Iterator[Attempt]:
        """As they come; those that were under way when a process was killed are done again, each alone."""
        waiting, running = iter(tasks), dict[Future[Attempt], Task]()
        try:
            while True:
                killed = []
                executor = self._executor()
                for task in _first(waiting, AHEAD * self._jobs):
                    running[_submitted(executor, task)] = task
                while running:
                    for future in wait(running, return_when=FIRST_COMPLETED).done:
                        task = running.pop(future)
                        done = _unless_killed(future)
                        if done is None:
                            killed.append(task)
                        else:
                            yield done
                        for following in _first(waiting, 0 if killed else 1):
                            running[_submitted(executor, following)] = following
                if not killed:
                    return
                for task in killed:
                    executor = self._executor()
                    again = _submitted(executor, task)
                    running[again] = task
                    done = _unless_killed(again)
                    del running[again]
                    yield done or Attempt(task.name, failure=KILLED)
        finally:
            if running:  # nobody takes the rest
                _end(executor, running)

    def _executor(self) -> Any:
        """The processes; new ones where one was killed. They share the cores, as they do under `Parallel`."""
        from joblib import cpu_count  # noqa: PLC0415 - an extra
        from joblib.externals.loky import get_reusable_executor  # noqa: PLC0415

        threads = str(max(cpu_count() // self._jobs, 1))
        env = {name: os.environ.get(name, threads) for name in THREADS}
        return get_reusable_executor(self._jobs, timeout=IDLE_S, env=env)


def _end(executor: Any, given: Iterable[Future[Attempt]]) -> None:
    """End the processes, whatever they are at.

    The executor forgets tasks that wait for a place in its queue and then looks for them. There is a place for each, so
    they wait for moments only.
    """
    for _ in range(MOMENTS):
        if all(future.running() or future.done() for future in given):
            break
        time.sleep(MOMENT_S)
    executor.shutdown(kill_workers=True)


def _submitted(executor: Any, task: Task) -> Future[Attempt]:
    """A task that was given to processes; where one has just been killed it ends as those did that they had."""
    from joblib.externals.loky.process_executor import TerminatedWorkerError  # noqa: PLC0415

    try:
        future: Future[Attempt] = executor.submit(attempt, task)
    except TerminatedWorkerError as error:
        future = Future()
        future.set_exception(error)
    return future


def _unless_killed(future: Future[Attempt]) -> Attempt | None:
    """A future's result, once it is there; None if a process was killed."""
    from joblib.externals.loky.process_executor import TerminatedWorkerError  # noqa: PLC0415

    try:
        return future.result()
    except TerminatedWorkerError:
        return None


class DaskCluster:
    """The workers of a Dask scheduler, through its own futures.

    joblib's backend for Dask waits for ever for a task whose worker was killed.
    """

    def __init__(self, client: Any, address: str) -> None:
        self._client, self._address = client, address

    def attempts(self, tasks: Iterable[Task]) -> Iterator[Attempt]:
        """As they come; where workers were killed the tasks that they had are done again, each alone."""
        from distributed import as_completed  # noqa: PLC0415 - an extra

        waiting, running, killed = iter(tasks), {}, []
        ahead = max(AHEAD * sum(self._client.ncores().values()), AHEAD)
        completed = as_completed(loop=self._client.loop)
        for task in _first(waiting, ahead):
            running[self._submit(task, completed)] = task
        for future in completed:
            task = running.pop(future.key)
            done = self._result(task, future)
            if done is None:
                killed.append(task)
            else:
                yield done
            for following in _first(waiting, 1):
                running[self._submit(following, completed)] = following
        for task in killed:
            yield self._result(task, self._client.submit(attempt, task, pure=False)) or Attempt(
                task.name, failure=KILLED
            )

    def _submit(self, task: Task, completed: Any) -> str:
        future = self._client.submit(attempt, task, pure=False)
        completed.add(future)
        return str(future.key)

    def _result(self, task: Task, future: Any) -> Attempt | None:
        """A future's result, once it is there; None if its workers were killed."""
        from distributed import KilledWorker  # noqa: PLC0415

        try:
            done: Attempt = future.result()
        except KilledWorker:
            return None
        except BaseException as error:
            if future.status in ("cancelled", "lost"):
                raise WorkersGone(
                    f"the Dask scheduler at {self._address} is gone; start it again, then the same command goes on"
                ) from error
            if not isinstance(error, Exception):
                raise
            return Attempt(task.name, failure=f"on the cluster: {type(error).__name__}: {error}")
        return done


def _first(tasks: Iterator[Task], count: int) -> Iterator[Task]:
    for _ in range(count):
        try:
            yield next(tasks)
        except StopIteration:
            return


@contextmanager
def worker_pool(tasks: int, jobs: int | None, scheduler: str | None) -> Iterator[Pool]:
    """Who does so many tasks: the cluster of a scheduler, else `jobs` processes, by default one a core.

    Without joblib, and where nothing was asked for, it is this process. InputError for a bad wish or a missing extra,
    WorkersGone where no scheduler or no worker answers, or workers have another version.
    """
    if scheduler is not None:
        if jobs is not None:
            raise InputError("--jobs is for this computer, --scheduler for a cluster; give one of them")
        with _cluster(scheduler) as pool:
            yield pool
        return
    if jobs is not None and jobs < 1:
        raise InputError(f"--jobs {jobs}: give 1 or more")
    try:
        import joblib  # noqa: PLC0415
    except ImportError as error:
        if jobs is not None and jobs > 1:
            raise InputError(f"--jobs {MISSING}") from error
        yield OneByOne()
        return
    number = min(jobs or joblib.cpu_count(), max(tasks, 1))
    yield OneByOne() if number == 1 else LocalProcesses(number)


@contextmanager
def _cluster(address: str) -> Iterator[DaskCluster]:
    if urlsplit(address).scheme not in SCHEMES or not urlsplit(address).netloc:
        raise InputError(f"--scheduler {address}: no address of a Dask scheduler; write tcp://HOST:8786")
    try:
        from distributed import Client  # noqa: PLC0415
    except ImportError as error:
        raise InputError(f"--scheduler {MISSING}") from error
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what goes wrong is raised as our own error
    start = f"start it with `dask scheduler`, and workers with `dask worker {address} --nthreads 1`"
    try:  # at once, where nobody listens; the client would try for the whole time
        parts = urlsplit(address)
        socket.create_connection((parts.hostname, parts.port or DASK_PORT), WAIT_S).close()
        client = Client(address, timeout=WAIT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise WorkersGone(f"no Dask scheduler answers at {address}; {start}") from error
    try:
        try:
            client.wait_for_workers(1, timeout=WAIT_S)
        except TimeoutError as error:
            raise WorkersGone(f"the Dask scheduler at {address} has no worker; {start}") from error
        _require_same_version(client, address)
        yield DaskCluster(client, address)
    finally:
        client.close()


def _require_same_version(client: Any, address: str) -> None:
    """Results are to be those of one process: WorkersGone where a worker would compute by other code."""
    try:
        versions = set(client.run(_version).values())
    except Exception as error:
        raise WorkersGone(
            f"workers of {address} cannot load pkm-rig ({type(error).__name__}: {error}); install version {__version__}"
        ) from error
    if others := versions - {__version__}:
        raise WorkersGone(f"workers of {address} have pkm-rig {', '.join(sorted(others))}; install {__version__} there")


def _version() -> str:
    return __version__
