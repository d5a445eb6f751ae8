"""What a twin is made of: a fitted machine, the effects that were added, the campaign that defines their forms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.base.frame import Frame
from calibration.diagnosis.channels import Channels
from calibration.diagnosis.effect_inputs import setting_from
from calibration.diagnosis.linear_model import Seen
from calibration.effects.api import OnCurve, Setting
from calibration.effects.context import Moments, Remembered
from calibration.machine import equilibrium
from calibration.machine.description import PARTS, Machine
from calibration.model.model import Model, Poses, SystematicUncertainties
from calibration.model.parameters import ParameterSet
from calibration.model.visits import Visits

NEIGHBOURS = 4  # poses of the campaign from which a search starts, the nearest first
SEARCHED = 4096  # rows at once
EVERYTHING = SystematicUncertainties(1.0, 1.0, dict.fromkeys(PARTS, 1.0), dict.fromkeys(PARTS, 1.0))


class Asked:
    """Asks and keeps the answers."""

    def __init__(self, ask: Callable[..., Sequence[tuple[float, float]]]) -> None:
        self._ask = ask
        self.answers: tuple[tuple[float, ...], ...] = ()

    def __call__(self, *question: Any) -> Sequence[tuple[float, float]]:
        """The answer."""
        answer = self._ask(*question)
        self.answers = (*self.answers, tuple(float(value) for value, _ in answer))
        return answer


class Told:
    """Gives the answers that were kept, in their order."""

    def __init__(self, answers: tuple[tuple[float, ...], ...]) -> None:
        self._answers = iter(answers)

    def __call__(self, *_question: Any) -> list[tuple[float, float]]:
        """The next answer."""
        return [(value, 1.0) for value in next(self._answers, ())]


@dataclass(frozen=True)
class Added:
    """An effect of the twin: where, which columns of its forms or of which curve's tangent, their coefficients.

    periods_m, onsets_s: what stood out in the campaign when the forms were built, question by question.
    """

    effect: str
    place: int
    columns: tuple[int, ...]
    curve: OnCurve | None
    coefficients: tuple[float, ...]
    periods_m: tuple[tuple[float, ...], ...]
    onsets_s: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Fit:
    """A machine as it was fitted.

    values (u,): of the unknowns of `whole_model`; frame: from the machine's to the station's; mounted_m (smrs, 3):
    places of reflectors on their parts, of nests in the machine's frame.
    """

    values: Array
    frame: Frame
    mounted_m: Array


def whole_model(machine: Machine) -> Model:
    """The model with all unknowns of a machine: whatever a campaign left out of its fit is zero."""
    return Model(ParameterSet.of(machine), EVERYTHING)


def visits_of(machine: Machine, moments: Moments) -> Visits:
    """A visit for each moment; a sensor that is not known reads the reference temperature."""
    n = len(moments)
    reference = np.full(n, machine.reference_temperature_c)
    temperatures = {s: moments.temperatures_c.get(s, reference) for s in machine.sensors.values()}
    return Visits(moments.drives, np.zeros((n, 6)), moments.payload_kg, moments.payload_com_m, temperatures)


def places_m(machine: Machine, poses: Poses, mounted_m: Array, smr: NDArray[np.intp], row: NDArray[np.intp]) -> Array:
    """Places (n, 3) of reflectors smr (n,) at poses row (n,), machine's frame, by the model alone."""
    carriers = equilibrium.carriers_of(machine, poses.geometry, poses.visits.drives, poses.conditions)
    out = np.empty((len(smr), 3))
    for i, reflector in enumerate(machine.smrs):
        rows = np.flatnonzero(smr == i)
        at = row[rows]
        if reflector.on == "floor":
            out[rows] = mounted_m[i]
        elif reflector.on == "platform":
            lever = poses.equilibrium.rotation[at] @ mounted_m[i]
            out[rows] = poses.equilibrium.position_m[at] + lever * poses.conditions.factors["platform"][at, None]
        else:
            out[rows] = carriers[reflector.drive].position(mounted_m[i]).T[at]
    return out


