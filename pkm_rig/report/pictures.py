"""Pictures of a calibration, as SVG or PNG data for a page without outside requests."""

from __future__ import annotations

import base64
import io
import warnings
from pathlib import Path
from typing import IO

import numpy as np
from matplotlib.figure import Figure

from calibration.base.arrays import Array
from calibration.compensation.error_map import ErrorMap
from calibration.identification.calibration import Calibration
from calibration.reduction.figures import free_axes
from calibration.reduction.nest_checks import nest_shift
from calibration.reduction.reduction import CALIBRATION, Reduction
from pkm_rig.report.notation import literal

BEFORE, AFTER, NEUTRAL = "#b0413e", "#2a6f97", "#5c677d"


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


def error_maps(maps: ErrorMap, title: str) -> Figure:
    """Tool error vectors over the workspace, before and after; each panel with its own arrow scale, stated."""
    figure = Figure(figsize=(10.0, 4.4))
    for place, (errors, name, colour) in enumerate(
        ((maps.before_m, "before", BEFORE), (maps.after_m, "after", AFTER)), start=1
    ):
        axes = figure.add_subplot(1, 2, place)
        length = np.hypot(errors[:, 0], errors[:, 1])
        key_m = round_scale(float(np.max(length)))
        quiver = axes.quiver(
            maps.target_m[:, 0], maps.target_m[:, 1], errors[:, 0], errors[:, 1],
            color=colour, angles="xy", scale_units="xy", scale=key_m / 0.06, width=0.004,
        )  # fmt: skip
        axes.quiverkey(quiver, 0.80, 1.04, key_m, f"{key_m * 1e6:g} µm", labelpos="E")
        rms = float(np.sqrt(np.mean(length**2)))
        axes.set_title(f"{name}: {rms * 1e6:.1f} µm RMS", loc="left", fontsize=10)
        axes.set_xlabel("x / m")
        axes.set_ylabel("y / m")
        axes.set_aspect("equal")
        axes.margins(0.14)
    figure.suptitle(literal(title), fontsize=11)
    figure.tight_layout(rect=(0.0, 0.0, 1.0, 0.97))
    return figure


def round_scale(value: float) -> float:
    """1, 2 or 5 times a power of ten, not above the value."""
    power = 10.0 ** np.floor(np.log10(max(value, 1e-9)))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= max(value, 1e-9) * 1.0001))


def verification_scatter(reduction: Reduction, payload: int, title: str) -> Figure:
    """Measured tool errors at the verification poses, before and after, in two scales."""
    figure = Figure(figsize=(10.0, 4.2))
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
        axes.legend(frameon=False)
    figure.suptitle(literal(title), fontsize=11)
    figure.tight_layout()
    return figure


def residuals(calibration: Calibration) -> Figure:
    """Whitened residuals of the fit over rig time by reflector, and their distribution against the normal one."""
    reduction, fit = calibration.reduction, calibration.fit
    observations = reduction.calibration()
    white = fit.residuals[0]
    t_h = reduction.info.t_rig_s[reduction.info.phase == CALIBRATION][observations.visit] / 3600.0
    figure = Figure(figsize=(10.0, 3.6))
    axes = figure.add_subplot(1, 3, (1, 2))
    machine = reduction.recording.machine
    for index in sorted(set(observations.smr.tolist())):
        rows = observations.smr == index
        axes.plot(t_h[rows], white[rows], ".", markersize=3, color=f"C{index}")
        axes.plot([], [], "o", color=f"C{index}", label=literal(machine.smrs[index].name))
    axes.set_xlabel("rig time / h")
    axes.set_ylabel("residual / standard deviation")
    axes.legend(frameon=False, ncols=5, fontsize=8, loc="upper right")
    axes.set_ylim(-5.5, 5.5)
    side = figure.add_subplot(1, 3, 3)
    side.hist(white.ravel(), bins=40, range=(-5, 5), density=True, color=NEUTRAL)
    grid = np.linspace(-5, 5, 200)
    side.plot(grid, np.exp(-0.5 * grid**2) / np.sqrt(2 * np.pi), color="black", linewidth=1, label="normal")
    side.set_xlabel("residual / standard deviation")
    side.legend(frameon=False)
    figure.tight_layout()
    return figure


