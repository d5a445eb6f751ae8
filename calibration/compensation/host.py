"""Correction by the computer that leads the drives: its targets are corrected before they are sent (0x607A).

It needs no tables and works for any number of drives. It acts only where this program, or one that calls it, leads the
drives: every row of a path, and single targets, by the identified model itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.compensation.correction import correct_drives, model_error
from calibration.compensation.free_part import FreePart, find_free_part, force_u, strut_forces
from calibration.compensation.limits import LARGEST
from calibration.compensation.measured_range import MeasuredRange
from calibration.identification.calibration import Calibration
from calibration.identification.fit import Fit
from calibration.machine.inverse import nominal_drives
from calibration.model.operating_conditions import OperatingConditions
from calibration.reduction.report_frame import ReportFrame


@dataclass(frozen=True)
class HostCorrection:
    """Corrections predicted by an identified model for one payload and one set of temperatures.

    Only for poses that were measured (`MeasuredRange.held`). With more drives than commanded coordinates it is the
    smallest correction with the given free part (`free_part`), which takes away internal force as far as it is known.
    """

    fit: Fit
    report: ReportFrame
    conditions: OperatingConditions
    measured: MeasuredRange
    free: FreePart | None = None

    @property
    def temperature_c(self) -> float:
        """Mean of the temperatures for which it is computed."""
        return float(np.mean(list(self.conditions.temperatures_c.values())))

    def corrections(self, target_m: Array) -> Array:
        """What is added to the nominal drive coordinates (n, d), m or rad, at commanded platform poses (n, 6).

        Rows of a path, or single targets. Raises InputError for a pose beyond those that were measured, one that the
        model does not reach, and where a drive would be corrected by more than LARGEST.
        """
        machine = self.report.machine
        asked = self.measured.held(target_m)
        shift = None if self.free is None else self.free.at(asked)
        error = model_error(self.fit, self.report, self.conditions)
        corrections = correct_drives(machine, error, asked, shift) - nominal_drives(machine, asked)
        lost = np.flatnonzero(~np.all(np.isfinite(corrections), axis=1))
        if lost.size:
            raise InputError(
                f"correction: the identified machine does not reach {_pose(target_m[lost[0]])}; keep off it"
            )
        if np.any(np.abs(corrections) > LARGEST):
            row, a = divmod(int(np.argmax(np.abs(corrections))), corrections.shape[1])
            unit = "mrad" if machine.drive_kinds[a] == "crank" else "mm"
            raise InputError(
                f"correction: {machine.drive_names[a]} by {abs(corrections[row, a]) * 1e3:.2f} {unit}, "
                f"{LARGEST * 1e3:g} are permitted; check identification and machine file"
            )
        return np.asarray(corrections)

    def drives(self, target_m: Array) -> Array:
        """Drive coordinates (n, d), m or rad, that bring the tool to commanded platform poses (n, 6).

        Raises InputError as `corrections` does, and beyond a drive's travel.
        """
        machine = self.report.machine
        drives = nominal_drives(machine, target_m) + self.corrections(target_m)
        low, high = machine.travel.T
        for row, a in np.argwhere((drives < low) | (drives > high))[:1]:
            raise InputError(
                f"correction: {machine.drive_names[a]} would leave its travel at {_pose(target_m[row])}; keep off it"
            )
        return drives

    def forces_n(self, drives: Array, target_m: Array) -> Array:
        """Predicted forces (n, s) of the struts with the drives at (n, d), tension positive."""
        return strut_forces(self.fit, self.conditions, drives, target_m)

    def force_u_n(self, drives: Array, target_m: Array) -> Array:
        """Their standard uncertainties (n, s)."""
        return force_u(self.fit, self.conditions, drives, target_m)


def host_correction(calibration: Calibration, payload: int, temperatures_c: dict[str, float]) -> HostCorrection:
    """The correction for a payload of the rig's list at some temperatures; InputError beyond what was measured."""
    conditions = calibration.operating_conditions(payload, temperatures_c)
    measured = MeasuredRange.of(calibration)
    return correction_by(calibration.fit, calibration.report, conditions, measured)


def correction_by(
    fit: Fit, report: ReportFrame, conditions: OperatingConditions, measured: MeasuredRange
) -> HostCorrection:
    """The same by a fit, whole or one that brings a former one up to date: with a free part where there is one."""
    measured.require(conditions)
    free = find_free_part(fit, report, conditions, measured.box) if report.machine.redundantly_actuated else None
    return HostCorrection(fit, report, conditions, measured, free)


def _pose(target_m: Array) -> str:
    return f"pose {np.array2string(target_m, precision=4, separator=', ')}"
