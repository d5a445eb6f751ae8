"""The picture of a machine's life: errors with their limits, temperature, the parameters that have changed most."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure

from calibration.reduction.figures import COVERAGE_FACTOR
from pkm_rig.report.notation import literal
from pkm_rig.report.pictures import AFTER, BEFORE, NEUTRAL

MOST_MARKED = 12  # events with a line of their own
UNIT_FACTORS = {"m": (1e6, "µm"), "rad": (1e6, "µrad"), "1": (1e6, "1e-6")}


def draw_history(life: Mapping[str, Any], parameters: Sequence[str]) -> Figure:
    """Errors of checks and calibrations against the date, temperature, and `parameters` with their uncertainty."""
    rows = 2 + (len(parameters) + 1) // 2
    figure = Figure(figsize=(10.0, 2.4 * rows + 0.6))
    grid = figure.add_gridspec(rows, 2)
    errors = figure.add_subplot(grid[0, :])
    _errors(errors, life)
    warmth = figure.add_subplot(grid[1, :], sharex=errors)
    _temperatures(warmth, life)
    for number, name in enumerate(parameters):
        axes = figure.add_subplot(grid[2 + number // 2, number % 2], sharex=errors)
        _parameter(axes, name, life["parameters"][name])
    for axes in figure.axes:
        locator = AutoDateLocator(minticks=2, maxticks=7)  # type: ignore[no-untyped-call]
        axes.xaxis.set_major_locator(locator)
        axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]
    figure.suptitle(literal(f"{life['rig']}: {life['machine']}"), fontsize=11)
    figure.tight_layout(rect=(0.0, 0.0, 1.0, 0.98))
    return figure


def _errors(axes: Axes, life: Mapping[str, Any]) -> None:
    _bars(axes, life["checks"], "error", "o", NEUTRAL, "check")
    _bars(axes, life["calibrations"], "as_found", "v", BEFORE, "calibration, as found")
    _bars(axes, life["calibrations"], "as_left", "^", AFTER, "calibration, as left")
    ends = [_date(row["created"]) for row in (*life["checks"], *life["calibrations"])]
    for number, tolerance in enumerate(life["tolerances"]):
        later = life["tolerances"][number + 1 : number + 2]
        until = _date(later[0]["since"]) if later else max([*ends, _date(tolerance["since"])])
        axes.hlines(
            tolerance["position_m"] * 1e6, _date(tolerance["since"]), until, colors=BEFORE, linestyles="--",
            label="" if number else "tolerance",
        )  # fmt: skip
    marked = [e for e in life["events"] if e["kind"] not in ("tolerance stated", "recalibration")]
    for event in marked[-MOST_MARKED:]:
        axes.axvline(_date(event["created"]), color="0.6", linewidth=0.8, zorder=0)
        axes.annotate(
            literal(f"{event['kind']} {event.get('part', '')}".strip()), (_date(event["created"]), 1.0),
            xycoords=("data", "axes fraction"), rotation=90, fontsize=7, ha="right", va="top", color="0.35",
        )  # fmt: skip
    for entry in life["calibrations"]:
        if entry["effects"] and entry["as_left"]:
            axes.annotate(
                literal(", ".join(entry["effects"])), (_date(entry["created"]), 0.98),
                xycoords=("data", "axes fraction"), fontsize=7, va="top",
            )  # fmt: skip
    for period in life["in_doubt"]:
        axes.axvspan(_date(period["since"]), _date(period["until"]), color=BEFORE, alpha=0.12, linewidth=0)
    axes.set_ylabel("error RMS / µm (k = 2)")
    axes.set_ylim(bottom=0.0)
    if axes.get_legend_handles_labels()[1]:
        axes.legend(frameon=False, fontsize=8, ncols=4, loc="lower left", bbox_to_anchor=(0.0, 1.0))


def _bars(axes: Axes, entries: Sequence[Mapping[str, Any]], key: str, marker: str, colour: str, label: str) -> None:
    with_figure = [entry for entry in entries if entry[key] is not None]
    if with_figure:
        axes.errorbar(
            [_date(entry["created"]) for entry in with_figure],
            [entry[key]["position_m"] * 1e6 for entry in with_figure],
            yerr=[COVERAGE_FACTOR * entry[key]["u_m"] * 1e6 for entry in with_figure],
            fmt=marker, color=colour, markersize=4, capsize=2, linewidth=1, label=label,
        )  # fmt: skip


def _temperatures(axes: Axes, life: Mapping[str, Any]) -> None:
    rows = [row for row in (*life["checks"], *life["calibrations"]) if row["temperature_c"] is not None]
    rows = sorted(rows, key=lambda row: str(row["created"]))
    axes.plot(
        [_date(r["created"]) for r in rows], [r["temperature_c"] for r in rows], "o-", color=NEUTRAL, markersize=3
    )
    axes.set_ylabel("temperature / °C")


def _parameter(axes: Axes, name: str, parameter: Mapping[str, Any]) -> None:
    factor, unit = UNIT_FACTORS[parameter["unit"]]
    points = parameter["points"]
    axes.errorbar(
        [_date(p["created"]) for p in points],
        np.array([p["value"] for p in points]) * factor,
        yerr=np.array([p["u"] for p in points]) * factor * COVERAGE_FACTOR,
        fmt="o", color=AFTER, markersize=4, capsize=2, linewidth=1,
    )  # fmt: skip
    axes.set_ylabel(f"{unit} (k = 2)")
    axes.set_title(literal(name), loc="left", fontsize=9)


def _date(created: str) -> Any:
    """For matplotlib, which takes dates though its types do not say so."""
    return datetime.fromisoformat(created)
