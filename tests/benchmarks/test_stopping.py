"""Benchmarks that are stopped with Ctrl-C: their processes end without a word, and what was finished is kept."""

from __future__ import annotations

import multiprocessing
import operator
import os
import select
import signal
import subprocess
import sys
import time
from concurrent.futures import Future
from contextlib import contextmanager
from multiprocessing import connection

import pytest

from benchmarks import setups
from benchmarks.results_file import ROOT
from benchmarks.side_by_side import side_by_side
from tests.kept_results import KeptResults, until_stopped

AT_WORK = """
import multiprocessing, operator, os, time
from benchmarks.results_file import ROOT
from benchmarks.side_by_side import side_by_side
if __name__ == "__main__":
    with side_by_side(operator.call, [(os.getpid,), (time.sleep, 60.0), (time.sleep, 60.0)], 2) as running:
        running[0].result()
        print(*(process.pid for process in multiprocessing.active_children()), flush=True)
"""


def test_processes_leave_an_interrupt_to_the_one_that_started_them():
    """A terminal sends it to all of them. What is still at work then is ended at once."""
    handler = signal.getsignal(signal.SIGINT)
    jobs = [(signal.raise_signal, signal.SIGINT), (time.sleep, 60.0)]
    seen = []

    def interrupted():
        with side_by_side(operator.call, jobs, 1) as running:
            seen.append(signal.getsignal(signal.SIGINT))
            seen.append(running[0].result())
            seen.extend(multiprocessing.active_children())
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert seen[:2] == [handler, None]
    (worker,) = seen[2:]
    # Not is_alive: while a thread of the pool takes the exit status, it cannot tell.
    assert connection.wait([worker.sentinel], 20.0)


def test_processes_end_with_the_one_that_started_them_where_it_is_killed():
    parent = subprocess.Popen([sys.executable, "-c", AT_WORK], cwd=ROOT, stdout=subprocess.PIPE, text=True)
    with parent:
        workers = [os.pidfd_open(int(number)) for number in parent.stdout.readline().split()]
        try:
            parent.kill()
            for worker in workers:
                assert select.select([worker], [], [], 20.0)[0]
        finally:
            for worker in workers:
                os.close(worker)
    assert len(workers) == 2


def test_set_ups_go_on_from_the_seeds_that_were_finished(tmp_path, monkeypatch, capsys):
    asked = []

    @contextmanager
    def stopped_at_the_second(_run, jobs, _processes):
        asked.append([seed for (seed,) in jobs])
        out = [Future() for _ in jobs]
        for future, seed in zip(out, asked[-1], strict=True):
            if len(asked) == 1 and seed == 2:
                future.set_exception(KeyboardInterrupt())
            else:
                future.set_result(setups.Score(seed, (1e-6, 1.05e-6), (1e-6, 1e-6), (1074, 1074), 12.0, 12))
        yield out

    monkeypatch.setattr(setups, "side_by_side", stopped_at_the_second)
    monkeypatch.setattr(setups, "as_completed", iter)
    monkeypatch.setattr(sys, "argv", ["setups", "--seeds", "1,2,3", "--out", str(tmp_path)])
    assert until_stopped(setups.main) == 130
    assert capsys.readouterr().err == "stopped; the same command goes on from here\n"
    assert until_stopped(setups.main) == 0
    assert asked == [[1, 2, 3], [2, 3]]
    said = capsys.readouterr().out
    assert [line.split()[1] for line in said.splitlines() if line.startswith("seed")] == ["1", "2", "3"]
    assert "(median): 1.050" in said
    monkeypatch.setattr(setups, "code_digest", lambda *_: "of another version")
    assert until_stopped(setups.main) == 0
    assert asked[-1] == [1, 2, 3]


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    path = tmp_path / "file" / "results.jsonl"

    def main():
        return len(KeptResults(path))

    assert until_stopped(main) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"results cannot be kept in {path}: ")
    assert line.endswith("; name another folder")
