"""An independent linear delta: the classical forward kinematics, and printer.cfg files made with it.

Nothing here uses the package: three spheres of the arms' radii about the carriages meet in the tool point
(trilateration). Lengths in mm, angles in degrees, as printer.cfg has them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

SEED = 20
HEIGHT_SD_MM, DISTANCE_SD_MM = 0.03, 0.05
HEADER = "#*# <---------------------- SAVE_CONFIG ---------------------->"


@dataclass(frozen=True)
class Delta:
    """Parameters: endstop, angle, arm and step of towers a, b, c; delta radius."""

    endstop: np.ndarray
    radius: float
    angle: np.ndarray
    arm: np.ndarray
    step: np.ndarray

    def tool(self, steps):
        """Tool points (n, 3) with the carriages `steps` (n, 3) below their endstops; (3,) for (3,)."""
        turn = np.radians(self.angle)
        heights = self.endstop + np.sqrt(self.arm**2 - self.radius**2) - np.asarray(steps) * self.step
        towers = self.radius * np.column_stack([np.cos(turn), np.sin(turn)])
        p1, p2, p3 = (np.concatenate([np.broadcast_to(towers[k], (*heights.shape[:-1], 2)), heights[..., k, None]], -1)
                      for k in range(3))  # fmt: skip
        d = np.linalg.norm(p2 - p1, axis=-1, keepdims=True)
        ex = (p2 - p1) / d
        i = np.sum(ex * (p3 - p1), axis=-1, keepdims=True)
        ey = (p3 - p1) - i * ex
        j = np.linalg.norm(ey, axis=-1, keepdims=True)
        ey = ey / j
        ez = np.cross(ex, ey)
        r1, r2, r3 = self.arm
        x = (r1**2 - r2**2 + d**2) / (2 * d)
        y = (r1**2 - r3**2 + i**2 + j**2) / (2 * j) - i / j * x
        lift = np.sqrt(r1**2 - x**2 - y**2)
        side = -np.sign(ez[..., 2:])  # of the two points the lower one
        return p1 + x * ex + y * ey + side * lift * ez

    def steps(self, point):
        """Steps (3,) that bring the tool to a point."""
        turn = np.radians(self.angle)
        towers = self.radius * np.column_stack([np.cos(turn), np.sin(turn)])
        reach = np.sum((towers - np.asarray(point)[:2]) ** 2, axis=1)
        carriage = point[2] + np.sqrt(self.arm**2 - reach)
        return (self.endstop + np.sqrt(self.arm**2 - self.radius**2) - carriage) / self.step


@dataclass(frozen=True)
class Rows:
    """heights: (height, steps); distances: (distance, steps, steps)."""

    heights: list
    distances: list

    def without(self, i):
        n = len(self.heights)
        return Rows(
            [h for k, h in enumerate(self.heights) if k != i], [d for k, d in enumerate(self.distances) if k != i - n]
        )


def misses(delta: Delta, rows: Rows):
    """Prediction minus reading of all rows, mm."""
    out = [delta.tool([p for _, p in rows.heights])[:, 2] - [h for h, _ in rows.heights]]
    if rows.distances:
        between = delta.tool([p for _, p, _ in rows.distances]) - delta.tool([q for _, _, q in rows.distances])
        out.append(np.linalg.norm(between, axis=1) - [d for d, _, _ in rows.distances])
    return np.concatenate(out)


def fit(start: Delta, rows: Rows, arms: bool) -> Delta:
    """The owner's fit: endstops, radius, two angles, and the arms where asked for; plain weighted least squares."""

    def at(p):
        return replace(
            start,
            endstop=p[:3],
            radius=p[3],
            angle=np.array([p[4], p[5], start.angle[2]]),
            arm=p[6:9] if arms else start.arm,
        )

    sd = np.array([HEIGHT_SD_MM] * len(rows.heights) + [DISTANCE_SD_MM] * len(rows.distances))
    first = [*start.endstop, start.radius, *start.angle[:2], *(start.arm if arms else [])]
    scale = [1.0] * 4 + [0.1] * 2 + [1.0] * (3 if arms else 0)
    return at(least_squares(lambda p: misses(at(p), rows) / sd, first, x_scale=scale, xtol=1e-14, ftol=1e-14).x)


def left_out(start: Delta, rows: Rows, arms: bool):
    """Misses of each row by a true refit without it, mm."""
    count = len(rows.heights) + len(rows.distances)
    return np.array([misses(fit(start, rows.without(i), arms), rows)[i] for i in range(count)])


