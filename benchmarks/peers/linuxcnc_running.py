"""A running LinuxCNC with our files: joints that a .comp moves, and its kinematics with our geometry.

It is Debian's, installed by whoever wants this (`INSTALL`), without real time and without a screen, run as an ordinary
user since it refuses root: where this is root, as `nobody`. Each run has a configuration of its own, in which the
motors' positions are looked at after every block of a short program; what LinuxCNC makes of our files is compared with
what we mean by them.

    python -m benchmarks.peers.linuxcnc_running
"""

from __future__ import annotations

import json
import os
import pwd
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from calibration.base.arrays import Array
from calibration.base.rotation import rotation_matrix
from calibration.compensation.correction import Correction
from calibration.compensation.decomposition import corrections_at
from calibration.compensation.formats.catalogue import FORMATS
from calibration.compensation.formats.control import Order, axis_names
from calibration.compensation.kinematics.catalogue import KINEMATICS
from calibration.compensation.kinematics.fit import tool_poses
from tests.calibration.compensation.control_kinematics import joint_facts, rpy_of
from tests.calibration.compensation.drawn_machine import DrawnMachine

INSTALL = "apt-get install linuxcnc-uspace"
DISPLAY = Path(__file__).with_name("linuxcnc_display.py")
TIMEOUT_S = 240.0
LOCK = Path("/tmp/linuxcnc.lock")
MOST_COMP_MM, MOST_M = 1e-6, 1e-9
POSES = 12
NODES = 6  # of a joint's table that are visited, and as many places between
HOMED_BELOW_MM = 10.0
MOST_LEFT_MM = 1e-5
WORLD = "XYZABC"


class LinuxCncError(RuntimeError):
    """It did not do the job, in one line."""


@dataclass(frozen=True)
class Configuration:
    """A machine for LinuxCNC in mm and degrees.

    home (joints,): where the joints are when it starts. joint_lines: more for each [JOINT_n]; hal: commands before the
    first cycle; files: beside the INI file.
    """

    kinematics: str
    axes: str
    home: Array
    joint_lines: Sequence[Sequence[str]]
    hal: str = ""
    files: Mapping[str, str] | None = None

    def ini(self) -> str:
        """The INI file."""
        count = len(self.home)
        lines = [
            *("[EMC]", "VERSION = 1.1", "MACHINE = files of ours"),
            *("[DISPLAY]", "DISPLAY = ./linuxcnc_display.py"),
            *("[TASK]", "TASK = milltask", "CYCLE_TIME = 0.005"),
            *("[RS274NGC]", "PARAMETER_FILE = our.var"),
            *("[EMCMOT]", "EMCMOT = motmod", "COMM_TIMEOUT = 4.0", "SERVO_PERIOD = 1000000"),
            *("[EMCIO]", "EMCIO = io", "CYCLE_TIME = 0.1", "TOOL_TABLE = our.tbl"),
            *("[HAL]", "HALFILE = our.hal"),
            *("[TRAJ]", f"COORDINATES = {self.axes}", "LINEAR_UNITS = mm", "ANGULAR_UNITS = degree"),
            *("MAX_LINEAR_VELOCITY = 2000", "DEFAULT_LINEAR_VELOCITY = 2000", "MAX_LINEAR_ACCELERATION = 2000"),
            *("[KINS]", f"KINEMATICS = {self.kinematics}", f"JOINTS = {count}"),
        ]
        motion = ["MIN_LIMIT = -9000", "MAX_LIMIT = 9000", "MAX_VELOCITY = 2000", "MAX_ACCELERATION = 2000"]
        for axis in self.axes:
            lines += [f"[AXIS_{axis}]", *motion]
        for k, (home, more) in enumerate(zip(self.home, self.joint_lines, strict=True)):
            lines += [f"[JOINT_{k}]", "TYPE = LINEAR", *motion, "FERROR = 100", "MIN_FERROR = 100"]
            lines += [f"HOME = {home:.12f}", f"HOME_OFFSET = {home:.12f}", "HOME_SEQUENCE = 0", *more]
        return "\n".join([*lines, ""])

    def hal_file(self) -> str:
        """The HAL file: the motors are where they are commanded."""
        lines = [
            f"loadrt {self.kinematics}",
            f"loadrt motmod servo_period_nsec=1000000 num_joints={len(self.home)}",
            "addf motion-command-handler servo-thread",
            "addf motion-controller servo-thread",
            "net stop iocontrol.0.user-enable-out => iocontrol.0.emc-enable-in",
        ]
        lines += [f"net motor{k} joint.{k}.motor-pos-cmd => joint.{k}.motor-pos-fb" for k in range(len(self.home))]
        return "\n".join([*lines, self.hal, ""])


