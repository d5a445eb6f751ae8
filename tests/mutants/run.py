"""A seeded sample of mutants over drivers, diagnosis and identification, each against its room's tests.

`make mutants`, or `python -m tests.mutants.run [--number N] [--seed S [--record]] [--jobs N] [--only ROOM]
[--out FOLDER] [--fresh | --survivors] [--keep]`. Results are kept in FOLDER/mutants.jsonl as they come; a second call
goes on where the first was ended. `--keep` takes those of the recorded sample over into results.txt: what was killed is
not run again as long as its file does not change. With `--survivors` it also tries again what survived and is not
listed as equivalent: a test may have been added since. The status is 1 if fewer than 85 % of those that are not listed
as equivalent were killed, if more than 10 % are listed, or a survivor is not.

The sample is recorded in sample.txt: a change of the code takes the changed mutants out of it, and leaves the others
and what survivors.toml says of them. `--seed S` draws another one, `--record` records it.
"""

from __future__ import annotations

import argparse
import hashlib
import itertools
import json
import os
import random
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from tests.copied_tree import ROOT, copied_tree, nearest_first, run_tests, spoilt
from tests.mutants.mutate import Mutant, compiles, mutants

ROOMS = {
    "drivers/can": ("tests/drivers/can", "tests/drivers/drives"),
    "drivers/drives": ("tests/drivers/drives", "tests/drivers/can"),
    "drivers/plc": ("tests/drivers/plc",),
    "drivers/station": ("tests/drivers/station",),
    "calibration/diagnosis": ("tests/calibration/diagnosis",),
    "calibration/identification": ("tests/calibration/identification",),
}
SAMPLE = Path(__file__).with_name("sample.txt")
SURVIVORS = Path(__file__).with_name("survivors.toml")
RESULTS = Path(__file__).with_name("results.txt")
KILLED_SHARE, EQUIVALENT_SHARE = 0.85, 0.10
LEAST_LIMIT_S, SLOWER = 120.0, 4.0  # of processor time: a mutant may loop; times what the tests take without it


@dataclass(frozen=True)
class Drawn:
    """A mutant of a file, the `copy`-th of its function with the same texts.

    `key` is the same as long as the file's text is, `identity` as long as the changed texts are in the function.
    """

    file: str
    text: str
    mutant: Mutant
    copy: int

    @property
    def key(self) -> str:
        """Of the file's contents and the change."""
        return _hash(self.file, self.text, self.mutant.start, self.mutant.end, self.mutant.after)

    @property
    def identity(self) -> str:
        """Of the file's name, the function and the change."""
        return _hash(self.file, self.mutant.where, self.mutant.before, self.mutant.after, self.copy)

    @property
    def room(self) -> str:
        """The package whose tests it has to meet."""
        return next(room for room in ROOMS if self.file.startswith(f"{room}/"))

    @property
    def texts(self) -> tuple[str, str, str, str]:
        """By which it is found in survivors.toml."""
        return (self.file, self.mutant.where, self.mutant.before, self.mutant.after)

    def __str__(self) -> str:
        before, after = (" ".join(text.split()) for text in (self.mutant.before, self.mutant.after))
        return f"{self.file}:{self.mutant.line} {self.mutant.where}: {before} -> {after}"


def _hash(*parts: str | int) -> str:
    return hashlib.sha256("\0".join(map(str, parts)).encode()).hexdigest()[:16]


@cache
def every_mutant() -> tuple[Drawn, ...]:
    """All mutants of the rooms. A few may not compile."""
    return tuple(_every())


def _every() -> Iterator[Drawn]:
    for room in ROOMS:
        for path in sorted((ROOT / room).rglob("*.py")):
            text, copies = path.read_text(encoding="utf-8"), Counter[tuple[str, str, str]]()
            for mutant in mutants(text):
                texts = (mutant.where, mutant.before, mutant.after)
                yield Drawn(str(path.relative_to(ROOT)), text, mutant, copies[texts])
                copies[texts] += 1


def draw(number: int, seed: int) -> list[Drawn]:
    """A sample of all mutants of the rooms, each as likely as any other."""
    every = list(every_mutant())
    random.Random(seed).shuffle(every)
    good = (drawn for drawn in every if compiles(drawn.mutant.apply(drawn.text)))
    return list(itertools.islice(good, number))


def recorded() -> list[Drawn]:
    """What is still in the code of the recorded sample."""
    every = {drawn.identity: drawn for drawn in every_mutant()}
    identities = [line.split()[0] for line in SAMPLE.read_text(encoding="utf-8").splitlines()]
    return [every[identity] for identity in identities if identity in every]


def to_try(sample: Sequence[Drawn], known: Mapping[str, dict[str, Any]], *, survivors: bool) -> list[Drawn]:
    """What has no result; `survivors`: also what survived and may be killed by a test that was added."""
    equivalent = {texts for texts, entry in _survivors().items() if entry["equivalent"]}
    return [
        drawn
        for drawn in sample
        if drawn.key not in known
        or (survivors and known[drawn.key]["ran"] == "green" and drawn.texts not in equivalent)
    ]


