"""The table of a fit: folds, constants, and whether the release's are what the evidence says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.fit_verdict.fit import BY_EVIDENCE, BY_SEARCH, BY_SIZE, Fitted, Kept, fit
from benchmarks.fit_verdict.sizes import KeptSizes
from benchmarks.fit_verdict.sources import PLANT, RECORDINGS, STRUCTURES
from calibration.diagnosis.settings import VERDICT, VerdictSettings

# What is judged, the sources that its constants may be fitted to, and the source that they are scored on.
FOLDS = (
    ("recordings of another simulator", (STRUCTURES, PLANT), RECORDINGS),
    ("withheld cases of the mock", (STRUCTURES, RECORDINGS), PLANT),
    ("the release, and what emerges", (STRUCTURES, PLANT, RECORDINGS), None),
)
SURE = 0.99


def fold_lines(title: str, fitted: Fitted, scored: Mapping[str, Kept]) -> list[str]:
    """Scores of the release's constants and of the fitted ones on cases that the fit has not seen, or on all."""
    lines = [title]
    for name, kept in scored.items():
        for what, settings in (("release", VERDICT), ("fitted", fitted.settings)):
            lines.append(f"  {name:12}{what:9}{_scores(kept, settings)}")
    return lines


def constant_lines(by_fold: Sequence[tuple[str, Fitted]], names: Sequence[str] = BY_EVIDENCE) -> list[str]:
    """Constants with these names of each fold, their range, and whether the release's are within."""
    lines = [f"{'constant':22}{'release':>9}  " + "".join(f"{f'fold {k}':>26}" for k in range(1, len(by_fold) + 1))]
    for name in names:
        cells = [
            f"{getattr(f.settings, name):9.3g} ({f.ranges[name][0]:.3g} to {f.ranges[name][1]:.3g})" for _, f in by_fold
        ]
        lines.append(f"{name:22}{getattr(VERDICT, name):9.3g}  " + "".join(f"{cell:>26}" for cell in cells))
    release = by_fold[-1][1]
    outside = [name for name in names if not release.holds(name)]
    said = "within their ranges" if not outside else f"outside its range: {', '.join(outside)}"
    return [*lines, f"the release's constants by the last fold: {said}"]


def size_lines(sizes: Mapping[str, KeptSizes]) -> list[str]:
    """The constants of sizes of each fold, and how many true sizes are within U by the release's and by the fitted."""
    by_fold = [(title, [sizes[name] for name in sources if len(sizes[name])]) for title, sources, _ in FOLDS]
    if not all(kept for _, kept in by_fold):
        return [f"not fitted ({', '.join(BY_SIZE)}): no case of a fold was named right at one place"]
    fitted = [(title, fit(kept, BY_SIZE)) for title, kept in by_fold]
    lines = constant_lines(fitted, BY_SIZE)
    for (_, found), (_, _, scored_on) in zip(fitted, FOLDS, strict=True):
        if scored_on is not None and len(kept := sizes[scored_on]):
            shares = (np.mean(kept.covered(settings)) for settings in (VERDICT, found.settings))
            cells = "   ".join(f"{what} {share:.1%}" for what, share in zip(("release", "fitted"), shares, strict=True))
            lines.append(f"  raw size within U (k = 2), {scored_on}, not seen: {cells} of {len(kept)}")
    return lines


def departure_lines(by_point: Mapping[tuple[float, float], Mapping[str, Kept]]) -> list[str]:
    """Log scores of other sizes of departures, of the same cases, against the release's; +- is a standard error."""
    base = by_point[1.0, 1.0]
    lines = ["departures: factors on smooth and by-visit sizes, log score a case over the release's"]
    for point, by_source in by_point.items():
        if point == (1.0, 1.0):
            continue
        cells = []
        for name, kept in by_source.items():
            more = kept.log_scores(VERDICT) - base[name].log_scores(VERDICT)
            error = float(np.std(more)) / np.sqrt(len(more))
            cells.append(f"{name} {np.mean(more):+.3f} +- {error:.3f}")
        lines.append(f"  {point[0]:g}, {point[1]:g}: {'; '.join(cells)}")
    return lines if len(lines) > 1 else [f"not fitted ({', '.join(BY_SEARCH)}): they need GRID=1"]


def _scores(kept: Kept, settings: VerdictSettings) -> str:
    p = np.max(kept.probabilities(settings), axis=1)
    right = kept.right_verdicts(settings)
    sure = p > SURE
    said = f"{np.mean(right[sure]):6.1%} of {int(np.sum(sure))}" if np.any(sure) else "none"
    return (
        f"log score {np.mean(kept.log_scores(settings)):7.3f}   right {np.mean(right):6.1%} of {len(kept)}   "
        f"right where p > {SURE} {said}"
    )