def why_not() -> str | None:
    """Why no LinuxCNC can be run here, None if one can."""
    if missing := [name for name in ("linuxcnc", "script", "setpriv") if shutil.which(name) is None]:
        return f"{', '.join(missing)} not installed; {INSTALL}"
    if LOCK.exists():
        return f"another LinuxCNC runs here ({LOCK})"
    return None


@dataclass(frozen=True)
class Found:
    """After each block, in mm: where the joints are commanded (n, j), where their motors (n, j); values of HAL pins."""

    joints: Array
    motors: Array
    pins: Mapping[str, Any]


def run(configuration: Configuration, blocks: Sequence[str], pins: Sequence[str] = ()) -> Found:
    """Have LinuxCNC command blocks (G-code) one after the other. Raises LinuxCncError."""
    with tempfile.TemporaryDirectory(prefix="linuxcnc-") as name:
        folder = Path(name)
        job = {"joints": len(configuration.home), "blocks": list(blocks), "pins": list(pins)}
        texts = {
            "our.ini": configuration.ini(),
            "our.hal": configuration.hal_file(),
            "our.tbl": "",
            "our.var": "",
            "job.json": json.dumps(job),
            **(configuration.files or {}),
        }
        for file, text in texts.items():
            (folder / file).write_text(text, encoding="utf-8")
        shutil.copy(DISPLAY, folder / DISPLAY.name)
        (folder / DISPLAY.name).chmod(0o755)
        said = _run_as_ordinary_user(folder)
        found_file = folder / "found.json"
        if not found_file.exists():
            raise LinuxCncError(_last_words(said) or "it ended without a word")
        found = json.loads(found_file.read_text(encoding="utf-8"))
    if "error" in found:
        raise LinuxCncError(_last_words(found["error"]))
    return Found(np.array(found["joints"]), np.array(found["motors"]), found["pins"])


def _run_as_ordinary_user(folder: Path) -> str:
    command = ["script", "-qec", "linuxcnc our.ini", "/dev/null"]  # it wants a terminal
    if os.geteuid() == 0:
        nobody = pwd.getpwnam("nobody")
        command = ["setpriv", f"--reuid={nobody.pw_uid}", f"--regid={nobody.pw_gid}", "--clear-groups", *command]
        for path in (folder, *folder.iterdir()):
            os.chown(path, nobody.pw_uid, nobody.pw_gid)
    environment = {"HOME": str(folder), "PATH": "/usr/bin:/bin", "TERM": "dumb", "LANG": "C"}
    try:
        done = subprocess.run(
            command, cwd=folder, env=environment, check=False, capture_output=True, text=True, timeout=TIMEOUT_S,
            stdin=subprocess.DEVNULL, errors="replace",
        )  # fmt: skip
    except subprocess.TimeoutExpired as error:
        raise LinuxCncError(f"not ended within {TIMEOUT_S:g} s") from error
    return done.stdout + done.stderr


def _last_words(text: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1] if lines else ""


