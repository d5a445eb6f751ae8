"""The machine of a measurement folder at the point where its readings are linear."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.base.frame import Frame
from calibration.identification.estimators import identify
from calibration.identification.problem import Layout
from calibration.instruments.readings import Readings
from calibration.instruments.tool_coordinates import BOWL
from calibration.machine.description import COORDINATES
from calibration.model.model import Model, Poses
from calibration.model.parameters import ParameterSet
from calibration.recording.measurement_folder import MeasuredMachine

STIFFNESS_LIMIT_SIGMA = 3.0
FRAME = "frame."


@dataclass(frozen=True)
class FolderFit:
    """Unknowns (u) by `layout`, at values (u,) of those that are fitted, the others nominal.

    fitted (u,): what the calibration varies: the kinds of the folder's former fit and the frame of an instrument, where
    there was such a fit; else everything. used (v,): visits that were read; poses (v); local: rows of these, (r, 1) or
    (r, 2) an instrument. residual (r, w) and columns (r, w, u), whitened, an instrument: measured minus modelled,
    extrapolated linearly to nominal values, and derivatives in SI units.
    """

    layout: Layout
    values: Array
    fitted: NDArray[np.bool_]
    used: NDArray[np.intp]
    poses: Poses
    local: tuple[NDArray[np.intp], ...]
    residual: tuple[Array, ...]
    columns: tuple[Array, ...]

    @property
    def frame(self) -> Frame:
        """From the machine's frame to the instrument's."""
        increment = np.zeros(6)
        for i, name in enumerate(self.layout.names):
            if name.startswith(FRAME):
                increment[[3, 4, 5, 0, 1, 2][COORDINATES.index(name.removeprefix(FRAME))]] = self.values[i]
        return Frame(np.eye(3), np.zeros(3)).with_increment(increment)

    @property
    def bowl_m(self) -> float:
        """Depth of a touched bed."""
        names = self.layout.names
        return float(self.values[names.index(BOWL)]) if BOWL in names else 0.0


def fit_folder(measured: MeasuredMachine, readings: Sequence[Readings]) -> FolderFit:
    """The most likely values of what is fitted, and all readings linear there. InputError where a visit has no pose."""
    model = Model(measured.parameters())
    layout = Layout.of(model, readings)
    needed = [part.visit_indices() for part in readings]
    used = np.unique(np.concatenate([visits.ravel() for visits in needed]))
    local = tuple(np.searchsorted(used, visits) for visits in needed)
    fitted, values = _fitted(measured, layout)
    visits = measured.visits.take(used)
    poses = model.predict(values[: len(model)], visits)
    if not np.all(poses.equilibrium.converged):
        number = measured.number[used[int(np.argmin(poses.equilibrium.converged))]]
        raise InputError(
            f"{measured.file.name}: the model finds no pose for visit {number:g}; check units, drive coordinates and "
            "that machine.toml fits the machine"
        )
    residual, columns = [], []
    for part, rows, own in zip(readings, local, layout.instrument_slices, strict=True):
        compared = part.compare(poses, rows, values[own])
        full = np.zeros((*compared.residual.shape, layout.size))
        full[:, :, : len(model)], full[:, :, own] = compared.by_model, compared.by_own
        columns.append(full)
        residual.append(full @ values - compared.residual)
    return FolderFit(layout, values, fitted, used, poses, local, tuple(residual), tuple(columns))


def _fitted(measured: MeasuredMachine, layout: Layout) -> tuple[NDArray[np.bool_], Array]:
    """Which unknowns (u,) are fitted, and the values (u,) of all: zero of those that are not."""
    former = measured.file.former
    parameters = measured.parameters() if former is None else ParameterSet.of(measured.machine, former.unknowns)
    readings = measured.readings(instrument_unknowns=former is None)
    fit = identify(Model(parameters), measured.visits, readings)
    found = dict(zip(fit.layout.names, fit.unknowns.tolist(), strict=True))
    values = np.array([found.get(name, 0.0) for name in layout.names])
    # A strong effect can drive the stiffness to any value; the point of linearisation has to remain plausible.
    limit = np.where(
        [name.startswith("ln_stiffness.") for name in layout.names], STIFFNESS_LIMIT_SIGMA * layout.sigma, np.inf
    )
    return np.array([name in found for name in layout.names]), np.clip(values, -limit, limit)
