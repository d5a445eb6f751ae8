"""The model of a fit: the machine's parameters and what else its poses depend on, and the poses it predicts.

Unknowns of a model, in this order: machine parameters (deviations from nominal), then the systematic ones:
relative error of the payload's mass, error of its centre of mass, errors of the expansion coefficients
and of the temperature sensors. They do not average out over readings, so they are unknowns with priors, not noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from calibration.base.arrays import Array
from calibration.base.rotation import skew
from calibration.machine import equilibrium
from calibration.machine.carriers import Carrier
from calibration.machine.description import PARTS, Geometry, Machine
from calibration.machine.equilibrium import Conditions, Equilibrium
from calibration.machine.sensitivity import Sensitivity
from calibration.model.parameters import ParameterSet
from calibration.model.payload import PayloadEntry
from calibration.model.visits import Visits

PAYLOAD = 1  # its place among the masses of the conditions


@dataclass(frozen=True)
class Unknown:
    """A scalar unknown of a fit: its SI unit ('1' for a ratio) and the standard deviation of its prior."""

    name: str
    unit: str
    sigma: float


@dataclass(frozen=True)
class SystematicUncertainties:
    """Standard uncertainties of quantities common to all poses; zero: taken as known.

    payload_mass relative; payload_com_m; expansion_per_k and temperature_k by part (struts, drives, base, platform).
    """

    payload_mass: float = 0.0
    payload_com_m: float = 0.0
    expansion_per_k: Mapping[str, float] = field(default_factory=dict)
    temperature_k: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def from_declared(
        cls, payloads: Sequence[PayloadEntry], machine: Machine, temperature_k: float = 0.0
    ) -> SystematicUncertainties:
        """The stated uncertainties of payloads (the largest of the list) and of thermal expansion."""
        shares = [p.u_mass_kg / p.mass_kg for p in payloads if p.mass_kg > 0.0]
        return cls(
            payload_mass=max(shares, default=0.0),
            payload_com_m=max(p.u_com_m for p in payloads),
            expansion_per_k=machine.u_expansion_per_k,
            temperature_k=dict.fromkeys(machine.sensors, temperature_k),
        )

    def unknowns(self, planar: bool) -> tuple[Unknown, ...]:
        """Those that are not taken as known."""
        unknowns = [Unknown("payload.mass", "1", self.payload_mass)]
        axes = "xy" if planar else "xyz"
        unknowns += [Unknown(f"payload.com.{axis}", "m", self.payload_com_m) for axis in axes]
        unknowns += [Unknown(f"expansion.{part}", "1/K", self.expansion_per_k.get(part, 0.0)) for part in PARTS]
        unknowns += [Unknown(f"temperature.{part}", "K", self.temperature_k.get(part, 0.0)) for part in PARTS]
        return tuple(u for u in unknowns if u.sigma > 0.0)


@dataclass(frozen=True)
class Model:
    """Machine parameters and systematic unknowns; loads False leaves every load out (rigid baselines)."""

    parameters: ParameterSet
    systematic: SystematicUncertainties = SystematicUncertainties()
    with_loads: bool = True

    @property
    def machine(self) -> Machine:
        """The machine that is modelled."""
        return self.parameters.machine

    @cached_property
    def unknowns(self) -> tuple[Unknown, ...]:
        """All unknowns of the model itself, before those of instruments."""
        machine = [Unknown(p.name, p.unit, p.sigma) for p in self.parameters.parameters]
        return (*machine, *self.systematic.unknowns(self.machine.planar))

    def __len__(self) -> int:
        return len(self.unknowns)

    def column(self, name: str) -> int | None:
        """Column of an unknown, None if it is taken as known."""
        names = [u.name for u in self.unknowns]
        return names.index(name) if name in names else None

    def _value(self, values: Array, name: str) -> float:
        column = self.column(name)
        return 0.0 if column is None else float(values[column])

    def conditions(self, values: Array, visits: Visits) -> Conditions:
        """Loads and thermal factors of visits for values of the unknowns."""
        machine = self.machine
        com = np.array([self._value(values, f"payload.com.{axis}") for axis in "xyz"])
        at = equilibrium.make_conditions(
            machine,
            len(visits),
            visits.temperatures_c,
            visits.payload_kg * (1.0 + self._value(values, "payload.mass")),
            visits.payload_com_m + com,
        )
        factors = {}
        for part in PARTS:
            coefficient, warmth = self.expansion(values, visits, part)
            factors[part] = 1.0 + coefficient * warmth
        at = replace(at, factors=factors, forces=visits.forces)
        return at if self.with_loads else at.without_loads()

    def expansion(self, values: Array, visits: Visits, part: str) -> tuple[float, Array]:
        """Expansion coefficient (1/K) of a part and by how much (v,) it is warmer than the reference, in K."""
        machine = self.machine
        coefficient = machine.expansion_per_k[part] + self._value(values, f"expansion.{part}")
        warmth = visits.temperatures_c[machine.sensors[part]] - machine.reference_temperature_c
        return coefficient, np.asarray(warmth + self._value(values, f"temperature.{part}"))

    def predict(self, values: Array, visits: Visits, start: Array | None = None) -> Poses:
        """Poses of visits; from `start` (v, 6) or the commanded poses."""
        geometry = self.parameters.geometry(values[: len(self.parameters)])
        at = self.conditions(values, visits)
        rest = equilibrium.solve(self.machine, geometry, visits.drives, at, visits.target_m if start is None else start)
        return Poses(self, values, geometry, visits, at, rest)


@dataclass(frozen=True)
class Poses:
    """Predicted poses (v) of a model; rows without an equilibrium are NaN. Derivatives are computed when asked for."""

    model: Model
    values: Array
    geometry: Geometry
    visits: Visits
    conditions: Conditions
    equilibrium: Equilibrium

    @cached_property
    def sensitivity(self) -> Sensitivity:
        """Derivatives at these poses."""
        return Sensitivity.at_equilibrium(
            self.model.machine, self.geometry, self.visits.drives, self.conditions, self.equilibrium
        )

    @cached_property
    def jacobian(self) -> Array:
        """Derivatives (v, 6, u) of position (m) and left rotation increment (rad) with every unknown of the model."""
        model = self.model
        columns = model.parameters.gradient_columns(self.sensitivity)
        columns += [self._systematic_column(u.name) for u in model.unknowns[len(columns) :]]
        out = np.zeros((len(self.visits), 6, len(columns)))
        out[:, model.machine.dof] = self.sensitivity.pose_derivatives(columns)
        return out

    def _systematic_column(self, name: str) -> Array:
        kind, _, part = name.partition(".")
        if kind == "payload":
            if not self.model.with_loads:
                return np.zeros((len(self.model.machine.dof), len(self.visits)))
            if part == "mass":
                return self.sensitivity.mass(PAYLOAD) * self.visits.payload_kg
            return self.sensitivity.centre_of_mass(PAYLOAD, "xyz".index(part[-1]))
        return self.sensitivity.growth(part) * self.growth_derivative(kind, part)

    def growth_derivative(self, kind: str, part: str) -> Array:
        """Derivative (v,) of a part's thermal factor with its coefficient or its temperature's error."""
        coefficient, warmth = self.model.expansion(self.values, self.visits, part)
        return np.full(len(self.visits), coefficient) if kind == "temperature" else warmth

    @cached_property
    def carriers(self) -> list[Carrier]:
        """Carrier of every drive, and of the base last, at these poses."""
        return equilibrium.carriers_of(self.model.machine, self.geometry, self.visits.drives, self.conditions)

    def tool_m(self) -> Array:
        """Tool points (v, 3)."""
        return self.platform_point_m(self.model.machine.tool_point_m)

    def platform_point_m(self, point_m: Array) -> Array:
        """Positions (v, 3) of a point (3,) of the platform."""
        lever = self.equilibrium.rotation @ point_m
        return self.equilibrium.position_m + lever * self.conditions.factors["platform"][:, None]

    def platform_point_derivatives(self, point_m: Array) -> Array:
        """Derivatives (v, 3, u) of the positions of a point (3,) of the platform with the model's unknowns."""
        lever = self.equilibrium.rotation @ point_m
        grown = lever * self.conditions.factors["platform"][:, None]
        out = self.jacobian[:, :3] - skew(grown) @ self.jacobian[:, 3:]
        for column, unknown in enumerate(self.model.unknowns):
            kind, _, part = unknown.name.partition(".")
            if kind in ("expansion", "temperature") and part == "platform":
                out[:, :, column] += lever * self.growth_derivative(kind, part)[:, None]
        return out

    def reflector_m(self, smr: int, mounting_m: Array) -> Array:
        """Positions (v, 3) of a reflector that is mounted at a point (3,) of its part; a nest stays where it is."""
        reflector = self.model.machine.smrs[smr]
        if reflector.on == "platform":
            return self.equilibrium.position_m + self.mounting_derivatives(smr) @ mounting_m
        if reflector.on == "floor":
            return np.tile(mounting_m, (len(self.visits), 1))
        return self.carriers[reflector.drive].position(mounting_m).T

    def reflector_derivatives(self, smr: int, mounting_m: Array) -> Array:
        """Derivatives (v, 3, u) of the positions of a reflector that moves, with the model's unknowns."""
        reflector = self.model.machine.smrs[smr]
        if reflector.on == "platform":
            return self.platform_point_derivatives(mounting_m)
        carrier = self.carriers[reflector.drive]
        out = np.zeros((len(self.visits), 3, len(self.model)))
        count = len(self.model.parameters)
        out[:, :, :count] = self.model.parameters.shift_of_carried_point(self.sensitivity, reflector.drive, mounting_m)
        for column, unknown in enumerate(self.model.unknowns[count:], start=count):
            kind, _, part = unknown.name.partition(".")
            if kind in ("expansion", "temperature") and part in ("base", "drives"):
                out[:, :, column] = (carrier.d_growth(mounting_m, part) * self.growth_derivative(kind, part)).T
        return out

    def mounting_derivatives(self, smr: int) -> Array:
        """Derivatives (v, 3, 3) of the positions of a reflector that moves, with the point where it is mounted."""
        reflector = self.model.machine.smrs[smr]
        if reflector.on == "platform":
            return self.equilibrium.rotation * self.conditions.factors["platform"][:, None, None]
        return self.carriers[reflector.drive].d_point().transpose(2, 0, 1)
