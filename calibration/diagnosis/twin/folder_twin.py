"""The twin of a measurement folder: its machine and the effects that were found, fitted together to all readings.

Everything is linear about the fit of the machine, as in the diagnosis. With the effects in the model the machine's
unknowns are no longer bent by what they do: that is what the twin is for, and its predictions of the readings show it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.findings.withheld_blocks import gap_field, gap_figures, regions, withheld_differences
from calibration.diagnosis.folder_rows import FolderRows
from calibration.diagnosis.linear_folder import LinearFolder
from calibration.diagnosis.ranking import Cause, as_found, columns_of_cause, include_cause
from calibration.diagnosis.twin.score import TwinScore
from calibration.identification.problem import Layout
from calibration.instruments.readings import Readings
from calibration.instruments.tool_coordinates import ToolCoordinates
from calibration.recording.measurement_folder import COLUMNS, MeasuredMachine


@dataclass(frozen=True)
class FolderTwin:
    """A measured machine with its effects.

    unknowns: value, standard uncertainty and unit of each unknown of machine and instrument that was fitted, by name.
    effects: names and places of what was fitted beside them. of (r,): what each number read is, for people; unit (r,);
    sigma (r,): stated of it; read (r,), and predicted by_machine (r,), as that fits without effects, and by_twin (r,).
    """

    unknowns: dict[str, tuple[float, float, str]]
    effects: tuple[tuple[str, str], ...]
    of: tuple[str, ...]
    unit: tuple[str, ...]
    sigma: Array
    read: Array
    by_machine: Array
    by_twin: Array


def twin_of_folder(linear: LinearFolder, likelihood: MarginalLikelihood, causes: Sequence[Cause]) -> FolderTwin:
    """The twin with the causes of a diagnosis; likelihood: without them."""
    with_causes = _including(likelihood, causes)
    own = _contributions_of(likelihood, causes)
    columns = np.concatenate([linear.columns, own], axis=2)
    flat = columns.reshape(-1, columns.shape[2])
    # Posterior mean and covariance of coefficients whose priors are standard normal: A' C^-1 y, 1 - A' C^-1 A.
    c = flat.T @ with_causes.weighted_residual.ravel()
    covariance = np.eye(len(c)) - flat.T @ with_causes.apply(columns).reshape(len(flat), -1)
    u = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    alone = linear.columns.reshape(len(flat), -1).T @ likelihood.weighted_residual.ravel()
    readings = linear.measured.readings()
    units = {unknown.name: unknown.unit for unknown in Layout.of(linear.poses.model, readings).unknowns}
    first = np.flatnonzero(linear.rows.is_first)
    return FolderTwin(
        unknowns={
            name: (float(c[k] * sigma), float(u[k] * sigma), units[name])
            for k, (name, sigma) in enumerate(zip(linear.names[: len(linear.sigma)], linear.sigma, strict=True))
        },
        effects=tuple((part.effect.name, part.place) for cause in causes for part in cause.parts),
        of=tuple(_name(linear.measured, readings, linear.rows, row) for row in first.tolist()),
        unit=tuple(np.where(linear.rows.turns[first], "rad", "m").tolist()),
        sigma=linear.rows.sigma[first],
        read=linear.rows.value[first],
        by_machine=linear.predicted(linear.residual - linear.columns @ alone)[first, 0],
        by_twin=linear.predicted(linear.residual - columns @ c)[first, 0],
    )


def score_folder_twin(
    linear: LinearFolder, likelihood: MarginalLikelihood, truth_likelihood: MarginalLikelihood, causes: Sequence[Cause]
) -> TwinScore:
    """How well twins that were fitted without a region's readings predict these."""
    region = regions(linear)
    before = withheld_differences(likelihood, region)
    after = withheld_differences(_including(likelihood, causes), region) if causes else before
    figures = gap_figures(gap_field(truth_likelihood, before, after))
    return TwinScore(
        figures if causes else figures.without_effect(),
        int(linear.rows.is_first.sum()),
        linear.rms_sigma(before),
        linear.rms_sigma(after),
    )


def _including(likelihood: MarginalLikelihood, causes: Sequence[Cause]) -> MarginalLikelihood:
    for cause in as_found(causes):
        likelihood = include_cause(likelihood, cause)
    return likelihood


def _contributions_of(likelihood: MarginalLikelihood, causes: Sequence[Cause]) -> Array:
    """Columns (n, w, k) of all causes at all their places, each times its prior standard deviation."""
    out = [columns_of_cause(likelihood, cause) for cause in as_found(causes)]
    return np.concatenate([np.zeros((*likelihood.weighted_residual.shape, 0)), *out], axis=2)


def _name(measured: MeasuredMachine, readings: Sequence[Readings], rows: FolderRows, row: int) -> str:
    """What the number of a row is, for people."""
    part = readings[int(rows.instrument[row])]
    _, what = measured.line_of(part, int(rows.reading[row]))
    return f"{what}, {COLUMNS[part.coordinates[rows.entry[row]]]}" if isinstance(part, ToolCoordinates) else what
