"""Correction by the computer that leads the drives: its targets are corrected before they are sent (0x607A).

It needs no tables and works for any number of drives. It acts only where this program, or one that calls it, leads the
drives.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.compensation.tables import corrected_drives
from calibration.identification.calibration import Calibration
from calibration.identification.fit import Fit
from calibration.machine.inverse import nominal_drives
from calibration.model.operating_conditions import OperatingConditions
from calibration.reduction.report_frame import ReportFrame

LARGEST = 2e-3  # of a correction, in m or rad: the tolerances of parts add up to some tenths of a millimetre


@dataclass(frozen=True)
class HostCorrection:
    """Corrections predicted by an identified model for one payload and one set of temperatures.

    With more drives than commanded coordinates the smallest corrections are taken. Internal force is not taken away:
    readings of the pose say too little of it.
    """

    fit: Fit
    report: ReportFrame
    conditions: OperatingConditions

    @property
    def temperature_c(self) -> float:
        """Mean of the temperatures for which it is computed."""
        return float(np.mean(list(self.conditions.temperatures_c.values())))

    def drives(self, target_m: Array) -> Array:
        """Drive coordinates (n, d), m or rad, that bring the tool to commanded platform poses (n, 6).

        Raises InputError for a pose that the model does not reach, beyond the travel, and where a drive would be
        corrected by more than LARGEST.
        """
        machine = self.report.machine
        drives = corrected_drives(self.fit, self.report, target_m, self.conditions)
        for row in range(len(drives)):
            where = f"pose {np.array2string(target_m[row], precision=4, separator=', ')}"
            if not np.all(np.isfinite(drives[row])):
                raise InputError(f"correction: the identified machine does not reach {where}; keep off it")
            low, high = machine.travel.T
            for a in np.flatnonzero((drives[row] < low) | (drives[row] > high)):
                raise InputError(f"correction: {machine.drive_names[a]} would leave its travel at {where}; keep off it")
        size = np.abs(drives - nominal_drives(machine, target_m))
        if np.any(size > LARGEST):
            row, a = divmod(int(np.argmax(size)), size.shape[1])
            unit = "mrad" if machine.drive_kinds[a] == "crank" else "mm"
            raise InputError(
                f"correction: {machine.drive_names[a]} by {size[row, a] * 1e3:.2f} {unit}, {LARGEST * 1e3:g} are "
                "permitted; check identification and machine file"
            )
        return drives

    def forces_n(self, drives: Array, target_m: Array) -> Array:
        """Predicted forces (n, s) of the struts with the drives at (n, d), tension positive."""
        poses = self.fit.predict(self.conditions.at_poses(drives, target_m))
        return poses.equilibrium.force_n[:, : len(self.report.machine.strut_names)]

    def corrections(self, target_m: Array) -> Array:
        """What is added to the nominal drive coordinates (n, d)."""
        return self.drives(target_m) - nominal_drives(self.report.machine, target_m)


def host_correction(calibration: Calibration, payload: int, temperatures_c: dict[str, float]) -> HostCorrection:
    """The correction for a payload of the rig's list at some temperatures."""
    conditions = calibration.operating_conditions(payload, temperatures_c)
    return HostCorrection(calibration.fit, calibration.report, conditions)
