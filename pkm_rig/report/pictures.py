"""Pictures of a calibration, as SVG or PNG data for a page without outside requests."""

from __future__ import annotations

import base64
import io
import warnings
from pathlib import Path
from typing import IO

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calibration.base.arrays import Array
from calibration.identification.calibration import Calibration
from calibration.machine.description import COORDINATES
from calibration.reduction.figures import coordinate_errors, figure_axes
from calibration.reduction.nest_checks import nest_shift
from calibration.reduction.reduction import CALIBRATION, Reduction
from pkm_rig.report.notation import literal

# Colours of Okabe and Ito, which people with any kind of colour blindness can tell; shapes differ as well.
BEFORE, AFTER, NEUTRAL = "#d55e00", "#0072b2", "#5c677d"
SERIES = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#000000")
MARKS = ("o", "s", "^", "D", "v", "P", "X")
MOST_PARAMETERS = 30  # in the picture; the table has all


def save_png(figure: Figure, file: IO[bytes] | Path, *, simulated: bool) -> None:
    """Write a figure as PNG, with SIMULATED across it if it does not come from a machine. Raises OSError."""
    if simulated:
        figure.text(0.5, 0.5, "SIMULATED", ha="center", va="center", rotation=20, fontsize=44, color="0.5", alpha=0.3)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing", UserWarning)  # of a name in letters that the font lacks
        figure.savefig(file, format="png", dpi=110, bbox_inches="tight", metadata={"Software": None})


def data_uri(figure: Figure, *, simulated: bool) -> str:
    """A figure as a PNG data URI; `simulated` as for `save_png`."""
    stream = io.BytesIO()
    save_png(figure, stream, simulated=simulated)
    return "data:image/png;base64," + base64.b64encode(stream.getvalue()).decode("ascii")


def round_scale(value: float) -> float:
    """1, 2 or 5 times a power of ten, not above the value."""
    power = 10.0 ** np.floor(np.log10(max(value, 1e-9)))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= max(value, 1e-9) * 1.0001))


def verification_scatter(reduction: Reduction, payload: int, title: str) -> Figure:
    """Measured tool errors at the verification poses, before and after, in two scales."""
    figure = Figure(figsize=(10.0, 3.8))
    errors = {}
    for phase in ("verification_before", "verification_after"):
        rows = reduction.rows(phase, payload)
        errors[phase] = reduction.errors(rows)[0] * 1e6
    for place, phases in enumerate((("verification_before", "verification_after"), ("verification_after",)), start=1):
        axes = figure.add_subplot(1, 2, place)
        for phase in phases:
            before = phase.endswith("before")
            axes.plot(
                errors[phase][:, 0],
                errors[phase][:, 1],
                "o" if before else "D",
                color=BEFORE if before else AFTER,
                markersize=4,
                label="before" if before else "after",
            )
        axes.axhline(0.0, color="0.8", linewidth=0.8, zorder=0)
        axes.axvline(0.0, color="0.8", linewidth=0.8, zorder=0)
        axes.set_xlabel("error in x / µm")
        axes.set_ylabel("error in y / µm")
        axes.set_aspect("equal", adjustable="datalim")
        legend_above(axes)
    figure.suptitle(literal(title), fontsize=11)
    figure.tight_layout()
    return figure


def legend_above(axes: Axes, columns: int = 6) -> None:
    """A legend above the axes, where it covers nothing."""
    axes.legend(
        frameon=False, fontsize=9, ncols=columns, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2,
        handletextpad=0.3, columnspacing=1.0,
    )  # fmt: skip


def coordinate_bars(reduction: Reduction, payload: int, title: str) -> Figure:
    """RMS errors at the verification poses by free coordinate, before and after; grey: the drives do not command it."""
    machine = reduction.recording.machine
    figure = Figure(figsize=(10.0, 3.6))
    phases = ("verification_before", "verification_after")
    rms = {phase: coordinate_errors(reduction, phase, payload) for phase in phases}
    for place, (kind, unit) in enumerate((("position", "µm"), ("rotation", "µrad")), start=1):
        chosen = [c for c in machine.dof.tolist() if (c < 3) == (kind == "position")]
        axes = figure.add_subplot(1, 2, place)
        for shift, phase, colour in zip((-0.2, 0.2), phases, (BEFORE, AFTER), strict=True):
            for x, coordinate in enumerate(chosen):
                is_commanded = coordinate in machine.commanded
                axes.bar(
                    x + shift,
                    rms[phase][coordinate] * 1e6,
                    0.36,
                    color=colour if is_commanded else "0.7" if shift < 0.0 else "0.55",
                )
        names = [COORDINATES[c] + ("" if c in machine.commanded else "\n(not commanded)") for c in chosen]
        axes.set_xticks(range(len(chosen)), names)
        axes.set_ylabel(f"RMS error / {unit}")
    figure.axes[0].plot([], [], "s", color=BEFORE, label="before")
    figure.axes[0].plot([], [], "s", color=AFTER, label="after")
    legend_above(figure.axes[0])
    figure.suptitle(literal(title), fontsize=11)
    figure.tight_layout()
    return figure