@dataclass(frozen=True)
class Campaign:
    """The readings (n) by which the effects' forms are defined, and the machine at which they are linear.

    smr (n,); visit (n,): row of rest, -1 for nests; rest (v, 6): poses of the visits; at: the machine by which
    channels and forces of the effects are computed, as they were when the coefficients were found.
    """

    machine: Machine
    moments: Moments
    smr: NDArray[np.intp]
    visit: NDArray[np.intp]
    rest: Array
    at: Fit

    @cached_property
    def model(self) -> Model:
        """Of the machine."""
        return whole_model(self.machine)

    @cached_property
    def memory(self) -> Remembered:
        """The moments with their memory."""
        return Remembered(self.moments)

    @cached_property
    def visits(self) -> Visits:
        """The visits (v), at the mean temperatures of their readings."""
        rows = np.flatnonzero(self.visit >= 0)
        _, first, of = np.unique(self.visit[rows], return_index=True, return_inverse=True)
        every = visits_of(self.machine, self.moments)
        heads, count = every.take(rows[first]), np.bincount(of)
        mean = {name: np.bincount(of, t[rows]) / count for name, t in every.temperatures_c.items()}
        return Visits(heads.drives, self.rest, heads.payload_kg, heads.payload_com_m, mean)

    @cached_property
    def setting(self) -> Setting:
        """What effects know of the campaign's readings; periods and onsets are for others to tell."""
        poses = self.poses(self.at, self.visits)
        return self.linear_at(poses, self.moments, self.smr, np.maximum(self.visit, 0))[1]

    def poses(self, fit: Fit, visits: Visits) -> Poses:
        """Poses of visits, searched from those of the campaign that are nearest. InputError where there is none."""
        with np.errstate(all="ignore"):
            start, *others = self._starts(visits)
            poses = self.model.predict(fit.values, visits, start)
            for other in others:
                if np.all(poses.equilibrium.converged):
                    break
                start = np.where(poses.equilibrium.converged[:, None], start, other)
                poses = self.model.predict(fit.values, visits, start)
        if np.all(poses.equilibrium.converged):
            return poses
        raise InputError("twin: the model finds no equilibrium for a moment; check the drive coordinates")

    def linear_at(
        self, poses: Poses, moments: Moments, smr: NDArray[np.intp], row: NDArray[np.intp]
    ) -> tuple[Channels, Setting]:
        """Channels and setting of reflectors smr (n,) at poses row (n,) of the machine at which effects are linear."""
        on_floor = np.array([s.on == "floor" for s in self.machine.smrs])[smr]
        seen = Seen(
            self.machine, moments, smr, np.where(on_floor, -1, row), poses, self.at.frame, self.at.mounted_m,
            self.at.frame.to_station(places_m(self.machine, poses, self.at.mounted_m, smr, row)),
        )  # fmt: skip
        channels = Channels(seen)
        return channels, setting_from(seen, channels, Told(()), Told(()))

    def _starts(self, visits: Visits) -> list[Array]:
        """Starts (v, 6) for the search, the best first."""
        known = self.visits.drives
        span = np.maximum(np.ptp(known, axis=0), 1e-9)
        count = min(NEIGHBOURS, len(known))
        nearest = np.empty((len(visits), count), dtype=np.intp)
        for first in range(0, len(visits), SEARCHED):
            some = visits.drives[first : first + SEARCHED] / span
            apart = np.sum((some[:, None] - known / span) ** 2, axis=2)
            nearest[first : first + SEARCHED] = np.argsort(apart, axis=1, kind="stable")[:, :count]
        middle = np.broadcast_to(equilibrium.workspace_middle(self.machine), (len(visits), 6))
        return [*(self.rest[nearest[:, k]] for k in range(count)), middle]
