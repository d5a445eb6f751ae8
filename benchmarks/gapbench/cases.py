"""The cases of a set: recordings as texts, under keys that say nothing, and what is true of them.

From the generator of structures, and from the mock's named effects as the check on withheld cases makes them (never its
final variants).
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.structures.structure import KNOWN_CASE, MOST_DRAWS, NULL_CASE, OUTSIDE_CASE, Generator, NoCase
from benchmarks.withheld.cases import RIGHT, Slot, plan
from benchmarks.withheld.designs import FEW, Designs
from benchmarks.withheld.making import make_case
from benchmarks.withheld.sealed_diagnoser import FILES
from mock_devices.recordings.files import write_recording
from mock_devices.recordings.maker import MockRecording

AHEAD = 101  # slots
NAMED = (KNOWN_CASE, OUTSIDE_CASE, KNOWN_CASE, NULL_CASE)  # turns of the cases with named effects
KINDS = {"effect": KNOWN_CASE, "outside": OUTSIDE_CASE, "null": NULL_CASE}


@dataclass(frozen=True)
class BenchCase:
    """A recording (texts by file name) and what is true of it: `key`, `kind`, `names` of right effects and more."""

    key: str
    files: dict[str, str]
    truth: dict[str, Any]


class CaseSet:
    """Cases of a seed by their number: those of drawn structure first, then those with named effects."""

    def __init__(self, seed: int, structures: int, named: int) -> None:
        self._seed, self._structures = seed, structures
        self.count = structures + named
        self._generator = Generator(seed)
        self._designs = Designs(seed, FEW)
        self._slots = _slots(seed)

    def key(self, number: int) -> str:
        """The key of a case."""
        if number < self._structures:
            return f"s{self._seed}-{number}"
        return f"w{self._seed}-{number - self._structures}"

    def case(self, number: int) -> BenchCase:
        """Make one."""
        key = self.key(number)
        if number < self._structures:
            made = self._generator.case(number)
            return BenchCase(key, texts_of(made.recording), made.truth)
        return self._named(key, number - self._structures)

    def _named(self, key: str, number: int) -> BenchCase:
        turn = NAMED[number % len(NAMED)]
        slots = self._slots[turn]
        before = sum(NAMED[n % len(NAMED)] == turn for n in range(number))
        for draw in range(MOST_DRAWS):  # on some designs an effect cannot be seen: the slots far ahead are tried then
            rng = np.random.default_rng([self._seed, number, draw])
            case = make_case(slots[(before + AHEAD * draw) % len(slots)], rng, self._designs, final=False)
            if turn == NULL_CASE or case.truth["eligible"]:
                break
        else:
            raise NoCase(f"gapbench: no slot gave case {key} with an effect that can be seen; take another seed")
        names = [f["effect"] for f in case.truth["effects"]] if turn == KNOWN_CASE else []
        truth = {"key": key, "kind": turn, "names": names, "raw": case.truth["raw"], "profile": case.truth["profile"]}
        return BenchCase(key, texts_of(case.recording), truth)


def texts_of(recording: MockRecording) -> dict[str, str]:
    """The files of a recording as texts."""
    with tempfile.TemporaryDirectory() as folder:
        write_recording(recording, Path(folder) / "recording")
        return {name: (Path(folder) / "recording" / name).read_text(encoding="utf-8") for name in FILES}


def _slots(seed: int) -> dict[str, list[Slot]]:
    """Slots of the check on withheld cases by turn, in an order drawn once: large enough, and declared as they are."""
    rng = np.random.default_rng(seed)
    out: dict[str, list[Slot]] = {turn: [] for turn in KINDS.values()}
    every = plan(0, tuple(KINDS), final=False)
    for k in rng.permutation(len(every)):
        slot = every[int(k)]
        if slot.declared == RIGHT and not slot.decoy and (not slot.raw or min(slot.raw) >= 3.0):
            out[KINDS[slot.kind]].append(slot)
    return out
