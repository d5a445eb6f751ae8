"""Rigid identifications of the same data, for comparison with the deformation-aware one.

Leave out the redundant links: as many constraints as free coordinates, no deformation. Mean of minimal subsets: every
such choice fitted on its own, poses averaged. Per-leg closure: each strut closed at the measured poses.
Equal-weight closure: least squares over all closed loops, all weights alike; the strong one. None
knows of loads. All either with one geometry for all payloads or refitted for each (and interpolated linearly
in the payload's mass).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.rotation import rotation_matrix
from calibration.identification.fit import Fit
from calibration.identification.rigid.closure import MeasuredPoses, close_loops, equal_weights
from calibration.machine.description import Machine
from calibration.machine.equilibrium import make_conditions, solve, state_at, workspace_middle
from calibration.machine.inverse import rigid_drives
from calibration.model.model import Model
from calibration.model.parameters import KINDS, ParameterSet
from calibration.model.visits import Visits

RIGID_KINDS = tuple(kind for kind in KINDS if kind != "ln_stiffness")
MOST_SUBSETS = 8  # of the minimal ones, evenly chosen: a Gough platform with eight legs has 28

Predictor = Callable[[Visits], Array]
Stated = Callable[[Fit, Visits], Array]


@dataclass(frozen=True)
class RigidIdentification:
    """A rigid identification: its prediction, one for all payloads or one for each (kg, ascending)."""

    name: str
    by_payload: tuple[tuple[float, Predictor], ...]

    def predict(self, visits: Visits) -> Array:
        """Predicted poses (v, 6), interpolated in the payload where there are several models."""
        poses = [predict(visits) for _, predict in self.by_payload]
        if len(poses) == 1:
            return poses[0]
        loads = np.array([kg for kg, _ in self.by_payload])
        out = np.empty_like(poses[0])
        for row, kg in enumerate(visits.payload_kg):
            right = int(np.clip(np.searchsorted(loads, kg), 1, len(loads) - 1))
            share = (kg - loads[right - 1]) / (loads[right] - loads[right - 1])
            out[row] = (1.0 - share) * poses[right - 1][row] + share * poses[right][row]
        return out


def without_struts(machine: Machine, removed_struts: Sequence[int]) -> Machine:
    """The machine without some of its struts."""
    g = machine.nominal
    struts = len(machine.strut_names)
    keep = np.setdiff1d(np.arange(struts), removed_struts)
    constraints = np.concatenate([keep, np.arange(struts, len(g.stiffness_n_per_m))])
    nominal = replace(
        g,
        platform_joint_m=g.platform_joint_m[keep],
        base_joint_m=g.base_joint_m[keep],
        length_m=g.length_m[keep],
        stiffness_n_per_m=g.stiffness_n_per_m[constraints],
    )
    return replace(
        machine,
        nominal=nominal,
        strut_names=tuple(machine.strut_names[i] for i in keep),
        strut_drive=machine.strut_drive[keep],
        guide_joint=np.searchsorted(keep, machine.guide_joint),
    )


def minimal_subsets(machine: Machine) -> list[tuple[int, ...]]:
    """Struts to remove so that as many constraints as free coordinates remain, the last ones first.

    Only choices that hold the platform everywhere in the workspace; at most MOST_SUBSETS.
    """
    subsets = []
    for drop in combinations(reversed(range(len(machine.strut_names))), machine.redundancy):
        if np.any(np.isin(machine.guide_joint, drop)):
            continue
        fewer = without_struts(machine, drop)
        pose = workspace_middle(machine)[None]
        drives = rigid_drives(machine, machine.nominal, pose)
        rest = solve(fewer, fewer.nominal, drives, make_conditions(fewer, 1).without_loads(), pose)
        if rest.converged.all() and _nonsingular_in_workspace(machine, fewer):
            subsets.append(tuple(sorted(drop)))
    step = max(1, -(-len(subsets) // MOST_SUBSETS))
    return subsets[::step]


def _nonsingular_in_workspace(machine: Machine, fewer: Machine) -> bool:
    """Whether as many constraints as free coordinates hold the nominal platform without a singularity in between.

    The determinant of their wrenches must have one sign in the middle and at all corners of the workspace.
    """
    corners = np.array(list(product(*machine.workspace)))
    corners[:, :3] -= rotation_matrix(corners[:, 3:]) @ machine.tool_point_m
    poses = np.vstack([workspace_middle(machine), corners])
    drives = rigid_drives(machine, machine.nominal, poses)
    at = make_conditions(fewer, len(poses)).without_loads()
    state = state_at(fewer, fewer.nominal, drives, at, poses[:, :3], rotation_matrix(poses[:, 3:]))
    sign = np.sign(np.linalg.det(state.wrench.transpose(2, 0, 1)))
    return bool(np.all(sign == sign[0]))


def fit_rigid_identifications(
    machine: Machine,
    visits: Visits,
    fit_readings: Callable[[Model, NDArray[np.bool_]], Fit],
    poses_in_report_frame: Stated,
    measured_poses: MeasuredPoses | None = None,
) -> tuple[RigidIdentification, ...]:
    """All rigid identifications of the same readings.

    fit_readings: identifies a model from the readings of some visits (v,); poses_in_report_frame: predicted poses of a
    fit; measured_poses: in the same frame, for the closure leg by leg.
    """
    loads = np.unique(visits.payload_kg)
    groups: list[tuple[float, NDArray[np.bool_]]] = [(float(kg), visits.payload_kg == kg) for kg in loads]
    everything = np.ones(len(visits), dtype=bool)
    out = []
    for name, make in _rigid_methods(machine, fit_readings, poses_in_report_frame, measured_poses).items():
        out.append(RigidIdentification(name, ((0.0, make(everything)),)))
        if len(groups) > 1:
            out.append(RigidIdentification(f"{name}_per_payload", tuple((kg, make(rows)) for kg, rows in groups)))
    return tuple(out)


def _rigid_methods(
    machine: Machine,
    fit_readings: Callable[[Model, NDArray[np.bool_]], Fit],
    poses_in_report_frame: Stated,
    measured_poses: MeasuredPoses | None,
) -> dict[str, Callable[[NDArray[np.bool_]], Predictor]]:
    subsets = minimal_subsets(machine) if machine.redundancy else [()]
    equal = equal_weights(machine)

    def by_fit(machines: Sequence[Machine]) -> Callable[[NDArray[np.bool_]], Predictor]:
        def make(rows: NDArray[np.bool_]) -> Predictor:
            fits = [fit_readings(rigid_model(m), rows) for m in machines]
            return lambda visits: np.mean([poses_in_report_frame(fit, visits) for fit in fits], axis=0)

        return make

    methods = {
        "leave_out_link": by_fit([without_struts(machine, subsets[0])]),
        "mean_of_minimal_subsets": by_fit([without_struts(machine, drop) for drop in subsets]),
        "equal_weight_closure": by_fit([equal]),
    }
    if measured_poses is not None:

        def from_measured_poses(rows: NDArray[np.bool_]) -> Predictor:
            model = rigid_model(equal)
            rows = rows & np.all(np.isfinite(measured_poses.coordinates), axis=1)  # a visit broken off may have no pose
            some = MeasuredPoses(
                measured_poses.visits.take(rows), measured_poses.coordinates[rows], measured_poses.covariance[rows]
            )
            theta = close_loops(model.parameters, some)
            return lambda visits: model.predict(theta, visits).equilibrium.coordinates()

        methods["per_leg_closure"] = from_measured_poses
    return methods


def rigid_model(machine: Machine) -> Model:
    """The rigid model of a machine: no stiffness to be found, no loads."""
    return Model(ParameterSet.of(machine, RIGID_KINDS), with_loads=False)
