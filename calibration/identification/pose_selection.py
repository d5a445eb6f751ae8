"""Selection of the poses to measure, by exchange of candidates for the least predicted uncertainty.

I-optimal: least mean variance of the predicted tool point over the workspace, in the instrument's frame. D-optimal:
largest determinant of the information on the machine's parameters (priors included). A greedy start, then one visit
after the other is exchanged for the best candidate until nothing improves (Fedorov's exchange). The criterion allows
a pose to be chosen more than once: it is then measured again, anew approached.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.identification.prediction import tool_derivatives
from calibration.identification.problem import Layout
from calibration.instruments.readings import Readings
from calibration.machine.description import Machine
from calibration.machine.equilibrium import make_conditions
from calibration.machine.inverse import drives_for
from calibration.model.model import Model
from calibration.model.visits import Visits

Criterion = Literal["I", "D"]
MAX_ROUNDS = 20
MIN_IMPROVEMENT = 1e-6  # relative improvement below which the exchange stops

Instrument = Callable[[Visits], Sequence[Readings]]


@dataclass(frozen=True)
class PlannedLoad:
    """A load of a planned campaign: a payload, and a known force in the machine frame at a point of the platform."""

    mass_kg: float = 0.0
    centre_of_mass_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    force_n: tuple[float, float, float] = (0.0, 0.0, 0.0)
    force_point_m: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class CampaignForecast:
    """A planned campaign and its forecast: RMS standard uncertainty of the tool over the workspace.

    tool (n, 6): poses, each measured once under every load; u_position_m of the tool point (root of the sum over
    coordinates), u_orientation_rad; rows (n,): of the candidates.
    """

    tool: Array
    rows: NDArray[np.intp]
    u_position_m: float
    u_orientation_rad: float


def reachable(machine: Machine, unit: Array) -> Array:
    """Poses (n, 6) of the tool at points (m, k) of the unit cube of the commanded coordinates, within the travel."""
    low, high = machine.commanded_limits.T
    tool = np.zeros((len(unit), 6))
    tool[:, machine.commanded] = low + (high - low) * unit
    drives, _ = drives_for(machine, machine.nominal, tool)
    inside = np.all((drives >= machine.travel[:, 0]) & (drives <= machine.travel[:, 1]), axis=1)
    return tool[inside]


def workspace_poses(machine: Machine, count: int, seed: int) -> Array:
    """Tool poses (count, 6) spread evenly over the reachable workspace (scrambled Sobol points)."""
    exponent = int(np.ceil(np.log2(max(count, 2))))
    for more in range(5):
        sobol = qmc.Sobol(machine.commanded.size, seed=np.random.default_rng(seed))
        tool_poses = reachable(machine, sobol.random_base2(exponent + more))
        if len(tool_poses) >= count:
            return tool_poses[:count]
    raise InputError(f"machine {machine.name}: hardly any of its workspace is within the drives' travel; check both")


def grid_poses(machine: Machine, count: int) -> Array:
    """The largest regular grid of at most `count` tool poses over the workspace, edges included, that is reachable."""
    per_axis = [1] * machine.commanded.size
    while np.prod(per_axis) // min(per_axis) * (min(per_axis) + 1) <= count:
        per_axis[per_axis.index(min(per_axis))] += 1
    axes = [np.linspace(0.0, 1.0, k) if k > 1 else np.array([0.5]) for k in per_axis]
    return reachable(machine, np.stack([a.ravel() for a in np.meshgrid(*axes, indexing="ij")], axis=1))


def candidate_poses(machine: Machine, count: int, seed: int) -> Array:
    """Tool poses to choose from: the corners of the workspace, points on its faces, points inside."""
    rng = np.random.default_rng(seed)
    size = machine.commanded.size
    corners = np.array(np.meshgrid(*[[0.0, 1.0]] * size)).reshape(size, -1).T
    inside = qmc.Sobol(size, seed=rng).random_base2(int(np.ceil(np.log2(max(count, 2)))))
    faces = inside.copy()
    faces[np.arange(len(faces)), rng.integers(size, size=len(faces))] = rng.integers(2, size=len(faces))
    return reachable(machine, np.vstack([corners, faces[:count], inside[:count]]))


def visits_at(machine: Machine, tool: Array, loads: Sequence[PlannedLoad]) -> Visits:
    """Visits of tool poses (n, 6) under every load, load by load, at the reference temperature."""
    drives, pose = drives_for(machine, machine.nominal, tool, make_conditions(machine, len(tool)).without_loads())
    n, k = len(tool), len(loads)
    visits = Visits.at_reference_temperature(
        machine,
        np.tile(drives, (k, 1)),
        np.tile(pose, (k, 1)),
        np.repeat([load.mass_kg for load in loads], n),
        np.repeat([load.centre_of_mass_m for load in loads], n, axis=0),
    )
    force, point = (np.repeat([getattr(load, f) for load in loads], n, axis=0) for f in ("force_n", "force_point_m"))
    return replace(visits, forces=((force, point),)) if np.any(force) else visits


@dataclass(frozen=True)
class Selection:
    """Information of candidate poses and the uncertainty that would remain, linearised at given deviations.

    tool (n, 6): candidates; rows (n, m, u): whitened derivatives of each candidate's readings, under all loads, with
    the scaled unknowns; position_gram (u, u): mean over the workspace of the predicted tool point's squared
    derivatives; orientation_gram (u, u): likewise of its orientation.
    """

    tool: Array
    rows: Array
    position_gram: Array
    orientation_gram: Array
    parameters: int

    @classmethod
    def of(
        cls,
        model: Model,
        tool: Array,
        loads: Sequence[PlannedLoad],
        instrument: Instrument,
        over: Visits,
        theta: Array | None = None,
    ) -> Selection:
        """Prepare a selection from tool poses (n, 6), each to be measured under every load.

        instrument: the readings (values do not matter) that one visit of each row gives; over: visits over which
        prediction matters; theta (p,): deviations at which to look (a draw within the tolerances shows internal
        forces).
        """
        candidates = visits_at(model.machine, tool, loads)
        readings = tuple(instrument(candidates))
        layout = Layout.of(model, readings)
        values = np.zeros(layout.size)
        if theta is not None:
            values[: len(model.parameters)] = theta
        predicted = tool_derivatives(model, layout, readings, values, over)
        aim, turn = (
            np.einsum("niu,niv->uv", d * layout.sigma, d * layout.sigma) / len(over)
            for d in (predicted.position, predicted.orientation)
        )
        by_visit = _rows_by_visit(model, layout, readings, values, candidates)
        rows = by_visit.reshape(len(loads), len(tool), -1, layout.size).transpose(1, 0, 2, 3)
        return cls(tool, rows.reshape(len(tool), -1, layout.size), aim, turn, len(model.parameters))

    def forecast(self, rows: NDArray[np.intp]) -> CampaignForecast:
        """Forecast for measuring some candidates."""
        covariance = np.linalg.inv(self._information(rows))
        position, orientation = (
            float(np.sum(covariance * self.position_gram)),
            float(np.sum(covariance * self.orientation_gram)),
        )
        return CampaignForecast(self.tool[rows], rows, float(np.sqrt(position)), float(np.sqrt(orientation)))

    def forecast_all(self) -> CampaignForecast:
        """Forecast for measuring every candidate once."""
        return self.forecast(np.arange(len(self.rows)))

    def select(self, count: int, criterion: Criterion = "I") -> CampaignForecast:
        """The best `count` candidates found; InputError if there are no candidates."""
        if not len(self.rows) or count < 1:
            raise InputError("poses: nothing to choose from; check workspace, travel and count")
        chosen: list[int] = []
        covariance = np.eye(self.position_gram.shape[0])
        for _ in range(count):
            best = int(np.argmax(self._gain(covariance, criterion)))
            covariance = _covariance_after(covariance, self.rows[best])
            chosen.append(best)
        score = self._score(np.array(chosen), criterion)
        for _ in range(MAX_ROUNDS):
            before = score
            for place in range(count):
                rest = np.array(chosen[:place] + chosen[place + 1 :], dtype=np.intp)
                without = np.asarray(np.linalg.inv(self._information(rest)), dtype=np.float64)
                chosen[place] = int(np.argmax(self._gain(without, criterion)))
            score = self._score(np.array(chosen), criterion)
            if before - score < MIN_IMPROVEMENT * abs(before):
                break
        return self.forecast(np.sort(np.array(chosen)))

    def _information(self, rows: NDArray[np.intp]) -> Array:
        stacked = self.rows[rows].reshape(-1, self.rows.shape[2])
        return np.asarray(np.eye(self.rows.shape[2]) + stacked.T @ stacked)

    def _score(self, rows: NDArray[np.intp], criterion: Criterion) -> float:
        """The criterion to minimise: predicted variance, or minus the log determinant of the information."""
        covariance = np.linalg.inv(self._information(rows))
        if criterion == "I":
            return float(np.sum(covariance * self.position_gram))
        return float(np.linalg.slogdet(covariance[: self.parameters, : self.parameters])[1])

    def _gain(self, covariance: Array, criterion: Criterion) -> Array:
        """Gain (n,) of adding each candidate, by the matrix inversion lemma."""
        spread = self.rows @ covariance
        inner = spread @ self.rows.transpose(0, 2, 1) + np.eye(self.rows.shape[1])
        if criterion == "I":
            weighted = spread @ self.position_gram @ spread.transpose(0, 2, 1)
            return np.asarray(np.trace(np.linalg.solve(inner, weighted), axis1=1, axis2=2))
        p = self.parameters
        block = covariance[:p, :p]
        part = spread[:, :, :p]
        shrunk = inner - part @ np.linalg.solve(block, part.transpose(0, 2, 1))
        return np.asarray(np.linalg.slogdet(inner)[1] - np.linalg.slogdet(shrunk)[1])


def _covariance_after(covariance: Array, rows: Array) -> Array:
    """Covariance (u, u) after more rows (m, u)."""
    spread = rows @ covariance
    inner = spread @ rows.T + np.eye(len(rows))
    return np.asarray(covariance - spread.T @ np.linalg.solve(inner, spread))


def _rows_by_visit(model: Model, layout: Layout, readings: Sequence[Readings], values: Array, visits: Visits) -> Array:
    """Whitened derivatives (n, m, u) of what is read at each visit, filled with zeros where less is read."""
    poses = model.predict(values[: len(model)], visits, visits.target_m)
    per_visit: list[list[Array]] = [[] for _ in range(len(visits))]
    for part, instrument_columns in zip(readings, layout.instrument_slices, strict=True):
        needed = part.visit_indices()
        if needed.shape[1] != 1:
            raise InputError(
                "poses: distances between two poses cannot be planned pose by pose; use a ball on the base"
            )
        compared = part.compare(poses, needed, values[instrument_columns])
        full = np.zeros((len(part), part.width, layout.size))
        full[:, :, : len(model)] = compared.by_model
        full[:, :, instrument_columns] = compared.by_own
        for visit, rows in zip(needed[:, 0], full, strict=True):
            per_visit[visit].append(rows)
    stacked = [np.concatenate(rows) for rows in per_visit]
    out = np.zeros((len(visits), max(len(rows) for rows in stacked), layout.size))
    for visit, rows in enumerate(stacked):
        out[visit, : len(rows)] = rows
    return out * layout.sigma