def main() -> int:
    """Run what is missing of the sample and say what survived."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--number", type=int, default=300)
    parser.add_argument("--seed", type=int, help="draw another sample than the recorded one")
    parser.add_argument("--record", action="store_true", help="record the sample that is drawn")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--out", type=Path, default=Path("runs/mutants"))
    parser.add_argument("--only", default="", metavar="ROOM", help="mutants of the sample in this package")
    parser.add_argument("--fresh", action="store_true", help="forget former results")
    parser.add_argument("--survivors", action="store_true", help="try survivors again, except equivalent ones")
    parser.add_argument("--keep", action="store_true", help="only take results over into results.txt")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    path = arguments.out / "mutants.jsonl"
    if arguments.fresh:
        path.unlink(missing_ok=True)
    known = ({} if arguments.fresh else read_kept(RESULTS)) | _read(path)
    if arguments.keep:
        keep(RESULTS, [known[drawn.key] for drawn in recorded() if drawn.key in known])
        return 0
    every = recorded()[: arguments.number] if arguments.seed is None else draw(arguments.number, arguments.seed)
    if arguments.record:
        SAMPLE.write_text("".join(f"{d.identity} {d.file} {d.mutant.where}\n" for d in every), encoding="utf-8")
    sample = [drawn for drawn in every if drawn.room.startswith(arguments.only)]
    missing = to_try(sample, known, survivors=arguments.survivors)
    print(f"{len(sample)} mutants, {len(sample) - len(missing)} of them not tried again", flush=True)
    with ExitStack() as stack, path.open("a", encoding="utf-8") as file:
        trees: SimpleQueue[Path] = SimpleQueue()
        for _ in range(arguments.jobs):
            trees.put(stack.enter_context(copied_tree()))
        pool = stack.enter_context(ThreadPoolExecutor(arguments.jobs))
        rooms = sorted({drawn.room for drawn in missing})
        limits = dict(zip(rooms, pool.map(lambda room: _limit_s(trees, room), rooms), strict=True))
        for result in pool.map(lambda drawn: _try(trees, drawn, limits[drawn.room]), missing):
            known[result["key"]] = result
            file.write(json.dumps(result) + "\n")
            file.flush()
            print(f"{result['ran']:8} {result['seconds']:6.1f} s  {result['mutant']}", flush=True)
    return _report([known[drawn.key] for drawn in sample], sample)


def _report(results: Sequence[dict[str, Any]], sample: Sequence[Drawn]) -> int:
    listed = _survivors()
    equivalent, unlisted, survived = 0, 0, 0
    for result, drawn in zip(results, sample, strict=True):
        if result["ran"] != "green":
            continue
        survived += 1
        entry = listed.get(drawn.texts)
        equivalent += entry is not None and entry["equivalent"]
        unlisted += entry is None
        print(f"survived ({entry['reason'] if entry else 'NOT LISTED'}): {drawn}")
    share = (len(results) - survived) / max(len(results) - equivalent, 1)
    print(
        f"{len(results) - survived} of {len(results)} killed, {equivalent} survivors equivalent: {100.0 * share:.1f} % "
        f"of the others, goal {100.0 * KILLED_SHARE:.0f} %; {unlisted} survivors not listed in {SURVIVORS.name}"
    )
    return int(share < KILLED_SHARE or equivalent > EQUIVALENT_SHARE * len(results) or unlisted > 0)


def _survivors() -> dict[tuple[str, str, str, str], dict[str, Any]]:
    entries = tomllib.loads(SURVIVORS.read_text(encoding="utf-8")).get("survivor", [])
    return {(e["file"], e["where"], e["before"], e["after"]): e for e in entries}


def read_kept(path: Path) -> dict[str, dict[str, Any]]:
    """Results by key that were taken over, a line each: key, how its tests ended, the mutant."""
    lines = (line.split(" ", 2) for line in path.read_text(encoding="utf-8").splitlines())
    return {key: {"key": key, "ran": ran, "mutant": mutant} for key, ran, mutant in lines}


def keep(path: Path, results: Sequence[dict[str, Any]]) -> None:
    """Take results over."""
    lines = (f"{one['key']} {one['ran']} {' '.join(one['mutant'].split())}\n" for one in results)
    path.write_text("".join(lines), encoding="utf-8")


def _read(path: Path) -> dict[str, dict[str, Any]]:
    if not path.exists():
        return {}
    results = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines() if line.endswith("}")]
    return {result["key"]: result for result in results}


def _limit_s(trees: SimpleQueue[Path], room: str) -> float:
    """Time for a mutant of a room, from that of its tests without any. Raises RuntimeError unless they are green."""
    tree = trees.get()
    try:
        began_s = time.monotonic()
        ran, said = run_tests(tree, ROOMS[room], 1800.0)
        if ran != "green":
            raise RuntimeError(f"the tests of {room} are not green without any mutant: {said}")
        return max(LEAST_LIMIT_S, SLOWER * (time.monotonic() - began_s))
    finally:
        trees.put(tree)


def _try(trees: SimpleQueue[Path], drawn: Drawn, limit_s: float) -> dict[str, Any]:
    tree = trees.get()
    try:
        began_s = time.monotonic()
        with spoilt(tree / drawn.file, drawn.mutant.apply(drawn.text)):
            ran, said = run_tests(tree, nearest_first(tree, ROOMS[drawn.room], drawn.file), limit_s)
        seconds = time.monotonic() - began_s
    finally:
        trees.put(tree)
    return {"key": drawn.key, "mutant": str(drawn), "ran": ran, "said": said, "seconds": round(seconds, 1)}


if __name__ == "__main__":
    sys.exit(main())
