"""Measured errors at the verification poses beside the predicted ones over the workspace, all with one scale."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from calibration.base.arrays import Array
from calibration.compensation.error_map import ErrorMap
from calibration.identification.fit import Fit
from calibration.identification.prediction import predict_poses
from calibration.reduction.reduction import Reduction
from pkm_rig.report.notation import literal
from pkm_rig.report.pictures import AFTER, BEFORE, round_scale

ARROW_SHARE = 0.09  # of the map's width, of an arrow as long as the scale


class Field(NamedTuple):
    """Errors (n, 2) in m at places (n, 2) in m, with a name; rms_m where it is not that of the arrows.

    hatched_m (h, 2): centres of cells of the size cell_m in which the prediction is too uncertain.
    """

    name: str
    at_m: Array
    error_m: Array
    colour: str
    rms_m: float | None = None
    hatched_m: Array = np.zeros((0, 2))
    cell_m: tuple[float, float] = (0.0, 0.0)

    def stated_rms_m(self) -> float:
        """RMS length that stands above the map."""
        if self.rms_m is not None or not len(self.error_m):
            return self.rms_m or 0.0
        return float(np.sqrt(np.mean(np.sum(self.error_m**2, axis=1))))


def error_fields(predicted: ErrorMap, reduction: Reduction | None, payload: int) -> list[Field]:
    """Predicted before and after and, with a reduction, measured before and after, of one payload."""
    fields = []
    across = [np.unique(predicted.target_m[:, k]) for k in range(2)]
    cell_m = (float(across[0][1] - across[0][0]), float(across[1][1] - across[1][0]))
    hatched_m = predicted.target_m[predicted.is_uncertain]
    for when, errors, colour in (("before", predicted.before_m, BEFORE), ("after", predicted.after_m, AFTER)):
        if reduction is not None:
            rows = reduction.rows(f"verification_{when}", payload)
            at = reduction.observations.visits.target_m[rows, :2]
            fields.append(Field(f"measured, {when}", at, reduction.errors(rows)[0][:, :2], colour))
        fields.append(Field(f"predicted, {when}", predicted.target_m, errors, colour, None, hatched_m, cell_m))
    return fields


def pose_fields(fit: Fit, reduction: Reduction, payload: int) -> list[tuple[str, Array, Array]]:
    """Measured and predicted errors (n, 3) in m at the verification poses (n, 3), before and after, by name.

    Predicted by the identified model from where the drives were commanded to: where the host corrects there is no table
    whose correction could be shown over the workspace.
    """
    fields = []
    for when in ("before", "after"):
        rows = reduction.rows(f"verification_{when}", payload)
        visits = reduction.observations.visits.take(rows)
        predicted = reduction.report.tool_error(predict_poses(fit, reduction.report, visits), visits.target_m)[0]
        at = visits.target_m[:, :3]
        fields += [(f"measured, {when}", at, reduction.errors(rows)[0]), (f"predicted, {when}", at, predicted)]
    return fields


def pose_maps(found: Sequence[tuple[str, Array, Array]], moves: Sequence[int], title: str) -> list[Figure]:
    """Arrows of such fields over the first two coordinates that the tool moves in, and over first and third; one scale.

    None for a tool that moves in one direction only. Above each map stands the RMS of the whole error, not of what is
    seen in it.
    """
    key_m = round_scale(max(float(np.max(np.linalg.norm(error, axis=1), initial=0.0)) for _, _, error in found))
    figures = []
    for pair in [(moves[0], other) for other in moves[1:]]:
        fields = [
            Field(
                name, at[:, pair], error[:, pair], BEFORE if name.endswith("before") else AFTER,
                float(np.sqrt(np.mean(np.sum(error**2, axis=1)))),
            )
            for name, at, error in found
        ]  # fmt: skip
        names = ("xyz"[pair[0]], "xyz"[pair[1]])
        figures.append(error_maps(fields, f"{title}, {names[0]}-{names[1]}", key_m=key_m, names=names))
    return figures


def error_maps(
    fields: Sequence[Field], title: str, *, key_m: float | None = None, names: tuple[str, str] = ("x", "y")
) -> Figure:
    """Arrows of several fields with one scale, which is stated once; no arrow leaves its panel.

    key_m: length of the arrow that states the scale; left out, by the largest error. names: of the two coordinates.
    Hatched where U (k = 2) of the prediction exceeds the error that is corrected.
    """
    across = min(2, len(fields))
    down = -(-len(fields) // across)
    figure = Figure(figsize=(10.0 if across == 2 else 5.4, 4.3 * down + 0.5))
    key_m = key_m or round_scale(max(float(np.max(np.hypot(*f.error_m.T), initial=0.0)) for f in fields))
    places = np.concatenate([f.at_m for f in fields])
    width = float(np.ptp(places[:, 0])) or 1.0
    metres = ARROW_SHARE * width / key_m
    tips = np.concatenate([places, *(f.at_m + f.error_m * metres for f in fields)])
    margin = 0.04 * width
    low, high = tips.min(axis=0) - margin, tips.max(axis=0) + margin
    panels = figure.subplots(down, across, squeeze=False).ravel()
    for axes, field in zip(panels, fields, strict=False):
        _draw(axes, field, metres, names)
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
    for axes in panels[len(fields) :]:
        axes.set_axis_off()
    scale = f"arrow at the top left: {key_m * 1e6:g} µm"
    if any(len(field.hatched_m) for field in fields):
        scale += "; hatched: U (k = 2) exceeds the error"
    figure.suptitle(literal(title) + (f"; {scale}" if across == 2 else f"\n{scale}"), fontsize=11 if across == 2 else 9)
    for axes in panels[: len(fields)]:
        start = (low[0] + margin, high[1] + 0.35 * margin)
        axes.annotate(
            "", xytext=start, xy=(start[0] + key_m * metres, start[1]), annotation_clip=False,
            arrowprops={"arrowstyle": "-|>", "color": "black", "lw": 1.2, "shrinkA": 0.0, "shrinkB": 0.0},
        )  # fmt: skip
    figure.tight_layout(rect=(0.0, 0.0, 1.0, 0.98))
    return figure


def _draw(axes: Axes, field: Field, metres: float, names: tuple[str, str]) -> None:
    width, height = field.cell_m
    for x, y in field.hatched_m.tolist():
        cell = Rectangle((x - 0.5 * width, y - 0.5 * height), width, height, fill=False, hatch="////", linewidth=0.0)
        cell.set_edgecolor("0.7")
        axes.add_patch(cell)
    axes.quiver(
        field.at_m[:, 0], field.at_m[:, 1], field.error_m[:, 0], field.error_m[:, 1],
        color=field.colour, angles="xy", scale_units="xy", scale=1.0 / metres, width=0.004, pivot="tail",
    )  # fmt: skip
    axes.plot(field.at_m[:, 0], field.at_m[:, 1], ".", color="0.55", markersize=2, zorder=0)
    axes.set_title(f"{field.name}: {field.stated_rms_m() * 1e6:.1f} µm RMS", loc="right", fontsize=10)
    axes.set_xlabel(f"{names[0]} / m")
    axes.set_ylabel(f"{names[1]} / m")
    axes.set_aspect("equal")
