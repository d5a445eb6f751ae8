"""Loop closure leg by leg: every strut's parameters from measured poses, as if nothing ever deformed.

The residual of a strut at a measured pose, |p + R m - s| - l, is to vanish (Jiang et al., eq. 1, for rigid parts).
Lengths found so are stretched lengths; the deformation-aware model must never be fed with them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.base.arrays import Array
from calibration.base.rotation import rotation_matrix
from calibration.identification.linear_system import QrAccumulator, regularised_step
from calibration.machine import equilibrium
from calibration.machine.description import Geometry, Machine
from calibration.machine.equilibrium import Conditions
from calibration.machine.mechanics import MechanicalState
from calibration.model.parameters import MachineParameter, ParameterSet
from calibration.model.visits import Visits

STEPS = 6


@dataclass(frozen=True)
class MeasuredPoses:
    """Measured poses of visits: coordinates (v, 6) of the platform and their covariances (v, f, f)."""

    visits: Visits
    coordinates: Array
    covariance: Array


def close_loops(parameters: ParameterSet, measured: MeasuredPoses) -> Array:
    """Parameters (p,) that close every loop at the measured poses, tolerances as priors, struts independent."""
    machine = parameters.machine
    at = equilibrium.make_conditions(machine, len(measured.visits), measured.visits.temperatures_c).without_loads()
    rotation = rotation_matrix(measured.coordinates[:, 3:])
    sigma, prior = parameters.sigma, np.ones(len(parameters))
    z = np.zeros(len(parameters))
    for _ in range(STEPS):
        geometry = parameters.geometry(z * sigma)
        state = equilibrium.state_at(
            machine, geometry, measured.visits.drives, at, measured.coordinates[:, :3], rotation
        )
        variance = np.einsum("fcn,nfg,gcn->cn", state.wrench, measured.covariance, state.wrench)
        by_parameter = _closure_jacobian(parameters, geometry, measured.visits.drives, at, state) * sigma[:, None, None]
        folding = QrAccumulator(len(parameters))
        for c in range(len(variance)):
            white = 1.0 / np.sqrt(variance[c])
            folding.add((by_parameter[:, c] * white).T, state.residual[c] * white)
        step = regularised_step(folding.result(), z, prior)
        z = z + step
        if np.max(np.abs(step)) < 1e-9:
            break
    return z * sigma


def _closure_jacobian(
    parameters: ParameterSet, geometry: Geometry, drives: Array, at: Conditions, state: MechanicalState
) -> Array:
    """Derivatives (p, c, n) of the residuals with the parameters, the poses held."""
    machine = parameters.machine
    carriers = equilibrium.carriers_of(machine, geometry, drives, at)
    out = np.zeros((len(parameters), *state.residual.shape))

    def shift(c: int, base_end: Array) -> Array:
        return -np.einsum("in,in->n", state.direction[:, c], base_end)

    def add_carrier_shift(p: MachineParameter, row: Array) -> None:
        carrier = carriers[p.part]
        for i in map(int, np.flatnonzero(machine.strut_drive == p.part)):
            joint = geometry.base_joint_m[i]
            if p.kind == "axis_tilt":
                row[i] = shift(i, carrier.d_tilt(joint, np.array(p.about)))
            elif p.kind == "pivot":
                row[i] = shift(i, carrier.d_pivot()[:, p.axis])
            elif carrier.kind == "leg":
                row[i] = -carrier.travel / geometry.scale[p.part]
            else:
                row[i] = shift(i, carrier.d_travel(joint) * carrier.travel / geometry.scale[p.part])

    struts = len(machine.strut_names)
    for row, p in zip(out, parameters.parameters, strict=True):
        match p.kind:
            case "strut_length":
                row[p.part] = -at.factors["struts"]
            case "platform_joint":
                moved = state.rotation[:, p.axis] * at.factors["platform"]
                for c in (p.part, *(struts + np.flatnonzero(machine.guide_joint == p.part))):
                    row[c] = np.einsum("in,in->n", state.direction[:, c], moved)
            case "base_joint":
                row[p.part] = shift(p.part, carriers[machine.strut_drive[p.part]].d_point()[:, p.axis])
            case "guide_position":
                row[struts + p.part] = -at.factors["base"]
            case "guide_tilt":
                c = struts + p.part
                turned = np.cross(np.array(p.about), geometry.guide_normal[p.part])
                row[c] = turned @ (state.lever[:, c] + state.position - state.structure.base_ends[:, c])
            case "ln_stiffness":
                pass
            case _:
                add_carrier_shift(p, row)
    return out


def equal_weights(machine: Machine) -> Machine:
    """The machine with one stiffness for all constraints: its equilibrium is plain least-squares closure."""
    k = machine.nominal.stiffness_n_per_m
    return replace(machine, nominal=replace(machine.nominal, stiffness_n_per_m=np.full(len(k), np.mean(k))))
