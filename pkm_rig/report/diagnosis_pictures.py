"""Pictures of a diagnosis: error map, gap against its strongest coordinates, time line, spectrum."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calibration.base.arrays import Array
from calibration.diagnosis.result import Diagnosis, VisitGaps
from calibration.machine.description import Machine
from pkm_rig.report.maps import Field, error_maps
from pkm_rig.report.notation import literal
from pkm_rig.report.pictures import AFTER, BEFORE, NEUTRAL, SERIES, legend_above, round_scale, save_png

PANELS, BINS, LEAST_IN_BIN, LEAST_SHARE = 4, 12, 3, 0.02
MAX_VALUES_AS_TICKS = 4  # values of a coordinate that are written out at the axis
CLEAR_PEAK = 4.0  # times the power of noise, and of the rest of the spectrum: a peak above is marked with its period


class Coordinate(NamedTuple):
    """Something that the gap may depend on, one value a visit; where it also turns with a side, `side` is +1 or -1."""

    label: str
    values: Array
    side: Array
    share: str = ""


def draw_all(diagnosis: Diagnosis, machine: Machine) -> dict[str, Figure]:
    """All pictures by file name; those that there is nothing to draw for are left out."""
    out = {}
    if np.any(diagnosis.visits.before_m[:, plane(machine)]):  # of heights alone there are no arrows
        out["error-map"] = error_map(diagnosis, machine)
    if len(diagnosis.visits.tool_m):
        out["coordinates"] = coordinates(diagnosis, machine)
        if diagnosis.visits.times_known:
            out["time-line"] = time_line(diagnosis, machine)
    if diagnosis.spectra:
        out["spectrum"] = spectrum(diagnosis)
    return out


def save(figures: Mapping[str, Figure], folder: Path, *, simulated: bool) -> dict[str, str]:
    """Write figures as PNG files into a folder that is there; name to path; `simulated` as for `save_png`.

    Raises OSError.
    """
    paths = {}
    for name, figure in figures.items():
        path = folder / f"{name}.png"
        save_png(figure, path, simulated=simulated)
        paths[name] = str(path)
    return paths


def series(visits: VisitGaps) -> list[tuple[Array, str, str]]:
    """Gaps, what they are and their colour: before and after; only one where no effect was added."""
    if np.array_equal(visits.before_m, visits.after_m):
        return [(visits.before_m, "gap", BEFORE)]
    return [(visits.before_m, "before", BEFORE), (visits.after_m, "after", AFTER)]


def plane(machine: Machine) -> tuple[int, int]:
    """The two coordinates of the tool in which its workspace is widest, in order."""
    width = np.ptp(machine.workspace[:3], axis=1)
    first, second = sorted(np.argsort(-width, kind="stable")[:2].tolist())
    return first, second


def error_map(diagnosis: Diagnosis, machine: Machine) -> Figure:
    """The platform's gap at every visit over the workspace, before and after with one arrow scale."""
    visits, axes_of = diagnosis.visits, plane(machine)
    largest = float(np.percentile(np.linalg.norm(visits.before_m[:, axes_of], axis=1), 95.0))
    fields = [
        Field(
            name, visits.tool_m[:, axes_of], gaps[:, axes_of], colour, float(np.sqrt(np.mean(np.sum(gaps**2, axis=1))))
        )
        for gaps, name, colour in series(visits)
    ]
    title = f"Measured minus model, noise taken off, an arrow a visit; verdict: {diagnosis.verdict}"
    return error_maps(fields, title, key_m=round_scale(largest), names=("xyz"[axes_of[0]], "xyz"[axes_of[1]]))


