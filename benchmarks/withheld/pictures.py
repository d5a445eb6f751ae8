"""Pictures of a run: confusion matrix, reliability diagram, predicted against achieved shrink."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from benchmarks.withheld.score_rows import answerable, overall_right, true_answer
from benchmarks.withheld.scorer import NONE, UNKNOWN
from benchmarks.withheld.statistics import reliability, wilson

mpl.use("Agg")

BLUE, ORANGE, GREY = "#0072B2", "#D55E00", "0.6"
FAILED = "failed"


def draw_all(rows: Sequence[dict[str, Any]], folder: Path) -> list[Path]:
    """Write all pictures; their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, figure in (
        ("confusion.png", confusion(rows)),
        ("reliability.png", reliability_diagram(rows)),
        ("shrink.png", shrink(rows)),
    ):
        path = folder / name
        figure.savefig(path, dpi=110, metadata={"Software": None})
        paths.append(path)
    return paths


def confusion(rows: Sequence[dict[str, Any]]) -> Figure:
    """True class against verdict, shares of each true class."""
    answered = [r for r in rows if answerable(r)]
    effects = sorted({true_answer(r) for r in answered} | {r["verdict"] for r in answered if r["verdict"]})
    names = [name for name in effects if name not in (NONE, UNKNOWN)] + [NONE, UNKNOWN]
    columns = [*names, FAILED]
    table = np.zeros((len(names), len(columns)))
    for r in answered:
        table[names.index(true_answer(r)), columns.index(r["verdict"] or FAILED)] += 1.0
    counts = table.sum(axis=1)
    share = table / np.maximum(counts, 1.0)[:, None]
    figure = Figure(figsize=(11.0, 9.5))
    axes = figure.subplots()
    axes.imshow(share, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    for i, j in zip(*np.nonzero(table), strict=True):
        colour = "white" if share[i, j] > 0.6 else "black"
        axes.text(j, i, f"{table[i, j]:.0f}", ha="center", va="center", fontsize=7, color=colour)
    axes.set_xticks(range(len(columns)), labels=columns, rotation=60, ha="right", fontsize=8)
    axes.set_yticks(range(len(names)), labels=[f"{n} ({c:.0f})" for n, c in zip(names, counts, strict=True)])
    axes.tick_params(axis="y", labelsize=8)
    axes.set_xlabel("verdict")
    axes.set_ylabel("truth (cases)")
    axes.set_title("Effects that can be seen, null cases, outside effects (truth: unknown)", loc="left", fontsize=10)
    figure.tight_layout()
    return figure


def reliability_diagram(rows: Sequence[dict[str, Any]]) -> Figure:
    """Share of right verdicts by stated probability."""
    answered = [r for r in rows if r["verdict"] and answerable(r)]
    figure = Figure(figsize=(5.6, 5.2))
    axes = figure.subplots()
    axes.plot([0.0, 1.0], [0.0, 1.0], color=GREY, linewidth=1.0, linestyle=":")
    if answered:
        stated = np.array([r["p"] for r in answered])
        hits = np.array([overall_right(r) for r in answered], dtype=np.float64)
        for mean, share, count in reliability(stated, hits):
            low, high = wilson(round(share * count), count)
            axes.plot([mean, mean], [low, high], color=BLUE, linewidth=1.4)
            axes.plot(mean, share, "o", color=BLUE, markersize=5)
            axes.annotate(str(count), (mean, share), xytext=(5, -9), textcoords="offset points", fontsize=7)
    axes.set_xlim(0.0, 1.02)
    axes.set_ylim(0.0, 1.02)
    axes.set_xlabel("stated probability of the verdict")
    axes.set_ylabel("share of right verdicts, 95 % interval")
    axes.set_title("Reliability; counts beside the points", loc="left", fontsize=10)
    figure.tight_layout()
    return figure


def shrink(rows: Sequence[dict[str, Any]]) -> Figure:
    """Predicted against achieved shrink of effects with visible size of a sigma and more."""
    visible = [r for r in rows if r["kind"] == "effect" and r["visible"] >= 1.0 and "achieved" in r]
    figure = Figure(figsize=(5.6, 5.2))
    axes = figure.subplots()
    line = np.array([-0.25, 1.0])
    axes.fill_between(line, line - 0.1, line + 0.1, color="0.93")
    axes.fill_between(line, line - 0.05, line + 0.05, color="0.86")
    for row in visible:
        colour = BLUE if [row["verdict"]] == row["true"] else ORANGE
        x, (low, high) = float(np.clip(row["achieved"], -0.25, 1.0)), row["shrink_interval"]
        axes.plot([x, x], np.clip([low, high], -0.25, 1.0), color=colour, linewidth=0.5, alpha=0.35)
        axes.plot(x, float(np.clip(row["shrink"], -0.25, 1.0)), ".", color=colour, markersize=4)
    axes.plot([], [], ".", color=BLUE, label="right effect named")
    axes.plot([], [], ".", color=ORANGE, label="another answer")
    axes.legend(frameon=False, fontsize=8, loc="upper left")
    axes.set_xlim(-0.27, 1.02)
    axes.set_ylim(-0.27, 1.02)
    axes.set_xlabel("achieved shrink, noise-free")
    axes.set_ylabel("predicted shrink with its 95 % interval")
    axes.set_title("Bands: within 0.05 and 0.10", loc="left", fontsize=10)
    figure.tight_layout()
    return figure
