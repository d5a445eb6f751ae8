"""A campaign that was not made, for people: its visits, durations, and a picture of poses and way."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from pkm_rig.report.terminal import results
from pkm_rig.results.dry_run import STATION_S, DryRun

COLOURS = ("#2a6f97", "#b0413e", "#6a994e", "#bc6c25")


def print_dry_run(run: DryRun) -> None:
    """One line a visit, then durations."""
    units = [f"{c}/{'mrad' if c.startswith('r') else 'mm'}" for c in run.coordinates]
    names = ("visit", "pose", "payload", *units, "m/s", "way/s", "at/min")
    results.print("".join(f"{name:>9}" for name in names), soft_wrap=True)
    for visit in run.visits:
        numbers = [f"{value * 1e3:.1f}" for value in visit.commanded]
        row = (visit.number, visit.pose, visit.payload, *numbers, f"{visit.speed_m_per_s:g}", f"{visit.way_s:.1f}")
        results.print("".join(f"{cell:>9}" for cell in (*row, f"{visit.t_s / 60.0:.1f}")), soft_wrap=True)
    results.print(
        f"{len(run.visits)} visits, {run.readings} readings; {run.moving_s / 60.0:.1f} min moving "
        f"({'led by SYNC along straight ways' if run.motion == 'led' else 'each drive by its profile'}), "
        f"{run.measuring_s / 60.0:.1f} min measuring at {STATION_S:g} s a point, {run.total_s / 60.0:.0f} min in all, "
        "without warm-up and verification",
        soft_wrap=True,
    )


def draw_dry_run(run: DryRun) -> Figure:
    """Poses and the way between them, each two commanded coordinates beside one another, coloured by payload."""
    values = np.array([visit.commanded for visit in run.visits])
    payloads = np.array([visit.payload for visit in run.visits])
    count = len(run.coordinates)
    pairs = [(i, i + 1) for i in range(0, count - 1, 2)] + ([(count - 2, count - 1)] if count % 2 and count > 1 else [])
    figure = Figure(figsize=(4.6 * max(len(pairs), 1), 4.2))
    for place, (i, j) in enumerate(pairs or [(0, 0)], start=1):
        axes = figure.add_subplot(1, max(len(pairs), 1), place)
        axes.plot(values[:, i], values[:, j], "-", color="0.8", linewidth=0.6, zorder=0)
        for payload in sorted(set(payloads.tolist())):
            rows = payloads == payload
            colour = COLOURS[payload % len(COLOURS)]
            axes.plot(values[rows, i], values[rows, j], "o", color=colour, markersize=3, label=f"payload {payload}")
        for axis, number in ((axes.xaxis, i), (axes.yaxis, j)):
            name = run.coordinates[number]
            axis.set_label_text(f"{name} / {'rad' if name.startswith('r') else 'm'}")
        if place == 1:
            axes.legend(frameon=False, fontsize=8)
    figure.suptitle(f"{run.machine}: {len(run.visits)} visits, {run.total_s / 60.0:.0f} min", fontsize=11)
    figure.tight_layout()
    return figure
