"""The nominal machine of the recordings, as a file and as numbers, and true ones drawn within its tolerances.

Two upright slides, four struts, as the `planar4` of this project; reflectors elsewhere.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.emergent.strut_model import STRUTS, Machine

DRIVES = ("left", "right")
STRUT_NAMES = ("left_lower", "left_upper", "right_lower", "right_upper")
REFLECTORS = ("P1", "P2", "P3", "SL", "SR", "N1", "N2")
ON = ("platform",) * 3 + DRIVES + ("floor",) * 2
SENSORS = ("struts", "columns", "base", "platform")
LENGTH_M, JOINT_M, TILT_RAD, SCALE, LN_STIFFNESS, MOUNTING_M = 1e-4, 1e-4, 1e-4, 2e-5, 0.3, 1e-4
NEST_OFF_M = 1e-3
EXPANSION_PER_K = 11.5e-6
STIFFNESS_N_PER_M = 1e8

_PLACES_M = (
    (-0.18, -0.15, 0.08), (0.19, -0.14, 0.08), (0.01, 0.18, 0.08), (-1.16, 0.03, 0.09), (1.16, 0.03, 0.09),
    (-0.75, -1.1, 0.2), (0.8, -1.05, 0.2),
)  # fmt: skip

NOMINAL = Machine(
    platform_m=np.array([[-0.2, -0.125], [-0.2, 0.125], [0.2, -0.125], [0.2, 0.125]]),
    base_m=np.array([[-1.2, -0.125], [-1.2, 0.125], [1.2, -0.125], [1.2, 0.125]]),
    length_m=np.full(STRUTS, 1.5),
    stiffness_n_per_m=np.full(STRUTS, STIFFNESS_N_PER_M),
    tilt_rad=np.zeros(2),
    scale=np.ones(2),
    reflectors_m=np.array(_PLACES_M),
)


def draw_machine(rng: np.random.Generator) -> Machine:
    """A true machine; all tolerances are half-widths but the stiffness', which is a deviation of its logarithm."""

    def off(half: float, *shape: int) -> np.ndarray:
        return rng.uniform(-half, half, shape)

    mounting = off(MOUNTING_M, 7, 3)
    mounting[5:] = off(NEST_OFF_M, 2, 3)
    return replace(
        NOMINAL,
        platform_m=NOMINAL.platform_m + off(JOINT_M, STRUTS, 2),
        base_m=NOMINAL.base_m + off(JOINT_M, STRUTS, 2),
        length_m=NOMINAL.length_m + off(LENGTH_M, STRUTS),
        stiffness_n_per_m=STIFFNESS_N_PER_M * np.exp(LN_STIFFNESS * rng.standard_normal(STRUTS)),
        tilt_rad=off(TILT_RAD, 2),
        scale=1.0 + off(SCALE, 2),
        reflectors_m=NOMINAL.reflectors_m + mounting,
    )


def machine_file() -> str:
    """The nominal machine in the form of a machine file (docs/reference/machine.md)."""

    def numbers(values: object) -> str:
        return "[" + ", ".join(repr(float(value)) for value in np.asarray(values)) + "]"

    lines = [
        "format = 1", 'name = "planar4"', 'degrees_of_freedom = ["x", "y", "rz"]',
        "gravity_m_per_s2 = [0.0, -9.80665, 0.0]", "reference_temperature_c = 20.0", "",
        "[platform]", "tool_point_m = [0.0, 0.0, 0.0]", "moving_mass_kg = 150.0",
        "centre_of_mass_m = [0.0, -0.1, 0.0]", "", "[workspace]", "x_m = [-0.35, 0.35]", "y_m = [-0.3, 0.3]", "",
    ]  # fmt: skip
    for name in DRIVES:
        lines += [
            "[[drives]]", f'name = "{name}"', 'kind = "slider"', "axis = [0.0, 1.0, 0.0]", "branch = 1",
            "travel_m = [0.32, 1.7]", "",
        ]  # fmt: skip
    for i, name in enumerate(STRUT_NAMES):
        lines += [
            "[[struts]]", f'name = "{name}"', f'drive = "{DRIVES[i // 2]}"',
            f"platform_joint_m = {numbers([*NOMINAL.platform_m[i], 0.0])}",
            f"base_joint_m = {numbers([*NOMINAL.base_m[i], 0.0])}", "length_m = 1.5",
            f"stiffness_n_per_m = {STIFFNESS_N_PER_M!r}", "",
        ]  # fmt: skip
    lines += [
        "[tolerances]", f"strut_length_m = {LENGTH_M}", f"platform_joint_m = {JOINT_M}",
        f"base_joint_m = {JOINT_M}", f"axis_tilt_rad = {TILT_RAD}", f"drive_scale = {SCALE}",
        f"ln_stiffness = {LN_STIFFNESS}", f"smr_position_m = {MOUNTING_M}", "",
    ]  # fmt: skip
    for part, sensor in (("struts", "struts"), ("drives", "columns"), ("base", "base"), ("platform", "platform")):
        lines += [
            f"[expansion.{part}]", f"coefficient_per_k = {EXPANSION_PER_K}", "u_per_k = 3e-07",
            f'sensor = "{sensor}"', "",
        ]  # fmt: skip
    for name, on, place in zip(REFLECTORS, ON, NOMINAL.reflectors_m, strict=True):
        lines += ["[[smrs]]", f'name = "{name}"', f'on = "{on}"', f"position_m = {numbers(place)}", ""]
    return "\n".join(lines)
