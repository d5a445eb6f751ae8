"""The picture of the rig study: held-out position error of every estimator and rigid baseline, machine by machine."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from benchmarks.rig_settings import CASES
from benchmarks.rig_table import figures, pooled

mpl.use("Agg")

# Of Okabe and Ito, told apart by any kind of colour vision; the markers differ as well.
SHOWN = (
    (0, 0.0, "calibrated and used without payload", "#0072B2", "o"),
    (1, 200.0, "calibrated at 0 and 400 kg, used at 200 kg", "#009E73", "s"),
    (1, 400.0, "calibrated at 0 and 400 kg, used at 400 kg", "#E69F00", "D"),
    (0, 400.0, "calibrated without payload, used at 400 kg", "#D55E00", "^"),
)
NAMES = {
    "map": "maximum a posteriori (default)",
    "map_robust": "the same, robust loss",
    "truncated_svd": "truncated SVD",
    "tikhonov": "Tikhonov, GCV",
    "l_curve": "Tikhonov, L-curve",
    "least_squares": "least squares",
    "map_nominal_stiffness": "a posteriori, nominal stiffness",
    "equal_weight_closure": "equal-weight closure",
    "equal_weight_closure_per_payload": "equal-weight closure, per payload",
    "mean_of_minimal_subsets": "mean of minimal subsets",
    "mean_of_minimal_subsets_per_payload": "mean of minimal subsets, per payload",
    "leave_out_link": "redundant links left out",
    "leave_out_link_per_payload": "redundant links left out, per payload",
    "per_leg_closure": "closure leg by leg",
    "per_leg_closure_per_payload": "closure leg by leg, per payload",
}
RIGID_FROM = 7  # of the names above


def draw(rows_by_machine: dict[str, list[dict[str, Any]]], path: Path) -> None:
    """Median rig and the middle 90 % of rigs; dotted lines: the bound."""
    figure = Figure(figsize=(11.0, 7.2))
    axes = figure.subplots(1, len(rows_by_machine), sharey=True, sharex=True, squeeze=False)[0]
    for place, (machine, rows) in zip(axes, rows_by_machine.items(), strict=True):
        for number, (case, kg, label, colour, marker) in enumerate(SHOWN):
            offset = 0.18 * (number - (len(SHOWN) - 1) / 2)
            for row, name in enumerate(NAMES):
                error = figures(rows, CASES[case], kg, name)[:, 0]
                error = error[np.isfinite(error)]
                if error.size == 0:
                    continue
                low, middle, high = np.percentile(error, [5, 50, 95])
                place.plot([low, high], [row + offset] * 2, color=colour, linewidth=1.4)
                place.plot(middle, row + offset, marker, color=colour, markersize=4.5)
            bound = pooled(figures(rows, CASES[case], kg, "bound"))[0]
            place.axvline(bound, color=colour, linestyle=":", linewidth=1.1, zorder=0)
            place.plot([], [], marker, color=colour, linewidth=1.4, linestyle="-", label=label)
        place.axhspan(RIGID_FROM - 0.5, len(NAMES) - 0.5, color="0.95", zorder=-1)
        place.set_xscale("log")
        place.set_xticks([1, 2, 5, 10, 20, 50], labels=["1", "2", "5", "10", "20", "50"])
        place.minorticks_off()
        place.set_xlabel("held-out position error, RMS of a rig / um")
        place.set_title(f"{machine}, {len(rows)} rigs", loc="left", fontsize=10)
        place.grid(axis="x", color="0.9", linewidth=0.7)
        place.spines[["top", "right"]].set_visible(False)
    first = axes[0]
    first.set_yticks(range(len(NAMES)), labels=list(NAMES.values()))
    first.set_ylim(len(NAMES) - 0.5, -0.5)
    axes[-1].text(
        0.99, RIGID_FROM - 0.4, "rigid models", transform=axes[-1].get_yaxis_transform(),
        ha="right", va="top", fontsize=9, color="0.35",
    )  # fmt: skip
    handles, labels = first.get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower center", ncols=2, frameon=False, fontsize=9)
    figure.suptitle(
        "Estimators and rigid baselines against the noise-free truth\n"
        "marker: median rig, bar: 5 to 95 % of rigs, dotted: posterior bound",
        x=0.01, ha="left", fontsize=11,
    )  # fmt: skip
    figure.tight_layout(rect=(0.0, 0.07, 1.0, 1.0))
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100, metadata={"Software": None})
