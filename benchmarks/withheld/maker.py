"""Makes withheld cases in a process of its own; the truth leaves it only for the hash of the answers.

    python -m benchmarks.withheld.maker

One JSON object a line on standard input, one answer a line on standard output:
`start` (seed or null, final, n, kinds, lane, lanes, done, leave_form_out, resembling), `make` (folder), `more` (folder,
proposals, sure), `seal` (file, answers_sha256), `stop`. Without a seed every process draws its own from the operating
system; it is never written:
of each batch only its own seed, which does not lead to any other's, is told with the truth.
"""

from __future__ import annotations

import hashlib
import io
import json
import secrets
import sys
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.withheld.cases import BATCH, Slot, drawn_order, plan
from benchmarks.withheld.designs import COUNTS, FEW, OPTIONS, Designs, lasting
from benchmarks.withheld.gross_readings import with_gross_readings
from benchmarks.withheld.left_out_forms import FormComparison, LeftOut
from benchmarks.withheld.making import MOST_GROSS, Case, make_case
from benchmarks.withheld.mimics import DRAWS, MimicLibraries
from benchmarks.withheld.scorer import GROSS, WHOLE
from benchmarks.withheld.second_round import longer_recordings
from benchmarks.withheld.sizes import platform_rows
from mock_devices.effects import CATALOGUE
from mock_devices.recordings.files import write_recording

SHORT = 300  # cases
TWICE = ("effect", "pair")  # kinds that are diagnosed with the whole catalogue too


@dataclass
class Maker:
    """What one process knows. `run_seed` None: from the operating system.

    resembling: effects among which is looked for what could be taken for a true one; in a final run all of them, since
    its table counts by that. ValueError for fewer. hours: that a campaign lasts; 0: as short as the designs are.
    """

    run_seed: int | None
    final: bool
    slots: list[Slot]
    lane: int = 0
    finished: int = 0
    batch_size: int = BATCH
    few_designs: bool = False
    leave_form_out: bool = True
    resembling: Collection[str] = CATALOGUE
    hours: float = 0.0
    _secret: int = field(init=False)
    _designs: Designs = field(init=False)
    _libraries: MimicLibraries = field(init=False)
    _comparison: FormComparison = field(default_factory=FormComparison)
    _cases: dict[str, Case] = field(default_factory=dict)
    _left_out: dict[str, LeftOut] = field(default_factory=dict)
    _longer: dict[str, dict[str, Any]] = field(default_factory=dict)
    _batch_seed: int = 0

    def __post_init__(self) -> None:
        """Draw what this process keeps to itself."""
        if self.final and set(self.resembling) != set(CATALOGUE):
            raise ValueError("a final run looks among all effects for those that resemble the true one")
        self._secret = secrets.randbits(128) if self.run_seed is None else self.run_seed
        options = lasting(self.hours) if self.hours else OPTIONS
        self._designs = Designs(derived(self._secret, "designs"), FEW if self.few_designs else COUNTS, options)
        self._libraries = MimicLibraries(1 if self.few_designs else DRAWS, self.resembling)

    @property
    def commitment(self) -> str:
        """Hash of the secret: it was drawn before anything was made."""
        return hashlib.sha256(f"run {self._secret}".encode()).hexdigest()

    def make(self, folder: Path) -> int:
        """Write the next batch of recordings under random names; 0 if none is left."""
        self._batch_seed = derived(self._secret, f"batch {self.lane} {self.finished}")
        self._cases, self._longer = {}, {}
        rng = np.random.default_rng(self._batch_seed)
        batch = drawn_order(self.slots, rng)[: self.batch_size]
        if not batch:
            return 0
        final = None if self.final else False
        cases = [make_case(slot, rng, self._designs, final=final) for slot in batch]
        self._write(folder, {secrets.token_hex(8): case for case in cases})
        return len(cases)

    def add_cases(self, folder: Path, proposals: dict[str, Any], sure: Collection[str] = ()) -> int:
        """What is asked after the first answers: recordings of the `next` cases measured further, as was proposed and
        at random; once more those of which the true effect's own forms were left out, with the whole catalogue; and a
        part of those whose verdict was sure, with gross readings."""
        rng = np.random.default_rng([self._batch_seed & 0xFFFFFFFF, 1])
        cases: dict[str, Any] = {}
        options: dict[str, dict[str, list[str]]] = {}

        def again(name: str, arm: str, recording: Any, without_forms: tuple[str, ...]) -> None:
            retry = secrets.token_hex(8)
            cases[retry], options[retry] = recording, option((), without_forms)
            self._longer[retry] = {"of": name, "arm": arm}

        for name, case in self._cases.items():
            left_out = self._left_out.get(name)
            if case.slot.kind == "next":
                for arm, recording in longer_recordings(case, proposals.get(name, []), rng).items():
                    again(name, arm, recording, left_out.names if left_out else ())
            elif case.slot.kind in TWICE and left_out and left_out.explained:
                again(name, WHOLE, case.recording, ())
            if name in sure and case.slot.spoiled:
                columns = with_gross_readings(case.clean.columns, MOST_GROSS, rng)
                again(name, GROSS, replace(case.clean, columns=columns), left_out.names if left_out else ())
        for name in shuffled(list(cases)):
            write_recording(cases[name], folder / name)
        write_options(folder, options)
        return len(cases)

    def seal(self, file: Path, answers_sha256: str) -> str:
        """Write the truth of the batch, now that the answers are fixed; its own hash."""
        if len(answers_sha256) != 64 or set(answers_sha256) - set("0123456789abcdef"):
            raise ValueError("the truth is given for the SHA-256 of the answers only")
        truth = {name: self._libraries.to_json(case) for name, case in self._cases.items()}
        for name, left_out in self._left_out.items():
            truth[name] = {**truth[name], "left_out": dict(left_out.explained), "decoys": list(left_out.decoys)}
        text = json.dumps(
            {
                "answers_sha256": answers_sha256, "commitment": self.commitment, "batch_seed": str(self._batch_seed),
                "cases": truth, "longer": self._longer,
            },
            indent=1,
        )  # fmt: skip
        arrays: dict[str, NDArray[Any]] = {name: case.noise_free_m for name, case in self._cases.items()}
        arrays |= {f"{name}_rows": platform_rows(case.bench) for name, case in self._cases.items()}
        arrays |= {f"{name}_change": c.change_m for name, c in self._cases.items() if c.slot.kind == "effect"}
        file.write_text(text + "\n", encoding="utf-8")
        with io.BytesIO() as stream:
            np.savez(stream, **arrays)  # type: ignore[arg-type]
            file.with_suffix(".npz").write_bytes(stream.getvalue())
        cases = {case.slot.key for case in self._cases.values()}
        self.slots = [slot for slot in self.slots if slot.key not in cases]
        self._cases = {}
        self.finished += 1
        return hashlib.sha256(file.read_bytes()).hexdigest()

    def _write(self, folder: Path, cases: dict[str, Case]) -> None:
        self._cases, self._left_out = cases, {}
        for name in shuffled(list(cases)):
            write_recording(cases[name].recording, folder / name)
        if self.leave_form_out:
            rng = np.random.default_rng([self._batch_seed & 0xFFFFFFFF, 2])
            for name, case in cases.items():
                changes = case.changes_by_effect() if case.slot.kind != "removed" else []
                with clean_folder(case, folder / name) as clean:
                    self._left_out[name] = self._comparison.left_out(clean, changes, rng)
        forms = {name: left_out.names for name, left_out in self._left_out.items()}
        write_options(folder, {name: option(case.without, forms.get(name, ())) for name, case in cases.items()})