def comp_error_mm(file_type: int) -> float:
    """Of two joints with our .comp files: largest difference of motors from command plus correction.

    At nodes and between them, on the way up and on the way down. What its path planner leaves of the way to the
    programmed position, some 1e-6 mm, is in the joint's command already.
    """
    drawn = DrawnMachine.of("planar4", 3)
    correction = Correction.sampled(drawn.machine, drawn.tool_error_free())
    form = FORMATS["linuxcnc-comp" if file_type == 1 else "linuxcnc-comp-0"]
    control = form.control(None)
    made = form.build(Order(correction, control, axis_names(form, control, None, drawn.machine)))
    joints = []
    for table in made.tables:
        nodes = table.curves[0].nodes.positions
        chosen = nodes[np.linspace(1, len(nodes) - 2, NODES).astype(int)]
        between = chosen + np.linspace(0.2, 0.8, NODES) * (nodes[1] - nodes[0])
        up = np.sort(np.concatenate([chosen, between]))
        joints.append(np.concatenate([up, up[::-1]]))
    at_m = np.stack(joints, axis=1)
    lines = [
        [line for line in part.splitlines() if line.startswith("COMP_FILE")]
        for part in made.files["comp.ini"].split("[JOINT_")[1:]
    ]
    files = {name: text for name, text in made.files.items() if name != "comp.ini"}
    home = at_m[0] * 1e3 - HOMED_BELOW_MM  # LinuxCNC begins to correct a joint when it first moves
    configuration = Configuration("trivkins coordinates=XY", "XY", home, lines, files=files)
    found = run(configuration, [f"G0 X{x * 1e3:.9f} Y{y * 1e3:.9f}" for x, y in at_m])
    if np.max(np.abs(found.joints - at_m * 1e3)) > MOST_LEFT_MM:
        raise LinuxCncError("a joint is not commanded where the program has it")
    meant = found.joints + corrections_at(made.tables, found.joints * 1e-3) * 1e3
    return float(np.max(np.abs(found.motors - meant)))


def kinematics_error(machine: str, form: str, joints: int, what: str) -> dict[str, float]:
    """A rigid machine led by a running LinuxCNC with our geometry, commanded by poses.

    position_m, rotation_rad: errors of the tool with the drives where its motors are; drives_m: largest difference of
    these from what our own formula has; pins: largest difference of a pin from the file.
    """
    drawn = DrawnMachine.of(machine, 3)
    drawn = replace(drawn, model=replace(drawn.model, with_loads=False))
    correction = Correction.sampled(drawn.machine, drawn.tool_error_free())
    made = KINEMATICS[form].build(correction, ())
    hal = made.files[f"{form}.hal"]
    setps = [line.split()[1:] for line in hal.splitlines() if line.startswith("setp ")]
    factor, zero = joint_facts(made.files["joints.ini"], joints, what)
    target = drawn.targets(POSES, 9)
    pose = np.round(tool_poses(drawn.machine, target), 12)
    ours = made.kinematics.drives(pose)
    home = ours[0] / factor * 1e3 + zero
    blocks = [_block(p) for p in pose]
    configuration = Configuration(form, WORLD if joints == len(WORLD) else WORLD[:3], home, [[]] * joints, hal)
    found = run(configuration, blocks, [pin for pin, _ in setps])
    drives = (found.motors - zero) * factor * 1e-3
    error = np.abs(drawn.tool_error_free()(drives, target)).max(axis=0)
    return {
        "position_m": float(error[:3].max()),
        "rotation_rad": float(error[3:].max()),
        "drives_m": float(np.abs(drives - ours).max()),
        "pins": max(abs(found.pins[pin] - float(value)) for pin, value in setps),
    }


def _block(pose: Array) -> str:
    angles = np.degrees(rpy_of(rotation_matrix(pose[None, 3:])[0]))
    words = zip(WORLD, [*(pose[:3] * 1e3), *angles], strict=True)
    used = [f"{name}{value:.10f}" for name, value in words if name in WORLD[:3] or np.any(angles != 0.0)]
    return "G0 " + " ".join(used)


def main() -> int:
    """Print, as JSON, what was found, or why nothing was tried."""
    if reason := why_not():
        print(json.dumps({"absent": reason}))
        return 0
    try:
        found = {
            "comp": {str(file_type): comp_error_mm(file_type) for file_type in (1, 0)},
            "genhexkins": kinematics_error("stewart6", "genhexkins", 6, "length"),
            "lineardeltakins": kinematics_error("delta6", "lineardeltakins", 3, "height"),
        }
    except LinuxCncError as error:
        print(f"LinuxCNC: {error}", file=sys.stderr)
        return 1
    print(json.dumps(found))
    return 0


if __name__ == "__main__":
    sys.exit(main())
