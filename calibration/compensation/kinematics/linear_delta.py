"""Linear deltas: LinuxCNC's lineardeltakins and the delta section of Klipper's printer.cfg.

Carriage k stands z + sqrt(L^2 - (x_k - x)^2 - (y_k - y)^2) high. lineardeltakins has one radius R and one length L,
its towers at 90, 210 and 330 degrees. Klipper has one radius, an angle and an arm's length a tower, and the height of
the tool in the middle when a carriage is at its endstop: position_endstop = carriage - sqrt(L^2 - R^2). What neither
has, an error of a drive's scale and the place of its zero, goes into the joint: SCALE or rotation_distance times a
factor, and homing.
"""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array
from calibration.compensation.correction import Correction
from calibration.compensation.formats.control import READ_BY_LINUXCNC, fixed
from calibration.compensation.kinematics.fit import (
    Kinematics,
    KinematicsFiles,
    KinematicsFormat,
    fit_parameters,
)
from calibration.machine.description import Machine

TOWERS = 3
ANGLES = np.radians([90.0, 210.0, 330.0])
DECIMALS, SCALE_DECIMALS = 6, 10
PLACE_TOLERANCE_M, ANGLE_TOLERANCE_RAD = 1e-3, 1e-2


def refusal(machine: Machine) -> str | None:
    """Why a machine is no linear delta with three towers."""
    if machine.drive_kinds != ("slider",) * TOWERS or machine.commanded.tolist() != [0, 1, 2]:
        return "a linear delta has three sliders and commands x, y and z"
    if not np.allclose(machine.nominal.axis, [0.0, 0.0, 1.0], atol=1e-9) or np.any(machine.branch < 0):
        return "the sliders of a linear delta are vertical, above the platform, positive upwards"
    x, y = _towers(machine)
    radius, angle = np.hypot(x, y), np.arctan2(y, x) % (2.0 * np.pi)
    if np.ptp(radius) > PLACE_TOLERANCE_M or np.max(np.abs(angle - ANGLES)) > ANGLE_TOLERANCE_RAD:
        return "the towers have to stand on a circle at 90, 210 and 330 degrees, in the order of the drives"
    if np.ptp(machine.nominal.length_m) > PLACE_TOLERANCE_M:
        return "the arms have to be of one length"
    return None


def _towers(machine: Machine) -> tuple[Array, Array]:
    """Places (3,) of the towers about the tool point: of each drive's struts the mean, less the platform's joints."""
    reach = machine.nominal.base_joint_m - machine.nominal.platform_joint_m + machine.tool_point_m
    by_drive = np.array([reach[machine.strut_drive == a].mean(axis=0) for a in range(TOWERS)])
    return by_drive[:, 0], by_drive[:, 1]


def _nominal(machine: Machine) -> tuple[float, float, Array]:
    """Radius, arm and the carriages' heights (3,) at the drives' zeros, about the tool point."""
    g = machine.nominal
    height = g.base_joint_m[:, 2] - g.platform_joint_m[:, 2] + machine.tool_point_m[2]
    zeros = np.array([height[machine.strut_drive == a].mean() for a in range(TOWERS)])
    return float(np.mean(np.hypot(*_towers(machine)))), float(np.mean(g.length_m)), zeros


def _drives(places: Array, arms: Array, zeros: Array, scales: Array, pose: Array) -> Array:
    """Drive coordinates (n, 3): towers (3, 2), arms, heights at zero and scales (3,)."""
    across = np.sum((places[None] - pose[:, None, :2]) ** 2, axis=2)
    return np.asarray((pose[:, 2:3] + np.sqrt(arms**2 - across) - zeros) / scales)


def _circle(radius: float, angles: Array) -> Array:
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def lineardeltakins(values: Array, pose: Array) -> Array:
    """Parameters (8,): R, L, heights at the drives' zeros, scales."""
    return _drives(_circle(values[0], ANGLES), values[1], values[2:5], values[5:8], pose)


def klipper(values: Array, pose: Array) -> Array:
    """Parameters (13,): radius, angles, arms, heights at the drives' zeros, scales."""
    return _drives(_circle(values[0], values[1:4]), values[4:7], values[7:10], values[10:13], pose)


