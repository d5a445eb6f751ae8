"""Fits the constants of the verdict crosswise (docs/explanation/verdict-constants.md).

    python -m benchmarks.fit_verdict.run [--n 100] [--seed 101] [--grid] [--write] [--data FOLDER] [--out DIR]

Diagnoses N cases of each source and keeps evidence and sizes; from these everything else follows at once. --grid
diagnoses them again at half and twice each size of departures. Kept in runs/fit-verdict by case and code; stopped at
any time, the same command goes on, and a larger N adds cases. The release's constants stand in
`calibration/diagnosis/settings.py` and are not changed; --write keeps those of the folds, by which the checks state
their calibration too (`folds.json`).
Exit status 0; 2 without the recordings of the other simulator; 130 if interrupted.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.fit_verdict.fit import Fitted, Kept, fit
from benchmarks.fit_verdict.folds import FILE, written
from benchmarks.fit_verdict.sizes import KeptSizes, kept_size
from benchmarks.fit_verdict.sources import PLANT, RECORDINGS, STRUCTURES, Case, plant, recordings, structures
from benchmarks.fit_verdict.table import FOLDS, constant_lines, departure_lines, fold_lines, size_lines
from benchmarks.independent.recordings import NoRecordings
from benchmarks.results_file import ROOT, code_digest
from calibration.base.errors import InputError
from calibration.diagnosis import departure_evidence
from calibration.diagnosis.diagnose import diagnose
from calibration.diagnosis.settings import VERDICT, VerdictSettings
from calibration.effects.catalogue import load_catalogue
from tests.kept_results import KeptResults, key_of, until_stopped

OUT = ROOT / "runs" / "fit-verdict"
DATA = ROOT.parent / "shared" / "independent"
MAKING = ("benchmarks/structures", "benchmarks/withheld", "benchmarks/fit_verdict/sources.py")
CODE = ("calibration", "mock_devices", *MAKING)
POINTS = ((1.0, 1.0), (0.5, 1.0), (2.0, 1.0), (1.0, 0.5), (1.0, 2.0))  # factors on sizes of departures

Rows = dict[str, list[dict[str, Any]]]


def main(arguments: list[str] | None = None) -> int:
    """Diagnose what is missing, then fit and print."""
    options = _options(arguments)
    try:
        by_point = {point: kept_rows(options, point) for point in (POINTS if options.grid else POINTS[:1])}
    except NoRecordings as error:
        print(f"fit-verdict: {error}", file=sys.stderr)
        return 2
    lines, by_source = report(by_point)
    print("\n".join(lines))
    if options.write:
        FILE.write_text(written(by_source), encoding="utf-8")
        print(f"written: {FILE.relative_to(ROOT)}")
    return 0


def report(by_point: dict[tuple[float, float], Rows]) -> tuple[list[str], dict[str, VerdictSettings]]:
    """The lines that are printed, and the constants of the folds that judge a source, by its name."""
    kept = {point: {name: Kept.of(rows) for name, rows in given.items()} for point, given in by_point.items()}
    release = kept[POINTS[0]]
    lines: list[str] = []
    fitted: list[tuple[str, Fitted]] = []
    for number, (title, fitted_to, scored_on) in enumerate(FOLDS, start=1):
        found = fit([release[name] for name in fitted_to])
        fitted.append((title, found))
        scored = {name: kept for name, kept in release.items() if scored_on in (None, name)}
        seen = "all seen" if scored_on is None else f"not seen: {scored_on}"
        lines += fold_lines(f"fold {number}, for {title}: fitted to {', '.join(fitted_to)}; {seen}", found, scored)
    sizes = {name: KeptSizes.of(rows) for name, rows in by_point[POINTS[0]].items()}
    lines += ["", *constant_lines(fitted), "", *size_lines(sizes), "", *departure_lines(kept)]
    judging = {
        scored_on: found.settings for (_, found), (_, _, scored_on) in zip(fitted, FOLDS, strict=True) if scored_on
    }
    return lines, judging


def kept_rows(options: argparse.Namespace, point: tuple[float, float]) -> Rows:
    """Evidence and right answers of all cases at one size of departures; each is on disk before the next."""
    cases: dict[str, Sequence[Case]] = {
        STRUCTURES: list(structures(options.n, options.seed)),
        PLANT: list(plant(options.n, options.seed)),
        RECORDINGS: list(recordings(options.n, options.data)),
    }
    code, catalogue = code_digest(*CODE), load_catalogue()
    out: Rows = {}
    for source, some in cases.items():
        results = KeptResults(options.out / f"{source}.jsonl")
        keys = [key_of(code, key, *map(str, point)) for key, _ in some]
        missing = [(key, case) for key, case in zip(keys, some, strict=True) if key not in results]
        began = time.monotonic()
        for done, (key, (name, load)) in enumerate(missing, start=1):
            known = load()
            with _departures(point):
                try:
                    diagnosis = diagnose(known.recording, catalogue.without_forms(known.without_forms))
                except InputError:
                    diagnosis = None
            evidence = diagnosis and diagnosis.evidence
            size = diagnosis and kept_size(diagnosis, known.raw)
            row = {"key": key, "case": name, "right": list(known.right)}
            results.add(row | {"evidence": evidence and asdict(evidence), "size": size})
            left_min = (time.monotonic() - began) / done * (len(missing) - done) / 60.0
            print(f"{source} {done} of {len(missing)}; {left_min:.1f} min left", file=sys.stderr, flush=True)
        out[source] = [results[key] for key in keys if results[key]["evidence"] is not None]
    return out


@contextmanager
def _departures(point: tuple[float, float]) -> Iterator[None]:
    """The sizes of departures times factors."""
    before = departure_evidence.SMOOTH_SHARES, departure_evidence.SHARES_BY_VISIT
    smooth, by_visit = point
    departure_evidence.SMOOTH_SHARES = tuple(size * smooth for size in VERDICT.smooth_departures)
    departure_evidence.SHARES_BY_VISIT = tuple(size * by_visit for size in VERDICT.departures_by_visit)
    try:
        yield
    finally:
        departure_evidence.SMOOTH_SHARES, departure_evidence.SHARES_BY_VISIT = before


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=100, help="cases of each source")
    parser.add_argument("--seed", type=int, default=101, help="of the drawn cases")
    parser.add_argument("--grid", action="store_true", help="other sizes of departures too: five times as long")
    parser.add_argument("--write", action="store_true", help="keep the constants of the folds (folds.json)")
    parser.add_argument("--data", type=Path, default=DATA, help="folder of the other simulator's archive")
    parser.add_argument("--out", type=Path, default=OUT, help="folder of what is kept")
    options = parser.parse_args(arguments)
    if options.n < 1 or options.seed < 0:
        parser.error("--n must be positive, --seed not negative")
    return options


if __name__ == "__main__":
    sys.exit(until_stopped(main))
