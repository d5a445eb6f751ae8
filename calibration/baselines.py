"""Rigid identifications of the same data, for comparison with the deformation-aware one.

Leave out the redundant link: as many struts as free coordinates, no deformation. Equal-weight closure: least
squares over all closed loops, all weights alike. Neither knows of loads. Both either with one geometry for all
payloads or refitted for each (and interpolated linearly in the payload's mass).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.compensation import predict_poses
from calibration.identification import Fit, identify
from calibration.machine import Array, Machine
from calibration.observation_model import Frame, Layout, ModelOptions, Observations, Visits
from calibration.parameters import KINDS, ParameterSet
from calibration.report_frame import ReportFrame

RIGID_KINDS = tuple(kind for kind in KINDS if kind != "ln_stiffness")
RIGID = ModelOptions(loads=False)


@dataclass(frozen=True)
class Baseline:
    """A rigid identification: one fit, or one a payload (kg, ascending)."""

    name: str
    fits: tuple[tuple[float, Fit], ...]

    def predict(self, report: ReportFrame, visits: Visits) -> Array:
        """Predicted poses (v, 6) in the report frame, interpolated in the payload where there are several fits."""
        poses = [predict_poses(fit, report, visits) for _, fit in self.fits]
        if len(poses) == 1:
            return poses[0]
        loads = np.array([kg for kg, _ in self.fits])
        out = np.empty_like(poses[0])
        for row, kg in enumerate(visits.payload_kg):
            right = int(np.clip(np.searchsorted(loads, kg), 1, len(loads) - 1))
            share = (kg - loads[right - 1]) / (loads[right] - loads[right - 1])
            out[row] = (1.0 - share) * poses[right - 1][row] + share * poses[right][row]
        return out


def without_struts(machine: Machine, drop: Sequence[int]) -> Machine:
    """The machine without some of its struts."""
    keep = np.setdiff1d(np.arange(len(machine.strut_names)), drop)
    g = machine.nominal
    nominal = replace(
        g,
        platform_joint_m=g.platform_joint_m[keep],
        base_joint_m=g.base_joint_m[keep],
        length_m=g.length_m[keep],
        stiffness_n_per_m=g.stiffness_n_per_m[keep],
    )
    return replace(
        machine,
        nominal=nominal,
        strut_names=tuple(machine.strut_names[i] for i in keep),
        strut_drive=machine.strut_drive[keep],
    )


def fit_baselines(
    machine: Machine, seen: Observations, start: Frame, smrs: tuple[int, ...], range_constant_u_m: float
) -> tuple[Baseline, ...]:
    """All rigid baselines of the same readings."""
    redundant = len(machine.strut_names) - len(machine.dof)
    last = list(range(len(machine.strut_names) - redundant, len(machine.strut_names)))
    models = {"leave_out_link": without_struts(machine, last), "equal_weight_closure": machine}
    loads = sorted(set(seen.visits.payload_kg.tolist()))
    out = []
    for name, model in models.items():
        layout = Layout.of(ParameterSet.of(model, RIGID_KINDS), smrs, range_constant_u_m, 1e-6)
        fit = identify(layout, start, seen, RIGID)
        out.append(Baseline(name, ((0.0, fit),)))
        by_load = tuple(
            (kg, identify(layout, start, seen.of_visits(seen.visits.payload_kg == kg), RIGID)) for kg in loads
        )
        if len(by_load) > 1:
            out.append(Baseline(f"{name}_per_payload", by_load))
    return tuple(out)
