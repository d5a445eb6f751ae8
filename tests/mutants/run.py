"""A seeded sample of mutants over drivers, diagnosis and identification, each against its room's tests.

Of its room's tests, those that execute its line (covered.py).

`make mutants`, or `python -m tests.mutants.run [--number N] [--seed S [--record]] [--jobs N] [--only ROOM]
[--out FOLDER] [--fresh | --survivors] [--keep] [--whole-room]`. Results are kept in FOLDER as they come; a second call
goes on where the first was ended. `--keep` takes those of the recorded sample over into results.txt: what was killed is
not run again as long as its file does not change. With `--survivors` it also tries again what survived and is not
listed as equivalent: a test may have been added since. With `--whole-room` each meets all tests of its room. The status
is 1 if fewer than 85 % of those that are not listed as equivalent were killed, if more than 10 % are listed, or a
survivor is not.

The sample is recorded in sample.txt: a change of the code takes the changed mutants out of it, and leaves the others
and what survivors.toml says of them. `--seed S` draws another one, `--record` records it.
"""

from __future__ import annotations

import argparse
import itertools
import os
import random
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from tests.copied_tree import ROOT, CopiedTree, known_files, over_copies, spoilt, test_files
from tests.kept_results import KeptResults, key_of, until_stopped
from tests.mutants.covered import Coverage, chosen, key_of_test_file, lines_of, run_without_mutants, state_of
from tests.mutants.mutate import Mutant, compiles, mutants

ROOMS = {
    "drivers/can": ("tests/drivers/can", "tests/drivers/drives"),
    "drivers/drives": ("tests/drivers/drives", "tests/drivers/can"),
    "drivers/plc": ("tests/drivers/plc",),
    "drivers/station": ("tests/drivers/station",),
    "calibration/diagnosis": ("tests/calibration/diagnosis",),
    "calibration/identification": ("tests/calibration/identification", "tests/calibration/reduction"),
}
SAMPLE = Path(__file__).with_name("sample.txt")
SURVIVORS = Path(__file__).with_name("survivors.toml")
RESULTS = Path(__file__).with_name("results.txt")
KILLED_SHARE, EQUIVALENT_SHARE = 0.85, 0.10
LEAST_LIMIT_S, SLOWER = 30.0, 4.0  # a mutant may loop, or wait for ever; times what the tests take without it


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
        return key_of(self.file, self.text, self.mutant.start, self.mutant.end, self.mutant.after)

    @property
    def identity(self) -> str:
        """Of the file's name, the function and the change."""
        return key_of(self.file, self.mutant.where, self.mutant.before, self.mutant.after, self.copy)

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
    equivalent = _equivalent()
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
    parser.add_argument("--whole-room", action="store_true", help="each against all tests of its room")
    arguments = parser.parse_args()
    results = KeptResults(arguments.out / "mutants.jsonl", fresh=arguments.fresh)
    known = ({} if arguments.fresh else read_kept(RESULTS)) | results
    if arguments.keep:
        keep(RESULTS, [known[drawn.key] for drawn in recorded() if drawn.key in known])
        return 0
    every = recorded()[: arguments.number] if arguments.seed is None else draw(arguments.number, arguments.seed)
    if arguments.record:
        SAMPLE.write_text("".join(f"{d.identity} {d.file} {d.mutant.where}\n" for d in every), encoding="utf-8")
    sample = [drawn for drawn in every if drawn.room.startswith(arguments.only)]
    known = {drawn.key: _as_listed(drawn) for drawn in sample if drawn.texts in _equivalent()} | known
    missing = to_try(sample, known, survivors=arguments.survivors)
    print(f"{len(sample)} mutants, {len(sample) - len(missing)} of them not tried again", flush=True)
    coverage = _coverage(arguments.jobs, missing, KeptResults(arguments.out / "coverage.jsonl"))

    def try_one(copy: CopiedTree, drawn: Drawn) -> dict[str, Any]:
        return _try(copy, drawn, coverage[drawn.room], whole_room=arguments.whole_room)

    with closing(over_copies(arguments.jobs, missing, try_one)) as tried:
        for _, result in tried:
            results.add(result)
            print(f"{result['ran']:8} {result['seconds']:6.1f} s  {result['mutant']}", flush=True)
    known |= results
    return _report([known[drawn.key] for drawn in sample], sample)


def _coverage(jobs: int, missing: Sequence[Drawn], kept: KeptResults) -> dict[str, list[Coverage]]:
    """What the tests of each room execute, from runs without mutants as far as they are not kept."""
    rooms = sorted({drawn.room for drawn in missing})
    files = {room: test_files(ROOT, ROOMS[room]) for room in rooms}
    state = state_of(ROOT, known_files())
    keys = {name: key_of_test_file(ROOT, name, state) for room in rooms for name in files[room]}
    unknown = [name for name, key in keys.items() if key not in kept]
    with closing(over_copies(jobs, unknown, run_without_mutants)) as ran:
        for name, result in ran:
            kept.add({"key": keys[name], **result})
            print(f"without mutants {sum(result['seconds'].values()):6.1f} s  {name}", flush=True)
    return {room: [Coverage.of(kept[keys[name]]) for name in files[room]] for room in rooms}


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


def _equivalent() -> set[tuple[str, str, str, str]]:
    return {texts for texts, entry in _survivors().items() if entry["equivalent"]}


def _as_listed(drawn: Drawn) -> dict[str, Any]:
    """The result of a mutant that is listed as equivalent: nothing is lost by believing it, it counts as a survivor."""
    return {"key": drawn.key, "mutant": str(drawn), "ran": "green", "said": "listed as equivalent"}


def read_kept(path: Path) -> dict[str, dict[str, Any]]:
    """Results by key that were taken over, a line each: key, how its tests ended, the mutant."""
    lines = (line.split(" ", 2) for line in path.read_text(encoding="utf-8").splitlines())
    return {key: {"key": key, "ran": ran, "mutant": mutant} for key, ran, mutant in lines}


def keep(path: Path, results: Sequence[dict[str, Any]]) -> None:
    """Take results over."""
    lines = (f"{one['key']} {one['ran']} {' '.join(one['mutant'].split())}\n" for one in results)
    path.write_text("".join(lines), encoding="utf-8")


def _try(copy: CopiedTree, drawn: Drawn, coverage: Sequence[Coverage], *, whole_room: bool) -> dict[str, Any]:
    began_s = time.monotonic()
    lines = None if whole_room else lines_of(drawn.text, drawn.mutant.start)
    tests, seconds = chosen(copy.path, coverage, drawn.file, lines)
    ran, said = "green", "no test executes it"
    if tests:
        with spoilt(copy.path / drawn.file, drawn.mutant.apply(drawn.text)):
            ran, said = copy.run(tests, max(LEAST_LIMIT_S, SLOWER * seconds))
    seconds = round(time.monotonic() - began_s, 1)
    return {"key": drawn.key, "mutant": str(drawn), "ran": ran, "said": said, "seconds": seconds}


if __name__ == "__main__":
    sys.exit(until_stopped(main))
