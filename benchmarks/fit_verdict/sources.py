"""Cases whose cause is known, from three sources that share nothing, as recordings with their right answers.

structures: drawn ones without a formula; plant: the mock with development variants of its effects, never the final
ones, without the forms of the catalogue that explain what it does, as it is judged; recordings: the even numbers of
another simulator. None of them scores a final run.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from benchmarks.independent.recordings import copy_recordings, find_archive, names_of
from benchmarks.independent.scorer import case_of
from benchmarks.independent.truths import read_truths
from benchmarks.structures.structure import Generator
from benchmarks.structures.table import right_answers
from benchmarks.withheld.cases import Slot, drawn_order, plan
from benchmarks.withheld.designs import Designs
from benchmarks.withheld.left_out_forms import FormComparison
from benchmarks.withheld.maker import clean_folder
from benchmarks.withheld.making import make_case
from calibration.recording.folder import read_folder
from calibration.recording.recording import Recording
from mock_devices.recordings.files import write_recording
from mock_devices.recordings.maker import MockRecording

NONE, UNKNOWN = "none", "unknown"
STRUCTURES, PLANT, RECORDINGS = "structures", "plant", "recordings"
OF_PLANT = {"effect": 0.6, "null": 0.15, "outside": 0.15, "pair": 0.1}  # shares of the kinds


@dataclass(frozen=True)
class Known:
    """A recording, the verdicts that are right, and raw sizes in sigma by effect: of single ones that can be seen.

    without_forms: what its catalogue shall not have, each EFFECT/FORM.
    """

    recording: Recording
    right: tuple[str, ...]
    raw: Mapping[str, float]
    without_forms: tuple[str, ...] = ()


Load = Callable[[], Known]
Case = tuple[str, Load]  # by its key


def structures(count: int, seed: int) -> Iterator[Case]:
    """Drawn structures of a seed."""
    generator = Generator(seed)

    def load(number: int) -> Known:
        case = generator.case(number)
        names, raw = case.truth["names"], case.truth["raw"]
        return Known(_in_memory(case.recording), right_answers(case.truth), dict.fromkeys(names[:1], raw))

    for number in range(count):
        yield f"s{seed}-{number}", lambda number=number: load(number)


def plant(count: int, seed: int) -> Iterator[Case]:
    """Cases of the mock without its final variants, of each kind its share; a larger count adds some."""
    designs, forms = Designs(seed), FormComparison()

    def load(slot: Slot) -> Known:
        rng = np.random.default_rng([seed, crc32(slot.key.encode())])
        case = make_case(slot, rng, designs, final=False)
        names = [fact["effect"] for fact in case.truth["effects"]]
        right = right_of(slot.kind, names, case.truth["eligible"])
        with _written(case.recording) as folder, clean_folder(case, folder) as clean:
            left_out = forms.left_out(clean, case.changes_by_effect(), rng)
            return Known(read_folder(folder), right, _raw_of_single(slot.kind, case.truth), left_out.names)

    for kind, share in OF_PLANT.items():
        slots = drawn_order(plan(0, (kind,), final=False), np.random.default_rng(seed))
        for slot in slots[: max(1, round(share * count))]:
            yield f"p{seed}-{slot.key}", lambda slot=slot: load(slot)


def recordings(count: int, folder: Path) -> Iterator[Case]:
    """Even-numbered recordings of another simulator, spread over all of them."""
    archive = find_archive(folder)
    names = names_of(archive, even=True)
    chosen = names if count >= len(names) else [names[k * len(names) // count] for k in range(count)]

    def load(name: str) -> Known:
        truth = case_of(name, read_truths(archive, [name])[name].entry)
        with tempfile.TemporaryDirectory() as copies:
            copy_recordings(archive, [name], Path(copies))
            recording = read_folder(Path(copies) / name)
        right = right_of(truth["kind"], [fact["effect"] for fact in truth["effects"]], truth["eligible"])
        return Known(recording, right, _raw_of_single(truth["kind"], truth))

    for name in chosen:
        yield name, lambda name=name: load(name)


def _raw_of_single(kind: str, truth: Mapping[str, Any]) -> dict[str, float]:
    facts = truth["effects"]
    single = kind == "effect" and truth["eligible"] and len(facts) == 1
    return {facts[0]["effect"]: float(facts[0]["raw"])} if single else {}


def right_of(kind: str, effects: list[str], eligible: bool) -> tuple[str, ...]:
    """Right verdicts: of several effects each; what is hardly seen may also be called nothing."""
    right = {"null": (NONE,), "outside": (UNKNOWN,)}.get(kind, tuple(effects))
    return right if eligible or kind == "null" else (*right, NONE)


def _in_memory(made: MockRecording) -> Recording:
    with _written(made) as folder:
        return read_folder(folder)


@contextmanager
def _written(made: MockRecording) -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as folder:
        write_recording(made, Path(folder) / "recording")
        yield Path(folder) / "recording"