@contextmanager
def clean_folder(case: Case, written: Path) -> Iterator[Path]:
    """Where a case's recording lies without gross readings; without any, where it was written already."""
    if case.clean is case.recording:
        yield written
        return
    with TemporaryDirectory() as folder:
        write_recording(case.clean, Path(folder) / written.name)
        yield Path(folder) / written.name


def derived(seed: int, purpose: str) -> int:
    """A seed for one purpose that tells nothing of the seed it comes from."""
    return int.from_bytes(hashlib.sha256(f"{purpose} of {seed}".encode()).digest()[:16], "big")


def shuffled(names: list[str]) -> list[str]:
    """Names in an order that says nothing."""
    secrets.SystemRandom().shuffle(names)
    return names


def option(without: tuple[str, ...], without_forms: tuple[str, ...]) -> dict[str, list[str]]:
    """What a diagnosis is told besides its recording: effects and forms that its catalogue shall not have."""
    return {"without": list(without), "without_forms": list(without_forms)}


def write_options(folder: Path, options: dict[str, dict[str, list[str]]]) -> None:
    """The options of all recordings of a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    table = {name: options[name] for name in sorted(options)}
    (folder / "options.json").write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")


def of_lane(slots: list[Slot], lane: int, lanes: int, done: set[str]) -> list[Slot]:
    """What one of several processes makes, without what is done."""
    return [slot for k, slot in enumerate(slots) if k % lanes == lane and slot.key not in done]


def main() -> int:
    """Serve until told to stop."""
    maker: Maker | None = None
    for line in sys.stdin:
        order = json.loads(line)
        what = order["do"]
        answer: dict[str, Any]
        if what == "start":
            every = plan(order["n"], order["kinds"], final=order["final"])
            slots = of_lane(every, order["lane"], order["lanes"], set(order["done"]))
            few = 0 < order["n"] <= SHORT
            maker = Maker(
                order["seed"], order["final"], slots, order["lane"], order["finished"], order["batch"], few,
                order["leave_form_out"], order["resembling"] or CATALOGUE, order["hours"],
            )  # fmt: skip
            answer = {"commitment": maker.commitment, "left": len(slots)}
        elif what == "stop" or maker is None:
            break
        elif what == "make":
            answer = {"made": maker.make(Path(order["folder"]))}
        elif what == "more":
            answer = {"made": maker.add_cases(Path(order["folder"]), order["proposals"], order["sure"])}
        else:
            answer = {"truth_sha256": maker.seal(Path(order["file"]), order["answers_sha256"])}
        print(json.dumps(answer), flush=True)
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:  # the run, which is interrupted with it, says so
        sys.exit(130)
