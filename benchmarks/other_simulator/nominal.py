"""Nominal machines: drawn around three machine files, as a recording's machine.toml states them."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np

Description = dict[str, Any]  # a machine file, parsed

# Copies of the shipped files of these names: a shipped file that is changed must change no recording.
MACHINES = Path(__file__).parent / "machines"
PLANAR, DELTA, STEWART = "planar4", "delta6", "stewart6"

DRIVE_NAMES = [("left", "right"), ("L", "R"), ("z1", "z2"), ("axis_a", "axis_b")]
LEADS_M = [0.005, 0.008, 0.010, 0.016, 0.020, 0.032]
PITCHES_M = [2e-5, 4e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3]
SPATIAL_LEADS_M, SPATIAL_PITCHES_M = [0.005, 0.01, 0.02], [4e-5, 2e-4, 1e-3]
BEYOND_WORKSPACE_M = 0.07  # travel that a drive has left at the edge of the workspace


def draw_nominal(base: str, rng: np.random.Generator) -> Description:
    """A machine like the file `base`: PLANAR, DELTA or STEWART."""
    return _draw_planar(rng) if base == PLANAR else _draw_spatial(base, rng)


def _read(base: str) -> Description:
    return tomllib.loads((MACHINES / f"{base}.toml").read_text(encoding="utf-8"))


def _draw_name(kind: str, rng: np.random.Generator) -> str:
    return f"{kind}_" + "".join(rng.choice(list("abcdefgh"), 4))


def _about(value: float, rng: np.random.Generator) -> float:
    return value * float(rng.uniform(0.8, 1.2))


def _rounded(values: list[float], digits: int) -> list[float]:
    return [round(float(value), digits) for value in values]


def _draw_planar(rng: np.random.Generator) -> Description:
    """Each dimension within 20 % of that of the file; again until the struts reach all of the workspace."""
    out = _read(PLANAR)
    while True:
        drawn = [_about(value, rng) for value in (0.2, 0.125, 1.2, 1.5, 0.35, 0.30)]
        joint_x, joint_y, column_x, length, half_x, half_y = _rounded(drawn, 3)
        if length > 1.10 * (column_x - joint_x + half_x) and (column_x - joint_x - half_x) > 0.25:
            break
    names = DRIVE_NAMES[rng.integers(len(DRIVE_NAMES))]
    out["name"] = _draw_name("planar", rng)
    out["platform"]["moving_mass_kg"] = round(_about(150.0, rng), 1)
    out["platform"]["centre_of_mass_m"] = [0.0, round(_about(-0.1, rng), 3), 0.0]
    out["workspace"] = {"x_m": [-half_x, half_x], "y_m": [-half_y, half_y]}
    drives_m = [
        y + np.sqrt(length**2 - (column_x - joint_x + x) ** 2) for y in (-half_y, half_y) for x in (-half_x, 0, half_x)
    ]
    travel_m = _rounded([min(drives_m) - BEYOND_WORKSPACE_M, max(drives_m) + BEYOND_WORKSPACE_M], 3)
    stiffness = float(f"{10 ** rng.uniform(7.0, 8.0):.2g}")
    rng.integers(3)  # decides nothing; without it all that is drawn later would be another
    out["drives"] = [
        {"name": name, "kind": "slider", "axis": [0.0, 1.0, 0.0], "branch": 1, "travel_m": list(travel_m)}
        for name in names
    ]
    out["struts"] = [
        {
            "name": f"{name}_{end}", "drive": name,
            "platform_joint_m": [side * joint_x, above * joint_y, 0.0],
            "base_joint_m": [side * column_x, above * joint_y, 0.0],
            "length_m": length, "stiffness_n_per_m": stiffness,
        }
        for name, side in zip(names, (-1, 1), strict=True)
        for end, above in (("upper", 1), ("lower", -1))
    ]  # fmt: skip
    for key, choice in (("lead_m", LEADS_M), ("scale_pitch_m", PITCHES_M)):
        if rng.random() < 0.5:
            _state(out, key, float(rng.choice(choice)))
    out["smrs"] = [
        {"name": name, "on": on, "position_m": _rounded(place, 4)}
        for name, on, place in _draw_reflectors(names, joint_x, column_x, rng)
    ]
    out.pop("load_cases", None)
    return out


def _draw_reflectors(
    drives: tuple[str, str], joint_x: float, column_x: float, rng: np.random.Generator
) -> list[tuple[str, str, list[float]]]:
    """Names, carriers and places: three of the platform, one of each slider, two to four nests."""

    def about(value: float) -> float:
        return _about(value, rng)

    nests = int(rng.integers(2, 5))
    on_platform = [
        ("P1", "platform", [-joint_x, about(-0.12), 0.1]),
        ("P2", "platform", [joint_x, about(-0.12), 0.1]),
        ("P3", "platform", [about(0.02), about(0.2), 0.1]),
    ]
    on_sliders = [
        ("S1", drives[0], [-column_x, about(0.03), 0.1]),
        ("S2", drives[1], [column_x, about(-0.03), 0.1]),
    ]
    on_floor = [
        ("N1", "floor", [about(-0.8), about(-1.1), 0.1]),
        ("N2", "floor", [about(0.8), about(-1.1), 0.1]),
        ("N3", "floor", [about(-1.1), about(-1.0), about(0.6)]),
        ("N4", "floor", [about(1.1), about(-1.0), about(0.6)]),
    ]
    return on_platform + on_sliders + on_floor[:nests]


def _draw_spatial(base: str, rng: np.random.Generator) -> Description:
    """All lengths by one factor, which keeps branches and travels sound."""
    out = _read(base)
    out["name"] = _draw_name(base, rng)
    factor = rng.uniform(0.9, 1.15)

    def scaled(values: list[float]) -> list[float]:
        return [round(float(value) * factor, 6) for value in values]

    platform = out["platform"]
    platform["tool_point_m"] = scaled(platform["tool_point_m"])
    platform["centre_of_mass_m"] = scaled(platform["centre_of_mass_m"])
    platform["moving_mass_kg"] = round(platform["moving_mass_kg"] * rng.uniform(0.8, 1.2), 1)
    for key in ("x_m", "y_m", "z_m"):
        out["workspace"][key] = scaled(out["workspace"][key])
    stiffness = float(f"{out['struts'][0]['stiffness_n_per_m'] * 10 ** rng.uniform(-1, 0):.2g}")
    for strut in out["struts"]:
        strut["platform_joint_m"] = scaled(strut["platform_joint_m"])
        strut["base_joint_m"] = scaled(strut["base_joint_m"])
        strut["length_m"] = round(strut["length_m"] * factor, 6)
        strut["stiffness_n_per_m"] = stiffness
    for drive in out["drives"]:
        drive["travel_m"] = scaled(drive["travel_m"])
    for key, choice in (("lead_m", SPATIAL_LEADS_M), ("scale_pitch_m", SPATIAL_PITCHES_M)):
        if rng.random() < 0.5:
            _state(out, key, float(rng.choice(choice)))
    for smr in out["smrs"]:
        smr["position_m"] = scaled(smr["position_m"])
    return out


def _state(description: Description, key: str, value: float) -> None:
    for drive in description["drives"]:
        drive[key] = value
