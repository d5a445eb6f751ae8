"""Scores programs on the same cases: one table, a column each."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.gapbench.program import Tried
from benchmarks.scoring.goals import SURE
from benchmarks.scoring.measure import share
from benchmarks.structures.structure import KNOWN_CASE, NULL_CASE, OUTSIDE_CASE
from benchmarks.structures.table import is_right, right_answers
from benchmarks.withheld.score_rows import called
from benchmarks.withheld.scorer import LEAST_P, UNKNOWN

Row = dict[str, Any]
Cell = Callable[[Sequence[Row]], str]


def row_of(truth: Mapping[str, Any], tried: Tried) -> Row:
    """Truth and answer of one case; without an answer the verdict is empty, which is never right."""
    answer = tried.answer
    given: Row = {"verdict": "", "p": 0.0, "ranking": {}, "shrink": None}
    if answer is not None:
        ranking = dict(answer.ranking)
        given = {"verdict": answer.verdict, "p": ranking[answer.verdict], "ranking": ranking, "shrink": answer.shrink}
    return {**truth, **given, "seconds": tried.seconds, "failure": tried.failure}


def log_score(row: Row) -> float:
    """-ln of the probability that the right answers have together; a smaller one than LEAST_P counts as that."""
    return -math.log(min(max(sum(row["ranking"].get(name, 0.0) for name in right_answers(row)), LEAST_P), 1.0))


def table(by_program: Mapping[str, Sequence[Row]]) -> list[tuple[str, list[str]]]:
    """Measures by name, with a cell for each program."""
    measures: list[tuple[str, Cell]] = [
        ("known effect named right", _share(is_right, KNOWN_CASE)),
        ("  one right name among the first three", _share(_among_first, KNOWN_CASE)),
        ("  another effect named", _share(lambda r: called(r) and not is_right(r), KNOWN_CASE)),
        ("outside called unknown", _share(lambda r: r["verdict"] == UNKNOWN, OUTSIDE_CASE)),
        ("null called an effect", _share(called, NULL_CASE)),
        ("right when p > 0.99", lambda rows: _share(is_right)([r for r in rows if r["p"] > SURE])),
        ("all answers right", _share(is_right)),
        ("log score (mean -ln p of the right answers)", lambda rows: _number(np.mean, [log_score(r) for r in rows])),
        ("no answer (counts as wrong)", _share(lambda r: bool(r["failure"]))),
        ("stated shrink, median (not scored)", _shrink),
        ("seconds a recording, median", lambda rows: _number(np.median, [r["seconds"] for r in rows])),
    ]  # fmt: skip
    return [(name, [cell(rows) for rows in by_program.values()]) for name, cell in measures]


def printed(by_program: Mapping[str, Sequence[Row]]) -> str:
    """The table for people; below it each answer that was none."""
    width = max(26, *(len(name) + 2 for name in by_program))
    lines = [f"{'':46}" + "".join(f"{name:>{width}}" for name in by_program)]
    lines += [f"{name:46}" + "".join(f"{cell:>{width}}" for cell in cells) for name, cells in table(by_program)]
    failed = [f"{name}, {r['key']}: {r['failure']}" for name, rows in by_program.items() for r in rows if r["failure"]]
    return "\n".join([*lines, *(["", "no answer:", *failed] if failed else [])])


def _share(hit: Callable[[Row], bool], kind: str = "") -> Cell:
    def cell(rows: Sequence[Row]) -> str:
        m = share("", [hit(r) for r in rows if not kind or r["kind"] == kind])
        return "-" if m.value is None else f"{100 * m.value:.0f} % ({100 * m.low:.0f} to {100 * m.high:.0f}, n {m.n})"

    return cell


def _among_first(row: Row) -> bool:
    first = sorted(row["ranking"], key=lambda name: -row["ranking"][name])[:3]
    return bool({*first} & {*row["names"]})


def _shrink(rows: Sequence[Row]) -> str:
    return _number(np.median, [r["shrink"] for r in rows if r["shrink"] is not None])


def _number(of: Callable[[list[float]], Any], values: list[float]) -> str:
    return f"{float(of(values)):.3g}" if values else "-"
