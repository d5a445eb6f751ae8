"""LinuxCNC's genhexkins: six struts between a base and a platform, all joints' coordinates as HAL pins.

Joint i is the length of strut i, |T + R a_i - b_i| in mm, with the platform's rotation R = Rz(c) Ry(b) Rx(a). Platform
joints are written about the tool point, so that the pose is the tool's. What genhexkins has no pin for, an error of a
drive's scale and of a strut's length, goes into the joint: SCALE times a factor, and the length at the drive's zero by
homing.
"""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array
from calibration.base.rotation import rotation_matrix
from calibration.compensation.correction import Correction, Samples
from calibration.compensation.formats.control import READ_BY_LINUXCNC, fixed
from calibration.compensation.kinematics.fit import (
    Kinematics,
    KinematicsFiles,
    KinematicsFormat,
    fit_parameters,
)
from calibration.machine.description import Machine

STRUTS = 6
OWN = 8  # parameters of a strut: platform joint (3), base joint (3), length at the drive's zero, scale
DECIMALS, SCALE_DECIMALS = 7, 10


def refusal(machine: Machine) -> str | None:
    """Why a machine is none for genhexkins."""
    legs = [kind == "leg" for kind in machine.drive_kinds]
    if not all(legs):
        return "genhexkins has telescopic struts between a base and a platform, its drives are no legs"
    if len(legs) != STRUTS or len(machine.strut_names) != STRUTS or machine.guide_names:
        return f"genhexkins has six struts and nothing else, this has {len(machine.strut_names)} and {len(legs)} drives"
    return None


def joints(values: Array, pose: Array) -> Array:
    """Drive coordinates (n, 6) by parameters (48,) for tool poses (n, 6); m."""
    by_strut = values.reshape(STRUTS, OWN)
    ends = pose[:, None, :3] + np.einsum("nij,sj->nsi", rotation_matrix(pose[:, 3:]), by_strut[:, :3])
    length = np.linalg.norm(ends - by_strut[:, 3:6], axis=2)
    return np.asarray((length - by_strut[:, 6]) / by_strut[:, 7])


def build(correction: Correction, notes: tuple[str, ...]) -> KinematicsFiles:
    """Fit each strut, round and write."""
    machine = correction.machine
    g, tolerance = machine.nominal, machine.file.tolerances
    order = [int(np.flatnonzero(machine.strut_drive == a)[0]) for a in range(STRUTS)]
    parts, samples = [], correction.fitted
    for a, strut in enumerate(order):
        nominal = np.concatenate(
            [g.platform_joint_m[strut] - machine.tool_point_m, g.base_joint_m[strut], [g.length_m[strut], g.scale[a]]]
        )
        joint = [tolerance.platform_joint_m] * 3 + [tolerance.base_joint_m] * 3
        sigma = np.array([*joint, tolerance.strut_length_m, tolerance.drive_scale])
        own = Samples(samples.target_m, samples.drives[:, [a]], samples.correction[:, [a]])
        fitted = fit_parameters(_one_strut, nominal, np.maximum(sigma, 1e-6), machine, own)
        parts.append((nominal, np.array([*np.round(fitted.values[:7] * 1e3, DECIMALS) / 1e3, fitted.values[7]])))
    values = np.concatenate([part[1] for part in parts])
    values[7::OWN] = 1.0 / np.round(1.0 / values[7::OWN], SCALE_DECIMALS)
    kinematics = Kinematics(joints, np.concatenate([part[0] for part in parts]), values)
    return KinematicsFiles(write(values, notes), kinematics)


def _one_strut(values: Array, pose: Array) -> Array:
    ends = pose[:, :3] + rotation_matrix(pose[:, 3:]) @ values[:3]
    length = np.linalg.norm(ends - values[3:6], axis=1)
    return np.asarray((length - values[6]) / values[7])[:, None]


def write(values: Array, notes: tuple[str, ...]) -> dict[str, str]:
    """The HAL commands, and what goes into the joints of the INI file."""
    head = [f"# {line}" for line in (*notes, FORMAT.trial)]
    hal = [*head, "# mm; the pose is that of the tool point, so tool-offset and spindle-offset stay zero"]
    ini = [
        *head,
        "# SCALE: multiply that of the nominal machine by the factor. A joint is its strut's length in mm; homing has",
    ]
    ini += ["# to end at the stated length plus, over the factor, the drive's coordinate."]
    for k, own in enumerate(values.reshape(STRUTS, OWN)):
        for what, point in (("platform", own[:3]), ("base", own[3:6])):
            hal += [
                f"setp genhexkins.{what}.{k}.{axis} {fixed(value * 1e3, DECIMALS)}"
                for axis, value in zip("xyz", point, strict=True)
            ]
        ini += [
            f"[JOINT_{k}]",
            f"# SCALE factor {fixed(1.0 / own[7], SCALE_DECIMALS)}",
            f"# length at the drive's zero {fixed(own[6] * 1e3, DECIMALS)}",
        ]
    hal += [f"setp genhexkins.{pin} 0" for pin in ("screw-lead", "tool-offset", "spindle-offset")]
    return {"genhexkins.hal": "\n".join([*hal, ""]), "joints.ini": "\n".join([*ini, ""])}


FORMAT = KinematicsFormat(
    name="genhexkins",
    title="LinuxCNC genhexkins",
    control="LinuxCNC",
    parameters="both joints of six struts, their lengths and scales",
    read_by=READ_BY_LINUXCNC,
    refusal=refusal,
    build=build,
)
