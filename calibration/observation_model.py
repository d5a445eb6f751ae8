"""What the station sees: reflectors on the platform and on the sliders, in the station's frame.

Unknowns of a fit, in this order: machine parameters, mounting of each reflector (3 each), the frame of the
station (rotation vector and translation, increments on a start value), the range constant, the
relative error of the payload's mass.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration import equilibrium
from calibration.equilibrium import Conditions, rotation_matrix, skew
from calibration.machine import Array, Geometry, Machine
from calibration.parameters import ParameterSet

FRAME_PRIOR_M = 0.1
FRAME_PRIOR_RAD = 0.1


@dataclass(frozen=True)
class Frame:
    """A rigid motion from the machine's to the station's frame: x_station = rotation x + translation_m."""

    rotation: Array
    translation_m: Array

    def moved(self, increment: Array) -> Frame:
        """The frame after an increment (6,): rotation vector, applied on the left, and translation."""
        turn = rotation_matrix(increment[:3])
        return Frame(turn @ self.rotation, self.translation_m + increment[3:])

    def to_machine(self, points_m: Array) -> Array:
        """Points (n, 3) of the station's frame in the machine's."""
        inside: Array = (points_m - self.translation_m) @ self.rotation
        return inside

    def to_station(self, points_m: Array) -> Array:
        """Points (n, 3) of the machine's frame in the station's."""
        outside: Array = points_m @ self.rotation.T + self.translation_m
        return outside


@dataclass(frozen=True)
class Visits:
    """Where the machine stood, one row a visit (v) of a pose.

    drives_m (v, d) actual drive coordinates; target_m (v, 6) commanded pose of the platform (coordinates and
    rotation vector); payload_kg (v,); payload_com_m (v, 3); temperatures_c: sensor to (v,).
    """

    drives_m: Array
    target_m: Array
    payload_kg: Array
    payload_com_m: Array
    temperatures_c: Mapping[str, Array]

    def __len__(self) -> int:
        return len(self.drives_m)

    def take(self, rows: NDArray[np.intp] | NDArray[np.bool_]) -> Visits:
        """Some of the visits."""
        return Visits(
            self.drives_m[rows],
            self.target_m[rows],
            self.payload_kg[rows],
            self.payload_com_m[rows],
            {name: t[rows] for name, t in self.temperatures_c.items()},
        )


@dataclass(frozen=True)
class Observations:
    """Reflector positions measured during visits, one row a reading (r).

    visit (r,): row of `visits`; smr (r,): index in the machine file; position_m (r, 3) in the station's
    frame; covariance_m2 (r, 3, 3).
    """

    visits: Visits
    visit: NDArray[np.intp]
    smr: NDArray[np.intp]
    position_m: Array
    covariance_m2: Array

    def __len__(self) -> int:
        return len(self.visit)

    def of_visits(self, keep: NDArray[np.bool_]) -> Observations:
        """The readings of the visits that are kept."""
        new_row = np.cumsum(keep) - 1
        rows = keep[self.visit]
        return Observations(
            self.visits.take(np.flatnonzero(keep)),
            new_row[self.visit[rows]],
            self.smr[rows],
            self.position_m[rows],
            self.covariance_m2[rows],
        )


@dataclass(frozen=True)
class Layout:
    """Where each unknown stands in the vector of a fit, and its prior standard deviation."""

    parameters: ParameterSet
    smrs: tuple[int, ...]
    sigma: Array

    @property
    def mounting(self) -> int:
        """First column of the reflectors' mounting."""
        return len(self.parameters)

    @property
    def frame(self) -> int:
        """First column of the frame."""
        return self.mounting + 3 * len(self.smrs)

    @property
    def range_constant(self) -> int:
        """Column of the range constant."""
        return self.frame + 6

    @property
    def payload(self) -> int:
        """Column of the payload's relative error."""
        return self.frame + 7

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.frame + 8

    @classmethod
    def of(cls, parameters: ParameterSet, smrs: tuple[int, ...], range_constant_u_m: float, payload_u: float) -> Layout:
        """Layout for the reflectors that were measured; u: standard uncertainties (must be positive)."""
        mounting = parameters.machine.file.tolerances.smr_position_m / np.sqrt(3.0)
        sigma = np.concatenate(
            [
                parameters.sigma,
                np.full(3 * len(smrs), mounting),
                np.full(3, FRAME_PRIOR_RAD),
                np.full(3, FRAME_PRIOR_M),
                [range_constant_u_m, payload_u],
            ]
        )
        return cls(parameters, smrs, sigma)