def residuals(calibration: Calibration) -> Figure:
    """Whitened residuals of the fit over rig time and by reflector, and their distribution against the normal one."""
    reduction, fit = calibration.reduction, calibration.fit
    observations = reduction.calibration()
    white = fit.residuals[0]
    t_h = reduction.info.t_rig_s[reduction.info.phase == CALIBRATION][observations.visit] / 3600.0
    figure = Figure(figsize=(10.0, 3.6))
    over_time, shape, by_reflector = figure.subplots(1, 3, width_ratios=(2.0, 1.2, 1.2))
    machine = reduction.recording.machine
    reflectors = sorted(set(observations.smr.tolist()))
    for place, index in enumerate(reflectors):
        rows = observations.smr == index
        colour, mark = SERIES[place % len(SERIES)], MARKS[place % len(MARKS)]
        over_time.plot(
            np.repeat(t_h[rows], white.shape[1]), white[rows].ravel(), mark, markersize=2.2, color=colour,
            label=literal(machine.smrs[index].name),
        )  # fmt: skip
        of_one = white[rows].ravel()
        by_reflector.plot(np.full(of_one.size, float(place)), of_one, "_", color=colour, markersize=9, alpha=0.35)
        rms = float(np.sqrt(np.mean(of_one**2)))
        by_reflector.errorbar(place + 0.32, 0.0, yerr=rms, fmt="none", ecolor="black", capsize=2)
    limit = 1.08 * max(4.0, float(np.max(np.abs(white))))
    over_time.set_xlabel("rig time / h")
    over_time.set_ylabel("residual / standard deviation")
    legend_above(over_time)
    shape.hist(white.ravel(), bins=41, range=(-limit, limit), density=True, color=SERIES[4], label="residuals")
    grid = np.linspace(-limit, limit, 200)
    shape.plot(grid, np.exp(-0.5 * grid**2) / np.sqrt(2 * np.pi), color="black", linewidth=1, label="normal")
    shape.set_xlabel("residual / standard deviation")
    shape.set_ylabel("density")
    legend_above(shape)
    by_reflector.set_xticks(range(len(reflectors)), [literal(machine.smrs[i].name) for i in reflectors], fontsize=8)
    by_reflector.set_xlim(-0.6, len(reflectors) - 0.2)
    by_reflector.set_xlabel("reflector (bars: RMS)")
    for axes in (over_time, by_reflector):
        axes.set_ylim(-limit, limit)
    figure.tight_layout()
    return figure


def conditions(reduction: Reduction) -> Figure:
    """Part temperatures, payload and the shift of the floor nests over the campaign."""
    recording = reduction.recording
    t_h = recording["t_rig_s"] / 3600.0
    order = np.argsort(t_h)
    figure = Figure(figsize=(10.0, 3.6))
    axes = figure.add_subplot(1, 2, 1)
    for place, (name, values) in enumerate(recording.temperatures_c().items()):
        axes.plot(
            t_h[order], values[order], color=SERIES[place % len(SERIES)], label=literal(name),
            marker=MARKS[place % len(MARKS)], markevery=max(1, len(order) // 8), markersize=4,
        )  # fmt: skip
    axes.plot(t_h[order], recording["air_temperature_c"][order], label="air", color="0.6")
    axes.set_xlabel("rig time / h")
    axes.set_ylabel("temperature / °C")
    legend_above(axes, 5)
    load = axes.twinx()
    load.fill_between(t_h[order], recording["payload_mass_kg"][order], step="post", alpha=0.12, color="black")
    load.set_ylabel("payload / kg")
    checks, shifts = nest_shift(recording)
    other = figure.add_subplot(1, 2, 2)
    other.plot(checks, shifts * 1e6, "o-", color=NEUTRAL, markersize=3, label="measured")
    other.axhline(recording.file.nest_limit_m * 1e6, color=BEFORE, linestyle="--", label="limit")
    other.set_xlabel("nest check")
    other.set_ylabel("largest shift of a nest / µm")
    other.set_ylim(bottom=0.0)
    legend_above(other)
    figure.tight_layout(w_pad=3.0)
    return figure


def parameter_plot(calibration: Calibration) -> Figure:
    """The largest identified deviations in units of their tolerance, with U; hollow: the tolerance decides."""
    fit = calibration.fit
    parameters = fit.model.parameters.parameters
    tolerance = np.array([p.tolerance for p in parameters])
    value, u = fit.theta / tolerance, 2.0 * fit.theta_u / tolerance
    largest = np.argsort(-np.abs(value), kind="stable")[:MOST_PARAMETERS]
    figure = Figure(figsize=(10.0, 0.22 * len(largest) + 0.8))
    axes = figure.add_subplot()
    for row, i in enumerate(largest):
        is_determined = u[i] * tolerance[i] < parameters[i].sigma
        axes.errorbar(
            value[i], row, xerr=u[i], fmt="o" if is_determined else "s", markersize=4, capsize=2,
            color=AFTER if is_determined else "0.45", markerfacecolor=AFTER if is_determined else "white",
        )  # fmt: skip
    axes.axvspan(-1.0, 1.0, color="0.95", zorder=0)
    axes.set_yticks(range(len(largest)), [literal(parameters[i].name) for i in largest], fontsize=9)
    axes.set_ylim(len(largest) - 0.4, -0.6)
    axes.set_xlabel("deviation from nominal / tolerance (bars: k = 2)")
    figure.tight_layout()
    return figure


def orientation_plot(reduction: Reduction, predicted: Array, payload: int) -> Figure:
    """Measured against predicted orientation at the verification poses before compensation."""
    rows = reduction.rows("verification_before", payload)
    target = reduction.observations.visits.target_m[rows]
    _, turns = figure_axes(reduction.recording.machine)
    _, measured = reduction.report.tool_error(reduction.poses.coordinates[rows], target)
    _, expected = reduction.report.tool_error(predicted, target)
    figure = Figure(figsize=(4.6, 3.4))
    axes = figure.add_subplot()
    for axis in turns:
        axes.plot(expected[:, axis] * 1e6, measured[:, axis] * 1e6, "o", color=AFTER, markersize=4)
    ends = np.array(axes.get_xlim())
    axes.plot(ends, ends, color="0.7", linewidth=0.8, zorder=0)
    axes.set_xlabel("predicted rotation / µrad")
    axes.set_ylabel("measured rotation / µrad")
    figure.tight_layout()
    return figure