def conditions(reduction: Reduction) -> Figure:
    """Part temperatures, payload and the shift of the floor nests over the campaign."""
    recording = reduction.recording
    t_h = recording["t_rig_s"] / 3600.0
    order = np.argsort(t_h)
    figure = Figure(figsize=(10.0, 3.6))
    axes = figure.add_subplot(1, 2, 1)
    for name, values in recording.temperatures_c().items():
        axes.plot(t_h[order], values[order], label=literal(name))
    axes.plot(t_h[order], recording["air_temperature_c"][order], label="air", color="0.6")
    axes.set_xlabel("rig time / h")
    axes.set_ylabel("temperature / °C")
    axes.legend(frameon=False, fontsize=8)
    load = axes.twinx()
    load.fill_between(t_h[order], recording["payload_mass_kg"][order], step="post", alpha=0.12, color="black")
    load.set_ylabel("payload / kg")
    checks, shifts = nest_shift(recording)
    other = figure.add_subplot(1, 2, 2)
    other.plot(checks, shifts * 1e6, "o-", color=NEUTRAL, markersize=3)
    other.axhline(recording.file.nest_limit_m * 1e6, color=BEFORE, linestyle="--", label="limit")
    other.set_xlabel("nest check")
    other.set_ylabel("largest shift across the line of sight / µm")
    other.set_ylim(bottom=0.0)
    other.legend(frameon=False)
    figure.tight_layout()
    return figure


def parameter_plot(calibration: Calibration) -> Figure:
    """Identified deviations in units of their tolerance, with expanded uncertainty; grey: the prior decides."""
    fit = calibration.fit
    parameters = fit.model.parameters.parameters
    tolerance = np.array([p.tolerance for p in parameters])
    value, u = fit.theta / tolerance, 2.0 * fit.theta_u / tolerance
    figure = Figure(figsize=(10.0, 0.2 * len(parameters) + 0.8))
    axes = figure.add_subplot()
    for row, (p, v, w) in enumerate(zip(parameters, value, u, strict=True)):
        is_determined = w * p.tolerance < p.sigma
        axes.errorbar(v, row, xerr=w, fmt="o", markersize=3, color=AFTER if is_determined else "0.65", capsize=2)
    axes.axvspan(-1.0, 1.0, color="0.95", zorder=0)
    axes.set_yticks(range(len(parameters)), [literal(p.name) for p in parameters], fontsize=7)
    axes.invert_yaxis()
    axes.set_xlabel("deviation from nominal / tolerance (bars: k = 2)")
    figure.tight_layout()
    return figure


def orientation_plot(reduction: Reduction, predicted: Array, payload: int) -> Figure:
    """Measured against predicted orientation at the verification poses before compensation."""
    rows = reduction.rows("verification_before", payload)
    target = reduction.observations.visits.target_m[rows]
    _, turns = free_axes(reduction.recording.machine)
    _, measured = reduction.report.tool_error(reduction.poses.coordinates[rows], target)
    _, expected = reduction.report.tool_error(predicted, target)
    figure = Figure(figsize=(4.6, 3.6))
    axes = figure.add_subplot()
    for axis in turns:
        axes.plot(expected[:, axis] * 1e6, measured[:, axis] * 1e6, "o", color=AFTER, markersize=4)
    ends = np.array(axes.get_xlim())
    axes.plot(ends, ends, color="0.7", linewidth=0.8, zorder=0)
    axes.set_xlabel("predicted rotation / µrad")
    axes.set_ylabel("measured rotation / µrad")
    figure.tight_layout()
    return figure
