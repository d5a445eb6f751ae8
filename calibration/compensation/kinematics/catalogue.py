"""The controls' kinematics by name."""

from __future__ import annotations

from calibration.base.errors import InputError
from calibration.compensation.kinematics import genhexkins, linear_delta
from calibration.compensation.kinematics.fit import KinematicsFormat
from calibration.machine.description import Machine

KINEMATICS: dict[str, KinematicsFormat] = {
    form.name: form for form in (genhexkins.FORMAT, linear_delta.LINUXCNC, linear_delta.KLIPPER)
}


def require_kind(form: KinematicsFormat, machine: Machine) -> None:
    """InputError, with the reason, for a machine that is none of the control's."""
    reason = form.refusal(machine)
    if reason is not None:
        raise InputError(f"format {form.name}: {machine.name} is none for it: {reason}; choose a format of tables")
