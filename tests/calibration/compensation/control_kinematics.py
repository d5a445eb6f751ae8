"""genhexkins, lineardeltakins and Klipper's delta from their published formulas, fed with our files.

Nothing here uses the writers. Lengths in mm, angles in degrees, as the controls have them.
"""

from __future__ import annotations

import re

import numpy as np


def rpy_matrix(roll, pitch, yaw):
    """R = Rz(yaw) Ry(pitch) Rx(roll), angles in rad."""
    (cr, sr), (cp, sp), (cy, sy) = ((np.cos(x), np.sin(x)) for x in (roll, pitch, yaw))
    rx = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    ry = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    rz = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return rz @ ry @ rx


def rpy_of(matrix):
    """Roll, pitch and yaw in rad of a rotation."""
    return np.array(
        [
            np.arctan2(matrix[2, 1], matrix[2, 2]),
            -np.arcsin(matrix[2, 0]),
            np.arctan2(matrix[1, 0], matrix[0, 0]),
        ]
    )


class GenHexKins:
    """Joints from HAL commands; the drives behind them by the factors and lengths of the INI fragment."""

    def __init__(self, hal, ini):
        pins = dict(re.findall(r"^setp genhexkins\.(\S+) (\S+)$", hal, re.M))
        assert float(pins["screw-lead"]) == float(pins["tool-offset"]) == float(pins["spindle-offset"]) == 0.0
        self.a, self.b = (
            np.array([[float(pins[f"{what}.{k}.{axis}"]) for axis in "xyz"] for k in range(6)])
            for what in ("platform", "base")
        )
        self.factor, self.zero = joint_facts(ini, 6, "length")

    def joints(self, position, rpy):
        """Lengths of the struts, mm."""
        return np.linalg.norm(position + self.a @ rpy_matrix(*rpy).T - self.b, axis=1)

    def drives(self, position, rpy):
        """Coordinates of the drives, mm: the motors turn by SCALE times the joint's way from homing."""
        return (self.joints(position, rpy) - self.zero) * self.factor

    def forward(self, joints, position, rpy):
        """The pose for joints, by Newton's method from a pose nearby."""
        x = np.concatenate([position, rpy])
        for _ in range(20):
            off = self.joints(x[:3], x[3:]) - joints
            jac = np.stack([(self.joints((x + e)[:3], (x + e)[3:]) - joints - off) / 1e-6 for e in 1e-6 * np.eye(6)], 1)
            step = np.linalg.solve(jac, off)
            x = x - step
            if np.max(np.abs(step)) < 1e-12:
                break
        return x


class LinearDeltaKins:
    """Towers at (0, R), (-R sin 60, -R cos 60) and (R sin 60, -R cos 60)."""

    def __init__(self, hal, ini):
        pins = dict(re.findall(r"^setp lineardeltakins\.(\S+) (\S+)$", hal, re.M))
        r, self.length = float(pins["R"]), float(pins["L"])
        s, c = np.sqrt(3.0) / 2.0 * r, 0.5 * r
        self.towers = np.array([[0.0, r], [-s, -c], [s, -c]])
        self.factor, self.zero = joint_facts(ini, 3, "height")

    def drives(self, position):
        across = np.sum((self.towers - position[:2]) ** 2, axis=1)
        return (position[2] + np.sqrt(self.length**2 - across) - self.zero) * self.factor


def joint_facts(ini, count, what):
    """Factors of SCALE and joint positions at the drives' zeros."""
    found = re.findall(rf"\[JOINT_(\d)\]\n# SCALE factor (\S+)\n# {what} at the drive's zero (\S+)", ini)
    assert [int(k) for k, _, _ in found] == list(range(count))
    return np.array([float(f) for _, f, _ in found]), np.array([float(z) for _, _, z in found])


class KlipperDelta:
    """printer.cfg: the carriage at its endstop is position_endstop + sqrt(arm^2 - radius^2) high."""

    def __init__(self, cfg):
        options, section = {}, None
        for line in cfg.splitlines():
            if found := re.fullmatch(r"\[(\w+)\]", line):
                section = found[1]
            elif found := re.fullmatch(r"(\w+): (\S+)", line):
                options[section, found[1]] = found[2]
            elif found := re.search(r"endstop at its coordinate (\S+) m; multiply rotation_distance by (\S+)", line):
                options[section, "at"], options[section, "factor"] = found[1], found[2]
        assert options["printer", "kinematics"] == "delta"
        self.radius = float(options["printer", "delta_radius"])
        each = [
            [float(options[f"stepper_{k}", key]) for key in ("angle", "arm_length", "position_endstop", "at", "factor")]
            for k in "abc"
        ]
        angle, self.arm, self.endstop, at, self.factor = np.array(each).T
        self.at = at * 1e3
        self.towers = self.radius * np.stack([np.cos(np.radians(angle)), np.sin(np.radians(angle))], axis=1)

    def drives(self, position):
        across = np.sum((self.towers - position[:2]) ** 2, axis=1)
        carriage = position[2] + np.sqrt(self.arm**2 - across)
        below = self.endstop + np.sqrt(self.arm**2 - self.radius**2) - carriage
        return self.at - below / self.factor  # rotation_distance times the factor: as many fewer turns
