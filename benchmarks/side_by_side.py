"""Jobs of a benchmark in processes side by side, which end without a word when the benchmark is interrupted."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import connection
from typing import TypeVar

_Result = TypeVar("_Result")


@contextmanager
def side_by_side(
    run: Callable[..., _Result], jobs: Iterable[tuple[object, ...]], processes: int
) -> Iterator[list[Future[_Result]]]:
    """`run` with the arguments of each job, in their order; what has not ended when the block fails is given up.

    Each process loads numpy anew, by the environment of this one. They ignore an interrupt, which a terminal sends to
    them too: this process ends them. Where it is killed itself, they end by themselves.
    """
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(processes, mp_context=context, initializer=end_with_parent)
    try:
        former = signal.signal(signal.SIGINT, signal.SIG_IGN)  # the processes that start now inherit it
        try:
            running = [pool.submit(run, *job) for job in jobs]
        finally:
            signal.signal(signal.SIGINT, former)
        yield running
    except BaseException:
        workers = list(multiprocessing.active_children())
        pool.shutdown(wait=False, cancel_futures=True)
        for worker in workers:
            worker.terminate()
        raise
    pool.shutdown()


def end_with_parent() -> None:
    """Have this process end with the one that started it, which a pool's processes do not: they would wait for ever for
    what it has them do next.
    """
    parent = multiprocessing.parent_process()
    if parent is None:
        raise RuntimeError("only a process that another one has started ends with it")
    sentinel = parent.sentinel

    def watch() -> None:
        connection.wait([sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
