"""Pictures of a comparison: what the changes do over the workspace, and how probable each structure is."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from calibration.comparison.result import Comparison, WorkspaceChange
from calibration.machine.description import Machine
from pkm_rig.report.comparison_json import by_probability
from pkm_rig.report.comparison_text import name_in_words
from pkm_rig.report.diagnosis_pictures import plane
from pkm_rig.report.notation import literal
from pkm_rig.report.pictures import AFTER, BEFORE, NEUTRAL, round_scale

ARROW_SHARE = 0.09  # of the map's width, of the longest arrow


def draw_all(comparison: Comparison, machine: Machine) -> dict[str, Figure]:
    """All pictures by file name; no map where the machine has not changed."""
    out = {"probabilities": probabilities(comparison)}
    if comparison.workspace is not None:
        out = {"workspace": workspace_map(comparison, comparison.workspace, machine)} | out
    return out


def workspace_map(comparison: Comparison, change: WorkspaceChange, machine: Machine) -> Figure:
    """Shift of the tool point over the workspace: an arrow a point in its plane, its length in colour beside."""
    first, second = plane(machine)
    names, shown = "xyz", change.shown
    tool, shift = change.tool_m[shown], change.shift_m[shown]
    size = np.linalg.norm(shift, axis=1) * 1e6
    figure = Figure(figsize=(11.0, 4.8))
    axes = figure.add_subplot(1, 2, 1)
    in_plane = np.linalg.norm(shift[:, [first, second]], axis=1)
    longest_m = float(np.max(in_plane))
    key_m = round_scale(longest_m)
    span = float(np.ptp(tool[:, [first, second]], axis=0).max())
    arrows = axes.quiver(
        tool[:, first], tool[:, second], shift[:, first], shift[:, second],
        color=AFTER, angles="xy", scale_units="xy", width=0.003,
        scale=max(longest_m, 1e-12) / (ARROW_SHARE * max(span, 1e-3)),
    )  # fmt: skip
    axes.quiverkey(arrows, 0.84, 1.04, key_m, f"{key_m * 1e6:g} µm", labelpos="E")
    axes.set_title("after minus before", loc="left", fontsize=10)
    beside = figure.add_subplot(1, 2, 2)
    colours = beside.tricontourf(tool[:, first], tool[:, second], size, levels=12, cmap="viridis")
    figure.colorbar(colours, ax=beside, label="length / µm")
    beside.set_title(
        f"{change.rms_m * 1e6:.1f} µm RMS, at most {change.max_m * 1e6:.1f} µm in the whole workspace",
        loc="left", fontsize=10,
    )  # fmt: skip
    for panel in (axes, beside):
        panel.set_xlabel(f"{names[first]} / m")
        panel.set_ylabel(f"{names[second]} / m")
        panel.set_aspect("equal")
    axes.margins(0.14)
    third = ({0, 1, 2} - {first, second}).pop()
    level = "" if machine.planar else f" at {names[third]} = {tool[0, third]:.3g} m"
    what = " and ".join(name_in_words(c.structure, c.place) for c in comparison.changes if c.of_machine)
    titles = (f"Shift of the tool point{level}: {what}", f"{comparison.before} and {comparison.after}")
    figure.suptitle("\n".join(literal(title) for title in titles), fontsize=11)
    figure.tight_layout(rect=(0.0, 0.0, 1.0, 0.98))
    return figure


def probabilities(comparison: Comparison) -> Figure:
    """Probability of each structure, of nothing and of something unknown."""
    ranked = by_probability(comparison)[::-1]
    names = [name.replace("_", " ") for name, _ in ranked]
    colours = [BEFORE if name == comparison.verdict else NEUTRAL for name, _ in ranked]
    figure = Figure(figsize=(7.0, 0.4 * len(ranked) + 1.4))
    axes = figure.add_subplot()
    bars = axes.barh(names, [p for _, p in ranked], color=colours)
    axes.bar_label(bars, labels=[f"{p:.3f}" for _, p in ranked], padding=3, fontsize=9)
    axes.set_xlim(0.0, 1.15)
    axes.set_xticks([0.0, 0.25, 0.5, 0.75, 1.0])
    axes.set_xlabel("probability")
    axes.set_title(literal(f"What changed between {comparison.before} and {comparison.after}"), loc="left", fontsize=10)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    figure.tight_layout()
    return figure
