"""The parts of a twin: a fitted machine, its effects, and the campaign that defines their basis sets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.base.frame import Frame
from calibration.diagnosis.channels import Channels
from calibration.diagnosis.effect_inputs import inputs_of_readings
from calibration.diagnosis.observed_model import ObservedModel
from calibration.diagnosis.twin.answers import RecordedAnswers
from calibration.effects.api import CurvePoint, Departure, EffectInputs
from calibration.effects.columns import Contributions
from calibration.effects.combined_context import CachedContext
from calibration.effects.context import ReadingContext
from calibration.machine import equilibrium
from calibration.machine.description import PARTS, Machine
from calibration.model.model import Model, Poses, SystematicUncertainties
from calibration.model.parameters import ParameterSet
from calibration.model.visits import Visits
from calibration.reduction.grouped_readings import mean_by_visit

NEIGHBOURS = 4  # poses of the campaign from which a search starts, the nearest first
ROWS_AT_ONCE = 4096
ALL_SYSTEMATIC = SystematicUncertainties(1.0, 1.0, dict.fromkeys(PARTS, 1.0), dict.fromkeys(PARTS, 1.0))


@dataclass(frozen=True)
class TwinEffect:
    """An effect of the twin: its place, columns of its basis sets or of a curve's tangent, departures from them, the
    coefficients of all of these.

    answers: periods and onsets of the campaign that its basis sets were built with. column_rms: of each column over the
    campaign's readings (`rms_of_columns`), by which a file that was written with other basis sets is recognised.
    """

    effect: str
    place: int
    columns: tuple[int, ...]
    curve: CurvePoint | None
    departures: tuple[Departure, ...]
    coefficients: tuple[float, ...]
    answers: RecordedAnswers
    column_rms: tuple[float, ...]


def rms_of_columns(contributions: Sequence[Contributions]) -> tuple[float, ...]:
    """RMS over the readings of each column's functions, its channels taken together."""
    return tuple(float(np.sqrt(sum(np.mean(shape**2) for _, shape in contribution))) for contribution in contributions)


@dataclass(frozen=True)
class FittedMachine:
    """A machine as fitted.

    values (u,): of the unknowns of `full_model`; frame: from the machine's to the station's; mounted_m (smrs, 3):
    positions of the reflectors on their parts, of nests in the machine's frame.
    """

    values: Array
    frame: Frame
    mounted_m: Array


def full_model(machine: Machine) -> Model:
    """The model with all unknowns of a machine free; those that a campaign did not fit are zero."""
    return Model(ParameterSet.of(machine), ALL_SYSTEMATIC)


def visits_of(machine: Machine, context: ReadingContext) -> Visits:
    """One visit per reading; a sensor that was not read has the reference temperature."""
    n = len(context)
    reference = np.full(n, machine.reference_temperature_c)
    temperatures = {s: context.temperatures_c.get(s, reference) for s in machine.sensors.values()}
    return Visits(context.drives, np.zeros((n, 6)), context.payload_kg, context.payload_com_m, temperatures)


def reflector_positions_m(poses: Poses, mounted_m: Array, smr: NDArray[np.intp], row: NDArray[np.intp]) -> Array:
    """Positions (n, 3) of reflectors smr (n,) at poses row (n,), machine's frame, without effects."""
    out = np.empty((len(smr), 3))
    for i in np.unique(smr):
        rows = np.flatnonzero(smr == i)
        out[rows] = poses.reflector_m(int(i), mounted_m[i])[row[rows]]
    return out