def from_json(data) -> tuple[Delta, Rows]:
    """A set of ../shared/real-data."""
    towers = [data["steppers"][k] for k in "abc"]
    columns = {key: np.array([t[key] for t in towers]) for key in ("endstop", "angle", "arm", "stepdist")}
    delta = Delta(columns["endstop"], data["delta_radius_mm"], columns["angle"], columns["arm"], columns["stepdist"])
    return delta, Rows(data["heights"], data["distances"])


def printer_cfg(delta: Delta, rows: Rows, microsteps=(16, 16, 16)) -> str:
    """printer.cfg with the parameters as SAVE_CONFIG stores them; 40 mm a turn, full steps as the step needs them."""
    lines = ["[printer]", "kinematics: delta", "max_velocity: 300", "delta_radius: 140  # replaced below", ""]
    for i, k in enumerate("abc"):
        full = 40.0 / delta.step[i] / microsteps[i]
        lines += [f"[stepper_{k}]", f"step_pin: P{i}", f"microsteps: {microsteps[i]}", "rotation_distance: 40"]
        lines += ["arm_length: 300", "position_endstop: 290", f"full_steps_per_rotation: {full:.12g}", ""]
    lines += ["[delta_calibrate]", "radius: 100", "", "[gcode_macro PARK]", "gcode:", "    G28", "    # height0: 5", ""]
    lines += [HEADER, "#*# DO NOT EDIT THIS BLOCK OR BELOW. The contents are auto-generated.", "#*#"]
    lines += ["#*# [printer]", f"#*# delta_radius = {delta.radius:.6f}", "#*#"]
    for i, k in enumerate("abc"):
        lines += [f"#*# [stepper_{k}]", f"#*# angle = {delta.angle[i]:.6f}", f"#*# arm_length = {delta.arm[i]:.6f}"]
        lines += [f"#*# position_endstop = {delta.endstop[i]:.6f}", "#*#"]
    lines += ["#*# [delta_calibrate]"]
    for i, (height, p) in enumerate(rows.heights):
        lines += [f"#*# height{i} = {height}", f"#*# height{i}_pos = {_three(p)}"]
    for i, (distance, p, q) in enumerate(rows.distances):
        lines += [f"#*# distance{i} = {distance}", f"#*# distance{i}_pos1 = {_three(p)}"]
        lines += [f"#*# distance{i}_pos2 = {_three(q)}"]
    return "\n".join(lines) + "\n"


def _three(steps) -> str:
    return ",".join(f"{s:.3f}" for s in steps)


TRUE = Delta(
    endstop=np.array([291.2, 290.4, 290.9]),
    radius=140.6,
    angle=np.array([210.25, 329.7, 90.0]),
    arm=np.array([300.4, 299.8, 300.1]),
    step=np.full(3, 0.0125),
)


# What the owner's last fit, of other prints, stored: not quite the machine of these rows.
STORED = Delta(
    endstop=np.array([291.36, 290.29, 290.96]),
    radius=140.75,
    angle=np.array([210.31, 329.64, 90.0]),
    arm=np.array([300.2, 299.9, 300.4]),
    step=np.full(3, 0.0125),
)


def own_printer() -> tuple[Delta, Rows]:
    """The printer of tests/data/printer.cfg: what its owner stored, and readings of the machine TRUE with noise.

    Thirteen points are probed, steps are whole; six distances of features 65 mm from the middle.
    """
    rng = np.random.default_rng(SEED)
    turns = np.radians(np.arange(30, 390, 60))
    points = [(0.0, 0.0)] + [(r * np.cos(t), r * np.sin(t)) for r in (100.0, 55.0) for t in turns]
    heights = []
    for x, y in points:
        heights.append((0.5, np.round(TRUE.steps((x, y, 0.5 + rng.normal(0.0, HEIGHT_SD_MM))))))
    distances = []
    for k in range(6):
        t = np.radians(60.0 * k)
        first, second = (np.array([65.0 * s * np.cos(t), 65.0 * s * np.sin(t), 2.0]) for s in (1.0, -0.3))
        length = np.linalg.norm(first - second) + rng.normal(0.0, DISTANCE_SD_MM)
        distances.append((round(length, 3), np.round(TRUE.steps(first), 3), np.round(TRUE.steps(second), 3)))
    rows = Rows(heights, distances)
    return STORED, rows
