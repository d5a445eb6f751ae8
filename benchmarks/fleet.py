"""Many campaigns: the headers of 10,000 listed and charted, and 40 diagnosed by two Dask workers as by one process.

`python -m benchmarks.fleet [--campaigns 10000] [--diagnosed 40] [--part lists|cluster] [--out runs/fleet]`. Stores are
kept and made once; diagnoses are kept as they come, by `pkm-rig diagnose --all` itself. Stopped, it goes on. CPU time
is printed beside the time that passed, which other work on the computer makes longer. Exit status 1 where a goal is
missed.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from benchmarks.big_store import READINGS, RIGS, fill
from pkm_rig.store.place import STORE_NAME
from pkm_rig.store.store import Store
from tests.kept_results import until_stopped
from tests.pkm_rig.plant_recording import record

LIMIT_S = 10.0
WORKERS = 2
POSES = 12
STARTED_S = 60.0


def main() -> int:
    """Run both parts, print what came of each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaigns", type=int, default=10_000)
    parser.add_argument("--diagnosed", type=int, default=40)
    parser.add_argument("--part", choices=("lists", "cluster"))
    parser.add_argument("--out", type=Path, default=Path("runs/fleet"))
    options = parser.parse_args()
    good = True
    if options.part != "cluster":
        good &= lists(options.out / f"lists-{options.campaigns}", options.campaigns)
    if options.part != "lists":
        good &= cluster(options.out / f"cluster-{options.diagnosed}", options.diagnosed)
    return 0 if good else 1


def lists(out: Path, campaigns: int) -> bool:
    """Time the commands that show all campaigns, from the shell's prompt to the next."""
    if not (out / "whole").exists():
        print(f"making a store of {campaigns} campaigns ...", file=sys.stderr, flush=True)
        (out / STORE_NAME).unlink(missing_ok=True)
        out.mkdir(parents=True, exist_ok=True)
        fill(out / STORE_NAME, campaigns)
        (out / "whole").touch()
    size = (out / STORE_NAME).stat().st_size / 1e9
    print(f"{campaigns} campaigns of {RIGS} rigs, {READINGS} readings each, {size:.2f} GB")
    good = True
    for words in (("list",), ("list", "--chart")):
        seconds, cpu, printed = timed(*words, "--out", str(out))
        lines = sum(line.startswith("campaign-") for line in printed.splitlines())
        goal = seconds <= LIMIT_S and lines == campaigns
        good &= goal
        word = "ok   " if goal else "short"
        print(f"{word} pkm-rig {' '.join(words):13} {seconds:5.1f} s, CPU {cpu:5.1f} s: {lines} headers", flush=True)
    seconds, cpu, printed = timed("history", "--all", "--json", "--out", str(out))
    rigs = json.loads(printed)["rigs"]
    count = sum(len(rig["calibrations"]) for rig in rigs)
    print(f"      pkm-rig history --all {seconds:5.1f} s, CPU {cpu:5.1f} s: {count} calibrations, {len(rigs)} pictures")
    return good


def timed(*words: str) -> tuple[float, float, str]:
    """How long a command takes, its CPU time with that of its processes, and what it prints."""
    before, begun_s = _cpu_s(), time.monotonic()
    done = subprocess.run([sys.executable, "-m", "pkm_rig.cli", *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(done.stderr.strip().splitlines()[-1])
    return time.monotonic() - begun_s, _cpu_s() - before, done.stdout


def _cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def cluster(out: Path, campaigns: int) -> bool:
    """Diagnose in one process, and again with two Dask workers of this computer; both in folders of their own."""
    places = {name: out / name for name in ("one-process", "two-workers")}
    for place in places.values():
        _stored(place, campaigns)
    found, seconds = {}, {}
    with dask_workers() as address:
        for name, words in (("one-process", ("--jobs", "1")), ("two-workers", ("--scheduler", address))):
            begun_s = time.monotonic()
            found[name] = _diagnosed(places[name], words)
            seconds[name] = time.monotonic() - begun_s
    kept = max(result["kept"] for result in found.values())
    same = len({_figures(found[name], place) for name, place in places.items()}) == 1
    files = [_files(place) for place in places.values()]
    goal = same and files[0] == files[1] and all(result["done"] == campaigns for result in found.values())
    again = f"; {kept} of them were computed before" if kept else ""
    print(
        f"{'ok   ' if goal else 'short'} {campaigns} campaigns diagnosed: results {'equal' if same else 'DIFFER'}, "
        f"{len(files[0])} files {'equal' if files[0] == files[1] else 'DIFFER'}; one process "
        f"{seconds['one-process']:.0f} s, {WORKERS} Dask workers {seconds['two-workers']:.0f} s{again}"
    )
    return goal


def _stored(place: Path, campaigns: int) -> None:
    with closing(Store(place / STORE_NAME)) as store:
        there = {row.campaign for row in store.campaigns()}
        for number in range(campaigns):
            name = f"campaign-{number:03d}"
            if name not in there:
                recording = record(number + 1, calibration_poses=POSES)
                begun = datetime(2026, 1, 1, tzinfo=UTC) + timedelta(days=number)
                head = {"campaign": name, "rig": f"rig-{number % 4}", "created": begun.isoformat()}
                store.add_recording(replace(recording, file=recording.file.model_copy(update=head)))


def _diagnosed(place: Path, words: tuple[str, ...]) -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, "-m", "pkm_rig.cli", "diagnose", "--all", "--json", "--out", str(place), *words],
        stdout=subprocess.PIPE, text=True, check=False,
    )  # fmt: skip
    if not done.stdout:
        raise RuntimeError(f"diagnose --all {' '.join(words)}: status {done.returncode}")
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def _figures(result: dict[str, Any], place: Path) -> str:
    """All that was found, without where it lies and whether it was there before."""
    entries = [{key: value for key, value in entry.items() if key != "kept"} for entry in result["campaigns"]]
    return json.dumps(entries, sort_keys=True).replace(str(place), "")


def _files(place: Path) -> dict[str, bytes]:
    files = [path for path in place.rglob("*") if path.is_file() and path.parent.name == "diagnosis"]
    return {str(path.relative_to(place)): path.read_bytes() for path in files}


@contextmanager
def dask_workers() -> Iterator[str]:
    """The address of a scheduler with two workers, programs of this computer as a user starts them."""
    environment = os.environ | {"PYTHONUNBUFFERED": "1"}
    python, quiet = [sys.executable, "-m"], {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    file = Path(f"/tmp/pkm-rig-scheduler-{os.getpid()}.json")  # where the scheduler says its address
    started = [
        subprocess.Popen(
            [*python, "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard",
             "--scheduler-file", str(file)],
            env=environment, **quiet,
        )
    ]  # fmt: skip
    try:
        address = _address(file, started[0])
        for _ in range(WORKERS):
            worker = [*python, "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-dashboard"]
            started.append(subprocess.Popen(worker, env=environment, **quiet))
        yield address
    finally:
        for process in reversed(started):
            process.terminate()
        for process in started:
            process.wait(timeout=STARTED_S)
        file.unlink(missing_ok=True)


def _address(file: Path, scheduler: subprocess.Popen[bytes]) -> str:
    until_s = time.monotonic() + STARTED_S
    while time.monotonic() < until_s and scheduler.poll() is None:
        if file.exists():
            try:
                return str(json.loads(file.read_text())["address"])
            except (ValueError, KeyError):  # it is being written
                pass
        time.sleep(0.2)
    raise RuntimeError("the Dask scheduler did not start")


if __name__ == "__main__":
    sys.exit(until_stopped(main))
