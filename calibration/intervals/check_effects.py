"""Effects of the diagnosis' catalogue in a check: poses are chosen for what they would show of these, too.

A check has one payload and one side of approach. What it can then show of the catalogue beside the watched changes: a
drive that goes along a curve (errors of its screw), parts that grow (heat), struts and guides that are softer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.polynomial.legendre import Legendre

from calibration.base.arrays import Array
from calibration.intervals.check_design import CheckReadings
from calibration.intervals.check_estimate import CheckDesign
from calibration.intervals.watched import WatchedChanges, drive_offset
from calibration.model.model import Poses
from calibration.model.visits import Visits

CURVES = (2, 3, 4, 5)  # degrees; the straight ones are the drive's offset and scale
WARMER_K = 1.0

Predict = Callable[[Visits], Poses]


def with_effects(
    design: CheckDesign,
    readings: CheckReadings,
    predict: Predict,
    visited: Visits,
    workspace: Visits,
    mounting_m: Array,
) -> CheckDesign:
    """A design that watches these effects as well, to choose poses by; it has no priors to judge a check with.

    readings: at the visited poses. mounting_m (s, 3): places of all reflectors on their parts.
    """
    seen, over = _growth(readings, predict, visited, workspace, mounting_m)
    columns, fields, names = [*seen.values()], [*over.values()], [*seen]
    parameters = predict(visited.take(slice(0, 1))).model.parameters
    for drive, name in enumerate(parameters.machine.drive_names):
        offset = _with_reflectors(design, drive_offset(parameters, drive), f"drive_offset.{name}")
        low, high = workspace.drives[:, drive].min(), workspace.drives[:, drive].max()
        for degree in CURVES:
            curve = Legendre.basis(degree, domain=[low, high])
            columns.append(design.by_parameter @ offset * curve(visited.drives[:, drive])[np.repeat(readings.visit, 3)])
            fields.append(design.workspace @ offset * np.repeat(curve(workspace.drives[:, drive]), 3))
            names.append(f"curve_{degree}.{name}")
    for row, parameter in enumerate(parameters.parameters):
        if parameter.kind == "ln_stiffness":
            columns.append(design.by_parameter[:, row])
            fields.append(design.workspace[:, row])
            names.append(parameter.name)
    return _extended(design, np.stack(columns, axis=1), np.stack(fields, axis=1), names)


def _growth(
    readings: CheckReadings, predict: Predict, visited: Visits, workspace: Visits, mounting_m: Array
) -> tuple[dict[str, Array], dict[str, Array]]:
    """What a part that is warmer does to the readings (3 r,) and to the tool over the workspace (3 g,), by sensor."""
    before, tool_m = _places(readings, predict(visited), mounting_m), predict(workspace).tool_m()
    seen, over = {}, {}
    for sensor in visited.temperatures_c:
        place = _places(readings, predict(_warmer(visited, sensor)), mounting_m)
        seen[f"growth.{sensor}"] = readings.whitened(place - before)
        over[f"growth.{sensor}"] = (predict(_warmer(workspace, sensor)).tool_m() - tool_m).ravel()
    return seen, over


def _warmer(visits: Visits, sensor: str) -> Visits:
    return replace(visits, temperatures_c={**visits.temperatures_c, sensor: visits.temperatures_c[sensor] + WARMER_K})


def _places(readings: CheckReadings, poses: Poses, mounting_m: Array) -> Array:
    """Where each reading's reflector is (r, 3)."""
    out = np.empty((len(readings.visit), 3))
    for smr in np.unique(readings.smr):
        rows = np.flatnonzero(readings.smr == smr)
        out[rows] = poses.reflector_m(int(smr), mounting_m[smr])[readings.visit[rows]]
    return out


def _with_reflectors(design: CheckDesign, offset: Array, name: str) -> Array:
    """The design's own column of an offset, which takes reflectors along; a leg carries none."""
    if name in design.watched.names:
        return design.watched.combination[:, design.watched.names.index(name)]
    return np.concatenate([offset, np.zeros(design.by_parameter.shape[1] - len(offset))])


def _extended(design: CheckDesign, columns: Array, fields: Array, names: list[str]) -> CheckDesign:
    size, watched = design.by_parameter.shape[1], design.watched
    combination = np.zeros((size + len(names), len(watched.names) + len(names)))
    combination[:size, : len(watched.names)] = watched.combination
    combination[size:, len(watched.names) :] = np.eye(len(names))
    none = np.zeros((size + len(names), size + len(names)))
    return replace(
        design,
        by_parameter=np.concatenate([design.by_parameter, columns], axis=1),
        workspace=np.concatenate([design.workspace, fields], axis=1),
        watched=WatchedChanges((*watched.names, *names), combination),
        prior=none,
        reference=none,
    )
