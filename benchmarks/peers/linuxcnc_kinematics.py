"""LinuxCNC's own kinematics modules, loaded by themselves, with our files: the tool has to come where it is commanded.

The modules are those of Debian's package, unpacked and not installed; hal_shim.c stands for the realtime environment.
Run in a process of its own, with the folder of the modules and the compiled shim.

    python -m benchmarks.peers.linuxcnc_kinematics MODULES SHIM
"""

from __future__ import annotations

import ctypes
import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from calibration.base.rotation import rotation_matrix
from calibration.compensation.correction import Correction
from calibration.compensation.kinematics.catalogue import KINEMATICS
from calibration.compensation.kinematics.fit import tool_poses
from tests.calibration.compensation.control_kinematics import joint_facts, rpy_of
from tests.calibration.compensation.drawn_machine import DrawnMachine

POSES = 40


def main() -> int:
    """Print, as JSON, the largest tool error of the hexapod (m, rad) and the largest miss of the delta's drives (m)."""
    modules, shim_path = Path(sys.argv[1]), sys.argv[2]
    shim = ctypes.CDLL(shim_path, mode=ctypes.RTLD_GLOBAL)
    shim.pin.restype = ctypes.POINTER(ctypes.c_double)
    out = {}
    for name, form, joints, what in (
        ("stewart6", "genhexkins", 6, "length"),
        ("delta6", "lineardeltakins", 3, "height"),
    ):
        drawn = DrawnMachine.of(name, 3)
        drawn = replace(drawn, model=replace(drawn.model, with_loads=False))  # rigid
        correction = Correction.sampled(drawn.machine, drawn.tool_error_free())
        made = KINEMATICS[form].build(correction, ())
        module = ctypes.CDLL(str(modules / f"{form}.so"))
        if module.rtapi_app_main() != 0:
            raise RuntimeError(f"{form} does not start")
        for pin, value in re.findall(r"^setp (\S+) (\S+)$", made.files[f"{form}.hal"], re.M):
            place = shim.pin(pin.encode())
            if not place:
                raise RuntimeError(f"{form} has no pin {pin}")
            place[0] = float(value)
        factor, zero = joint_facts(made.files["joints.ini"], joints, what)
        target = drawn.targets(POSES, 9)
        pose = tool_poses(drawn.machine, target)
        lengths = np.array([_inverse(module, p)[:joints] for p in pose])
        drives = (lengths - zero) * factor * 1e-3
        if form == "genhexkins":
            error = np.abs(drawn.tool_error_free()(drives, target)).max(axis=0)
            out[form] = {"position_m": float(error[:3].max()), "rotation_rad": float(error[3:].max())}
        else:
            out[form] = {"drives_m": float(np.abs(drives - made.kinematics.drives(pose)).max())}
    print(json.dumps(out))
    return 0


def _inverse(module: ctypes.CDLL, pose: np.ndarray) -> np.ndarray:
    """Joints in mm for a tool pose (6,) in m and rad (rotation vector)."""
    angles = np.degrees(rpy_of(rotation_matrix(pose[None, 3:])[0]))
    words = (ctypes.c_double * 9)(*(pose[:3] * 1e3), *angles, 0.0, 0.0, 0.0)
    joints, flags, more = (ctypes.c_double * 16)(), ctypes.c_ulong(0), ctypes.c_ulong(0)
    if module.kinematicsInverse(words, joints, ctypes.byref(flags), ctypes.byref(more)) != 0:
        raise RuntimeError("kinematicsInverse failed")
    return np.array(joints[:])


if __name__ == "__main__":
    sys.exit(main())