def coordinates(diagnosis: Diagnosis, machine: Machine) -> Figure:
    """The gap against the coordinates that have the largest shares of it, with means (bars: k = 2)."""
    chosen = largest_coordinates(diagnosis, machine)
    figure = Figure(figsize=(10.0, 3.4 * ((len(chosen) + 1) // 2)))
    for place, coordinate in enumerate(chosen, start=1):
        axes = figure.add_subplot((len(chosen) + 1) // 2, 2, place)
        turned = coordinate.side[:, None]
        along = _most_varying_direction(coordinate.values, diagnosis.visits.before_m * turned)
        for gaps, name, colour in series(diagnosis.visits):
            value = (gaps * turned) @ along * 1e6
            axes.plot(coordinate.values, value, ".", color=colour, markersize=3, alpha=0.35)
            at, mean, error = bin_means(coordinate.values, value)
            axes.errorbar(at, mean, 2.0 * error, fmt="o-", color=colour, markersize=4, linewidth=1.2, label=name)
        axes.axhline(0.0, color="0.8", linewidth=0.8, zorder=0)
        distinct = np.unique(coordinate.values)
        if len(distinct) <= MAX_VALUES_AS_TICKS:
            axes.set_xticks(distinct, [f"{value:g}" for value in distinct])
            axes.margins(x=0.2)
        axes.set_xlabel(literal(coordinate.label))
        axes.set_ylabel(f"gap along {_direction_text(along)} / µm")
        axes.set_title(literal(coordinate.share), loc="right", fontsize=9)
        legend_above(axes)
    figure.suptitle("Gap against its strongest coordinates", fontsize=11)
    figure.tight_layout()
    return figure


def largest_coordinates(diagnosis: Diagnosis, machine: Machine) -> list[Coordinate]:
    """The coordinates of the visits with the largest shares; where there are fewer than two, places too."""
    by_kind_and_name = visit_coordinates(diagnosis.visits, machine)
    varied = {key: c for key, c in by_kind_and_name.items() if len(np.unique(c.values)) > 1}
    out: dict[str, Coordinate] = {}
    for share in sorted(diagnosis.where, key=lambda s: -s.share):
        coordinate = varied.get((share.kind, share.name)) or varied.get((share.kind, ""))
        is_shown = share.share >= LEAST_SHARE or len(out) < 2
        if coordinate is not None and is_shown and coordinate.label not in out and len(out) < PANELS:
            words = " ".join(part for part in (share.kind, share.name) if part)
            words += f": {share.share:.0%} of the gap ({share.low:.0%} to {share.high:.0%})"
            out[coordinate.label] = coordinate._replace(share=words)
    for coordinate in varied.values():
        if len(out) < 2:
            out.setdefault(coordinate.label, coordinate)
    return list(out.values())


def visit_coordinates(visits: VisitGaps, machine: Machine) -> dict[tuple[str, str], Coordinate]:
    """Coordinates of the visits by (kind, name) of their shares; an empty name stands for all others of the kind."""
    a, b = plane(machine)
    same = np.ones(len(visits.tool_m))
    out: dict[tuple[str, str], Coordinate] = {}
    for axis in (a, b, *({0, 1, 2} - {a, b})):
        out["pose", "xyz"[axis]] = Coordinate(f"{'xyz'[axis]} of the tool / m", visits.tool_m[:, axis], same)
    for index, name in enumerate(machine.drive_names):
        side = visits.direction[:, index]
        out["drive", name] = Coordinate(f"drive {name} / m", visits.drives[:, index], same)
        out["direction", name] = Coordinate(f"side that drive {name} came from (+1: below)", side, same)
        turned = f"dwell / s (gap times the side of drive {name})"
        out["dwell", f"rest after {name}"] = Coordinate(turned, visits.dwell_s, side)
    out["time", ""] = Coordinate("rig time / h", visits.t_rig_s / 3600.0, same)
    out["load", ""] = Coordinate("payload / kg", visits.payload_kg, same)
    out["dwell", "rest"] = Coordinate("dwell / s", visits.dwell_s, same)
    return out


def time_line(diagnosis: Diagnosis, machine: Machine) -> Figure:
    """The gap over rig time in the two coordinates of the map, before and after; grey: payload on."""
    visits = diagnosis.visits
    order = np.argsort(visits.t_rig_s)
    hours = visits.t_rig_s[order] / 3600.0
    figure = Figure(figsize=(10.0, 4.8))
    for place, axis in enumerate(plane(machine), start=1):
        axes = figure.add_subplot(2, 1, place)
        for gaps, name, colour in series(visits):
            value = gaps[order, axis] * 1e6
            axes.plot(hours, value, ".", color=colour, markersize=3, alpha=0.4)
            at, mean, _ = bin_means(hours, value, bins=24)
            axes.plot(at, mean, "-", color=colour, linewidth=1.5, label=f"{name} (dots: visits, line: mean)")
        axes.axhline(0.0, color="0.8", linewidth=0.8, zorder=0)
        _shade_loads(axes, hours, visits.payload_kg[order])
        axes.set_ylabel(f"gap in {'xyz'[axis]} / µm")
        if place == 1:
            legend_above(axes)
    axes.set_xlabel("rig time / h")
    figure.suptitle("Gap over time (grey: with payload)", fontsize=11)
    figure.tight_layout()
    return figure


def spectrum(diagnosis: Diagnosis) -> Figure:
    """Power of the gap along each drive by spatial period, over the power of noise."""
    figure = Figure(figsize=(10.0, 3.8))
    axes = figure.add_subplot()
    for number, line in enumerate(diagnosis.spectra):
        axes.plot(
            line.period_m * 1e3,
            line.power,
            "-",
            linewidth=1.0,
            color=SERIES[number % len(SERIES)],
            label=f"drive {literal(line.drive)}",
        )
        if np.max(line.power, initial=0.0) > CLEAR_PEAK * max(float(np.median(line.power)), 1.0):
            top = int(np.argmax(line.power))
            axes.annotate(
                f"{line.period_m[top] * 1e3:.3g} mm",
                (line.period_m[top] * 1e3, line.power[top]),
                textcoords="offset points", xytext=(4, 2), fontsize=8, color=SERIES[number % len(SERIES)],
            )  # fmt: skip
    axes.axhline(1.0, color=NEUTRAL, linestyle="--", linewidth=0.8, label="noise")
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set_yscale("log")
    axes.set_ylim(0.5, max(1.5 * axes.get_ylim()[1], 2.0 * CLEAR_PEAK))
    axes.set_xlabel("spatial period / mm")
    axes.set_ylabel("power / power of noise")
    legend_above(axes)
    figure.suptitle("Spectrum of the gap along the drives, the highest of each stretch", fontsize=11)
    figure.tight_layout()
    return figure


def bin_means(at: Array, value: Array, bins: int = BINS) -> tuple[Array, Array, Array]:
    """Means (k,) of values over a coordinate: where, mean, standard error; distinct values are bins if they are few."""
    distinct = np.unique(at)
    if len(distinct) <= bins:
        number = np.searchsorted(distinct, at)
    else:
        edges = np.quantile(at, np.linspace(0.0, 1.0, bins + 1))
        number = np.clip(np.searchsorted(edges, at, side="right") - 1, 0, bins - 1)
    rows = [number == k for k in np.unique(number) if np.count_nonzero(number == k) >= LEAST_IN_BIN]
    where = np.array([at[r].mean() for r in rows])
    mean = np.array([value[r].mean() for r in rows])
    error = np.array([value[r].std(ddof=1) / np.sqrt(np.count_nonzero(r)) for r in rows])
    return where, mean, error


def _most_varying_direction(at: Array, gaps: Array) -> Array:
    """Unit vector (3,) along which the gap changes most over a coordinate."""
    means = np.stack([bin_means(at, gaps[:, axis])[1] for axis in range(3)], axis=1)
    if len(means) < 2 or not np.any(means - means.mean(axis=0)):
        means = gaps  # too few of them for means: along which it differs most
    if not np.any(means - means.mean(axis=0)):
        return np.array([1.0, 0.0, 0.0])
    along = np.linalg.svd(means - means.mean(axis=0))[2][0]
    return np.asarray(along * np.sign(along[np.argmax(np.abs(along))]))


def _direction_text(along: Array) -> str:
    axis = int(np.argmax(np.abs(along)))
    if abs(along[axis]) > 0.98:
        return "xyz"[axis]
    return f"({', '.join(f'{round(component, 2) + 0.0:.2f}' for component in along.tolist())})"


def _shade_loads(axes: Axes, hours: Array, payload_kg: Array) -> None:
    low, high = axes.get_ylim()
    axes.fill_between(
        hours, low, high, where=(payload_kg > 0.0).tolist(), step="post", color="black", alpha=0.06, linewidth=0
    )
    axes.set_ylim(low, high)