def build_lineardeltakins(correction: Correction, notes: tuple[str, ...]) -> KinematicsFiles:
    """Fit, round and write for LinuxCNC."""
    machine, t = correction.machine, correction.machine.file.tolerances
    radius, arm, zeros = _nominal(machine)
    nominal = np.array([radius, arm, *zeros, *machine.nominal.scale])
    sigma = np.array([t.base_joint_m, t.strut_length_m, *[t.base_joint_m] * 3, *[t.drive_scale] * 3])
    fitted = fit_parameters(lineardeltakins, nominal, sigma, machine, correction.fitted)
    values = _rounded(fitted.values, lengths=5)
    head = [f"# {line}" for line in (*notes, LINUXCNC.trial)]
    hal = [*head, "# mm; towers 0, 1, 2 at 90, 210 and 330 degrees are the drives in the order of the machine file"]
    hal += [f"setp lineardeltakins.{pin} {fixed(v * 1e3, DECIMALS)}" for pin, v in zip("RL", values[:2], strict=True)]
    ini = [
        *head,
        "# SCALE: multiply that of the nominal machine by the factor. A joint is its carriage's height in mm; homing",
    ]
    ini += ["# has to end at the stated height plus, over the factor, the drive's coordinate."]
    for k in range(TOWERS):
        ini += [f"[JOINT_{k}]", f"# SCALE factor {fixed(1.0 / values[5 + k], SCALE_DECIMALS)}"]
        ini += [f"# height at the drive's zero {fixed(values[2 + k] * 1e3, DECIMALS)}"]
    files = {"lineardeltakins.hal": "\n".join([*hal, ""]), "joints.ini": "\n".join([*ini, ""])}
    return KinematicsFiles(files, Kinematics(lineardeltakins, nominal, values))


def build_klipper(correction: Correction, notes: tuple[str, ...]) -> KinematicsFiles:
    """Fit, round and write for Klipper: the endstops are taken to be at the upper ends of the drives' travel."""
    machine, t = correction.machine, correction.machine.file.tolerances
    radius, arm, zeros = _nominal(machine)
    nominal = np.array([radius, *ANGLES, *[arm] * 3, *zeros, *machine.nominal.scale])
    place, turn = t.base_joint_m, t.base_joint_m / radius
    sigma = np.array([place, *[turn] * 3, *[t.strut_length_m] * 3, *[place] * 3, *[t.drive_scale] * 3])
    fitted = fit_parameters(klipper, nominal, sigma, machine, correction.fitted)
    values = fitted.values.copy()
    values[0] = round(values[0] * 1e3, DECIMALS) / 1e3
    values[1:4] = np.radians(np.round(np.degrees(values[1:4]), DECIMALS))
    values[4:7] = np.round(values[4:7] * 1e3, DECIMALS) / 1e3
    values[10:] = 1.0 / np.round(1.0 / values[10:], SCALE_DECIMALS)
    end = machine.travel[:, 1]
    rise = np.sqrt(values[4:7] ** 2 - values[0] ** 2)
    endstop = np.round((values[7:10] + values[10:] * end - rise) * 1e3, DECIMALS) / 1e3
    values[7:10] = endstop + rise - values[10:] * end
    lines = [f"# {line}" for line in (*notes, KLIPPER.trial)]
    lines += [
        "# Into printer.cfg; mm and degrees. position_endstop holds for an endstop at the coordinate that is stated.",
        "[printer]",
        "kinematics: delta",
        f"delta_radius: {fixed(values[0] * 1e3, DECIMALS)}",
    ]
    for k, name in enumerate("abc"):
        lines += [
            f"[stepper_{name}]",
            f"# drive {machine.drive_names[k]}; endstop at its coordinate {end[k]:g} m; multiply rotation_distance by "
            f"{fixed(values[10 + k], SCALE_DECIMALS)}",
            f"position_endstop: {fixed(endstop[k] * 1e3, DECIMALS)}",
            f"arm_length: {fixed(values[4 + k] * 1e3, DECIMALS)}",
            f"angle: {fixed(np.degrees(values[1 + k]), DECIMALS)}",
        ]
    return KinematicsFiles({"printer-delta.cfg": "\n".join([*lines, ""])}, Kinematics(klipper, nominal, values))


def _rounded(values: Array, lengths: int) -> Array:
    out = values.copy()
    out[:lengths] = np.round(out[:lengths] * 1e3, DECIMALS) / 1e3
    out[lengths:] = 1.0 / np.round(1.0 / out[lengths:], SCALE_DECIMALS)
    return out


LINUXCNC = KinematicsFormat(
    name="lineardeltakins",
    title="LinuxCNC lineardeltakins",
    control="LinuxCNC",
    parameters="one radius, one arm's length, zeros and scales of three joints",
    read_by=READ_BY_LINUXCNC,
    refusal=refusal,
    build=build_lineardeltakins,
)
KLIPPER = KinematicsFormat(
    name="klipper-delta",
    title="Klipper delta",
    control="Klipper",
    parameters="one radius, an angle, an arm's length, an endstop and a scale a tower",
    read_by=None,
    refusal=refusal,
    build=build_klipper,
)
