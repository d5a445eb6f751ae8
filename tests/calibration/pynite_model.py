"""A machine at rest by a linear frame solver (PyNite), linearised again about each pose that it finds.

Struts are members pinned at both ends, guide planes members along the normal; the platform is a star of rigid members
from its origin to the joints. What a constraint is strained already acts as a load on its joint, as weights and pushes
do on the origin. Where the solver does not move the origin any more the platform is at rest.

The spokes are `RIGID` times as stiff as the struts and leave about that share of the elongations as an error: measured,
it falls in proportion up to 1e6, where the solver begins to refuse the matrix.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from Pynite import FEModel3D
from scipy.spatial.transform import Rotation

from tests.calibration.reference_model import Case, Pose

Array = NDArray[np.float64]
RIGID = 1e5
YOUNG = 2.1e11
SMALL_STEP = 1e-12
MOST_ROUNDS = 12


def rest(file: Mapping[str, Any], case: Case, start: Pose) -> tuple[Array, Array, int]:
    """Place (3,), rotation matrix (3, 3) and the number of linearisations. `file`: `mujoco_model.with_errors`."""
    p, rotation = np.array(start.p), Rotation.from_quat([*start.q[1:], start.q[0]])
    for round_ in range(1, MOST_ROUNDS + 1):
        step = _step(file, case, p, rotation)
        p, rotation = p + step[:3], Rotation.from_rotvec(step[3:]) * rotation
        if np.abs(step).max() < SMALL_STEP:
            return p, rotation.as_matrix(), round_
    raise RuntimeError(f"the last step is {np.abs(step).max():.1e}")


def _step(file: Mapping[str, Any], case: Case, p: Array, rotation: Rotation) -> Array:
    """Displacement and turn (6,) of the platform origin by one linear analysis."""
    frame = FEModel3D()
    frame.add_material("steel", YOUNG, YOUNG / 2.6, 0.3, 0.0)
    frame.add_node("origin", *p.tolist())
    planar = set(file["degrees_of_freedom"]) == {"x", "y", "rz"}
    frame.def_support("origin", False, False, planar, planar, planar, False)
    stiffest = max(s["stiffness_n_per_m"] for s in file["struts"])
    frame.add_section("spoke", RIGID * stiffest / YOUNG, *(3 * [RIGID * stiffest / YOUNG]))

    joints: dict[str, Array] = {}
    for s in file["struts"]:
        lever = rotation.apply(s["platform_joint_m"]) * case.grown("platform")
        joints[s["name"]] = p + lever
        frame.add_node(f"joint {s['name']}", *(p + lever).tolist())
        frame.add_member(f"spoke {s['name']}", "origin", f"joint {s['name']}", "steel", "spoke")
    for s in file["struts"]:
        end, length = _base_end(file, case, s)
        v = joints[s["name"]] - end
        reach = float(np.linalg.norm(v))
        stiffness, residual = s["stiffness_n_per_m"], reach - length
        _pinned(frame, s["name"], s["name"], end=end, reach=reach, stiffness=stiffness, n=v / reach, residual=residual)
    for plane in file["planes"]:
        joint, n = joints[plane["joint"]], np.array(plane["normal"])
        residual = float(n @ (joint - np.array(plane["point"]) * case.grown("base")))
        name, stiffness = plane["name"], plane["stiffness"]
        _pinned(frame, name, plane["joint"], end=joint - n, reach=1.0, stiffness=stiffness, n=n, residual=residual)

    gravity = np.array(file["gravity_m_per_s2"])
    pushes = [(mass * gravity, centre) for mass, centre in case.masses] + list(case.forces)
    for force, point in pushes:
        lever = rotation.apply(point) * case.grown("platform")
        for direction, value in zip(("FX", "FY", "FZ"), force, strict=True):
            frame.add_node_load("origin", direction, float(value))
        for direction, value in zip(("MX", "MY", "MZ"), np.cross(lever, force), strict=True):
            frame.add_node_load("origin", direction, float(value))
    frame.analyze_linear(sparse=False)
    origin = frame.nodes["origin"]
    return np.array([getattr(origin, name)["Combo 1"] for name in ("DX", "DY", "DZ", "RX", "RY", "RZ")])


def _pinned(
    frame: FEModel3D,
    name: str,
    joint: str,
    *,
    end: Array,
    reach: float,
    stiffness: float,
    n: Array,
    residual: float,
) -> None:
    """A member of a stiffness from `end` to a joint along n, and the force of its residual on the joint."""
    frame.add_node(f"base {name}", *end.tolist())
    frame.def_support(f"base {name}", True, True, True, True, True, True)
    area = stiffness * reach / YOUNG
    frame.add_section(f"section {name}", area, area, area, area)
    frame.add_member(name, f"base {name}", f"joint {joint}", "steel", f"section {name}")
    frame.def_releases(name, Rxj=True, Ryi=True, Rzi=True, Ryj=True, Rzj=True)
    for direction, value in zip(("FX", "FY", "FZ"), -stiffness * residual * n, strict=True):
        frame.add_node_load(f"joint {joint}", direction, float(value))


def _base_end(file: Mapping[str, Any], case: Case, strut: Mapping[str, Any]) -> tuple[Array, float]:
    """Base end (3,) and unstrained length of a strut at the drives of a case."""
    length, base = strut["length_m"] * case.grown("struts"), np.array(strut["base_joint_m"])
    for drive, coordinate in zip(file["drives"], case.drives, strict=True):
        if drive["name"] != strut.get("drive"):
            continue
        travel = coordinate * drive["scale"]
        if drive["kind"] == "crank":
            arm = Rotation.from_rotvec(travel * np.array(drive["axis"])).apply(base)
            return np.array(drive["pivot_m"]) * case.grown("base") + arm * case.grown("drives"), length
        travel *= case.grown("drives")
        if drive["kind"] == "leg":
            return base * case.grown("base"), length + travel
        return base * case.grown("base") + travel * np.array(drive["axis"]), length
    return base * case.grown("base"), length