@dataclass(frozen=True)
class ModelOptions:
    """What the model knows of: loads False leaves gravity and payload out (rigid baselines)."""

    loads: bool = True


def model_conditions(machine: Machine, visits: Visits, options: ModelOptions, payload_error: float) -> Conditions:
    """Conditions of the visits under a model."""
    at = equilibrium.conditions(
        machine,
        len(visits),
        visits.temperatures_c,
        visits.payload_kg * (1.0 + payload_error),
        visits.payload_com_m,
    )
    return at if options.loads else replace(at, masses=tuple((np.zeros_like(m), c) for m, c in at.masses))


@dataclass(frozen=True)
class Prediction:
    """Predicted positions (r, 3) and their derivatives (r, 3, u) with respect to all unknowns."""

    position_m: Array
    jacobian: Array


def predict(layout: Layout, start: Frame, options: ModelOptions, unknowns: Array, seen: Observations) -> Prediction:
    """Predict all readings; rows of poses without an equilibrium are NaN."""
    machine = layout.parameters.machine
    theta = unknowns[: len(layout.parameters)]
    geometry = layout.parameters.geometry(theta)
    visits = seen.visits
    at = model_conditions(machine, visits, options, unknowns[layout.payload])
    rest = equilibrium.solve(machine, geometry, visits.drives_m, at, visits.target_m)
    d = equilibrium.derivatives(machine, geometry, visits.drives_m, at, rest)
    slide = layout.parameters.slide_derivative(geometry, visits.drives_m, at)
    pose = np.zeros((len(visits), 6, layout.size))
    pose[:, machine.dof, : len(layout.parameters)] = layout.parameters.pose_jacobian(d, slide)
    if options.loads:
        pose[:, machine.dof, layout.payload] = d.mass[:, :, 1] * visits.payload_kg[:, None]

    frame = start.moved(unknowns[layout.frame : layout.frame + 6])
    point = np.empty((len(seen), 3))
    jacobian = np.zeros((len(seen), 3, layout.size))
    for column, index in enumerate(layout.smrs):
        rows = seen.smr == index
        visit = seen.visit[rows]
        smr = machine.smrs[index]
        first = layout.mounting + 3 * column
        mounted = smr.position_m + unknowns[first : first + 3]
        if smr.on == "platform":
            turn = rest.rotation[visit] * at.factors["platform"][visit, None, None]
            lever = turn @ mounted
            point[rows] = rest.position_m[visit] + lever
            jacobian[rows] = pose[visit, :3] - skew(lever) @ pose[visit, 3:]
            jacobian[rows, :, first : first + 3] = turn
        else:
            moved, d_moved = _slider_point(geometry, visits.drives_m, at, slide, smr.drive)
            base = at.factors["base"][visit, None]
            point[rows] = mounted * base + moved[visit]
            jacobian[rows, :, : len(layout.parameters)] = d_moved[visit]
            jacobian[rows, :, first : first + 3] = np.eye(3) * base[:, :, None]
    return _seen_from(frame, layout, point, jacobian, unknowns[layout.range_constant])


def _slider_point(geometry: Geometry, drives_m: Array, at: Conditions, slide: Array, drive: int) -> tuple[Array, Array]:
    travel = drives_m[:, drive] * geometry.scale[drive] * at.factors["drives"]
    return travel[:, None] * geometry.axis[drive], slide[:, drive]


def _seen_from(frame: Frame, layout: Layout, point: Array, jacobian: Array, constant: float) -> Prediction:
    """Into the station's frame; ranges too long by the constant."""
    turned = point @ frame.rotation.T
    seen = turned + frame.translation_m
    out = np.einsum("ij,rju->riu", frame.rotation, jacobian)
    out[:, :, layout.frame : layout.frame + 3] = -skew(turned)
    out[:, :, layout.frame + 3 : layout.frame + 6] = np.eye(3)
    sight = seen / np.linalg.norm(seen, axis=1)[:, None]
    out[:, :, layout.range_constant] = sight
    return Prediction(seen + constant * sight, out)