@dataclass(frozen=True)
class TwinCampaign:
    """The readings (n) over which the effects' basis sets are defined, and the machine at which they are linear.

    smr (n,); visit (n,): row of the poses, -1 for nests; equilibrium_poses (v, 6): of the visits; linearised_at: the
    machine for which channels and forces of the effects are computed, as when the coefficients were found.
    """

    machine: Machine
    context: ReadingContext
    smr: NDArray[np.intp]
    visit: NDArray[np.intp]
    equilibrium_poses: Array
    linearised_at: FittedMachine

    @cached_property
    def model(self) -> Model:
        """Of the machine."""
        return full_model(self.machine)

    @cached_property
    def cached_context(self) -> CachedContext:
        """The context with its history-dependent quantities cached."""
        return CachedContext(self.context)

    @cached_property
    def visits(self) -> Visits:
        """The visits (v), at the mean temperatures of their readings."""
        rows = np.flatnonzero(self.visit >= 0)
        _, first, visit_index = np.unique(self.visit[rows], return_index=True, return_inverse=True)
        all_visits = visits_of(self.machine, self.context)
        heads = all_visits.take(rows[first])
        mean = {name: mean_by_visit(t[rows], visit_index) for name, t in all_visits.temperatures_c.items()}
        return Visits(heads.drives, self.equilibrium_poses, heads.payload_kg, heads.payload_com_m, mean)

    @cached_property
    def inputs(self) -> EffectInputs:
        """The inputs of effects on the campaign's readings, without periods and onsets."""
        poses = self.poses(self.linearised_at, self.visits)
        return self.channels_and_inputs(poses, self.context, self.smr, np.maximum(self.visit, 0))[1]

    def poses(self, fitted_machine: FittedMachine, visits: Visits) -> Poses:
        """Poses of visits, searched from the nearest ones of the campaign. Raises InputError if there is none."""
        with np.errstate(all="ignore"):
            start, *others = self._initial_poses(visits)
            poses = self.model.predict(fitted_machine.values, visits, start)
            for other in others:
                if np.all(poses.equilibrium.converged):
                    break
                start = np.where(poses.equilibrium.converged[:, None], start, other)
                poses = self.model.predict(fitted_machine.values, visits, start)
        if np.all(poses.equilibrium.converged):
            return poses
        raise InputError("twin: the model finds no equilibrium for a moment; check the drive coordinates")

    def channels_and_inputs(
        self, poses: Poses, context: ReadingContext, smr: NDArray[np.intp], row: NDArray[np.intp]
    ) -> tuple[Channels, EffectInputs]:
        """Channels and inputs for reflectors smr (n,) at poses row (n,) of the machine at which effects are linear."""
        on_floor = np.array([s.on == "floor" for s in self.machine.smrs])[smr]
        frame, mounted_m = self.linearised_at.frame, self.linearised_at.mounted_m
        observed = ObservedModel(
            machine=self.machine,
            context=context,
            smr=smr,
            visit=np.where(on_floor, -1, row),
            poses=poses,
            frame=frame,
            mounted_m=mounted_m,
            position_m=frame.to_station(reflector_positions_m(poses, mounted_m, smr, row)),
        )
        channels = Channels(observed)
        return channels, inputs_of_readings(observed, channels, lambda *_: [], lambda *_: [])

    def _initial_poses(self, visits: Visits) -> list[Array]:
        """Starting poses (v, 6) for the search, the best first."""
        campaign_drives = self.visits.drives
        span = np.maximum(np.ptp(campaign_drives, axis=0), 1e-9)
        count = min(NEIGHBOURS, len(campaign_drives))
        nearest = np.empty((len(visits), count), dtype=np.intp)
        for first in range(0, len(visits), ROWS_AT_ONCE):
            chunk = visits.drives[first : first + ROWS_AT_ONCE] / span
            squared_distance = np.sum((chunk[:, None] - campaign_drives / span) ** 2, axis=2)
            nearest[first : first + ROWS_AT_ONCE] = np.argsort(squared_distance, axis=1, kind="stable")[:, :count]
        middle = np.broadcast_to(equilibrium.workspace_middle(self.machine), (len(visits), 6))
        return [*(self.equilibrium_poses[nearest[:, k]] for k in range(count)), middle]
