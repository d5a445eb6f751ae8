"""Any machine file as a MuJoCo model at rest: struts are spatial tendons with a stiffness and a spring length.

Sliders are bodies on slide joints, cranks bodies on hinges, both at prescribed coordinates; a telescopic leg is a
longer spring length. The platform moves on slides and a ball joint (a hinge in the plane).

A guide plane is made of a weightless carriage that slides freely along the plane and of two tendons from it to the
held joint, one from each side, `REACH` away, both stretched by `STRETCH` and of half the stiffness. The carriage is at
rest only straight above and below the joint, where the tendons pull with k/2 (e + STRETCH) and k/2 (e - STRETCH) along
the normal: together k e, exactly, at any distance.

Root finding is ours (Newton on MuJoCo's generalised forces); forces and kinematics are MuJoCo's.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from copy import deepcopy
from typing import Any
from xml.sax.saxutils import quoteattr

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tests.calibration.reference_model import Case, Pose, across, named_tilts, planes_of

Array = NDArray[np.float64]
REACH = 0.2
STRETCH = 0.1
WEIGHTLESS = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
DIFFERENCE = 1e-6  # for the derivative of the forces; it sets the rate of convergence, not the root
MOST_STEPS = 40


def with_errors(text: str, theta: Mapping[str, float]) -> dict[str, Any]:
    """The entries of a machine file with named errors applied; drives get a `scale`, guides become `planes`."""
    file = deepcopy(tomllib.loads(text))
    file["planes"] = [plane for guide in file.get("guides", []) for plane in planes_of(guide)]

    def shifted(kind: str, name: str, point: list[float]) -> list[float]:
        return [x + theta.get(f"{kind}.{name}.{c}", 0.0) for x, c in zip(point, "xyz", strict=True)]

    def turned(kind: str, name: str, turns: list[Any], direction: list[float]) -> list[float]:
        tilt = np.zeros(3)
        for t in named_tilts(turns):
            tilt += theta.get(f"{kind}.{name}.{t.label}", 0.0) * np.array(t.about)
        return Rotation.from_rotvec(tilt).apply(direction).tolist()

    for s in file["struts"]:
        s["length_m"] += theta.get(f"strut_length.{s['name']}", 0.0)
        s["platform_joint_m"] = shifted("platform_joint", s["name"], s["platform_joint_m"])
        s["base_joint_m"] = shifted("base_joint", s["name"], s["base_joint_m"])
        s["stiffness_n_per_m"] *= np.exp(theta.get(f"ln_stiffness.{s['name']}", 0.0))
    for d in file["drives"]:
        d["scale"] = 1.0 + theta.get(f"drive_scale.{d['name']}", 0.0)
        if d["kind"] != "leg":
            d["axis"] = turned("axis_tilt", d["name"], across(d["axis"]), d["axis"])
        if d["kind"] == "crank":
            d["pivot_m"] = shifted("pivot", d["name"], d["pivot_m"])
    for plane in file["planes"]:
        offset = theta.get(f"guide_position.{plane['name']}", 0.0)
        plane["point"] = (np.array(plane["point"]) + offset * np.array(plane["normal"])).tolist()
        plane["normal"] = turned("guide_tilt", plane["name"], plane["turns"], plane["normal"])
        plane["stiffness"] *= np.exp(theta.get(f"ln_stiffness.{plane['name']}", 0.0))
    return file


class MujocoMachine:
    """One machine with its errors at one set of drives, loads and temperatures."""

    def __init__(self, file: Mapping[str, Any], case: Case) -> None:
        self.file, self.case = file, case
        self.planar = "rz" in file["degrees_of_freedom"] and len(file["degrees_of_freedom"]) == 3
        self.model = mujoco.MjModel.from_xml_string(self._xml())
        self.data = mujoco.MjData(self.model)
        self.platform = self.model.body("platform").id
        driven = {int(self.model.joint(d["name"]).dofadr[0]) for d in file["drives"] if d["kind"] != "leg"}
        self.unknown = np.array([i for i in range(self.model.nv) if i not in driven])

    def rest(self, start: Pose) -> tuple[Array, Array]:
        """Place (3,) and rotation matrix (3, 3) of the platform where all generalised forces vanish."""
        q = self.data.qpos
        self._begin(start)
        for _ in range(MOST_STEPS):
            forces = self._forces()
            slopes = np.empty((len(self.unknown), len(self.unknown)))
            here = q.copy()
            for column, i in enumerate(self.unknown):
                self._moved(here, i, DIFFERENCE)
                ahead = self._forces()
                self._moved(here, i, -DIFFERENCE)
                slopes[:, column] = (ahead - self._forces()) / (2.0 * DIFFERENCE)
            q[:] = here
            step = np.zeros(self.model.nv)
            step[self.unknown] = np.linalg.solve(slopes, -forces)
            mujoco.mj_integratePos(self.model, q, step, 1.0)
            if np.abs(step).max() < 1e-13:
                break
        else:
            raise RuntimeError(f"the last step is {np.abs(step).max():.1e}")
        mujoco.mj_kinematics(self.model, self.data)
        return self.data.xpos[self.platform].copy(), self.data.xmat[self.platform].reshape(3, 3).copy()

    def _begin(self, start: Pose) -> None:
        for drive, coordinate in zip(self.file["drives"], self.case.drives, strict=True):
            if drive["kind"] != "leg":
                grown = self.case.grown("drives") if drive["kind"] == "slider" else 1.0
                self.data.joint(drive["name"]).qpos[0] = coordinate * drive["scale"] * grown
        for c, value in zip("xyz", start.p, strict=True):
            if not (self.planar and c == "z"):
                self.data.joint(c).qpos[0] = value
        self.data.joint("turn").qpos[:] = 2.0 * np.arctan2(start.q[3], start.q[0]) if self.planar else start.q
        joints = {s["name"]: np.array(s["platform_joint_m"]) for s in self.file["struts"]}
        for plane in self.file["planes"]:
            place = start.place((joints[plane["joint"]] * self.case.grown("platform")).tolist())
            held = np.array(place) - np.array(plane["point"]) * self.case.grown("base")
            for number, along in enumerate(across(plane["normal"])):
                self.data.joint(f"{plane['name']} {number}").qpos[0] = held @ np.array(along)

    def _moved(self, here: Array, dof: int, by: float) -> None:
        self.data.qpos[:] = here
        step = np.zeros(self.model.nv)
        step[dof] = by
        mujoco.mj_integratePos(self.model, self.data.qpos, step, 1.0)

    def _forces(self) -> Array:
        """Generalised forces on the unknown coordinates: springs, gravity, pushes."""
        d = self.data
        mujoco.mj_fwdPosition(self.model, d)
        mujoco.mj_fwdVelocity(self.model, d)
        total = d.qfrc_passive - d.qfrc_bias
        for force, point in self.case.forces:
            lever = d.xmat[self.platform].reshape(3, 3) @ np.array(point) * self.case.grown("platform")
            place = d.xpos[self.platform] + lever
            mujoco.mj_applyFT(self.model, d, np.array(force), np.zeros(3), place, self.platform, total)
        return total[self.unknown]

    # --- the model as text -------------------------------------------------------------------------------------------

    def _xml(self) -> str:
        struts, drives = self.file["struts"], self.file["drives"]
        base, grown = self.case.grown("base"), self.case.grown("drives")
        bodies, tendons, fixed, on_platform = [], [], [], []
        for drive in drives:
            carried = [s for s in struts if s.get("drive") == drive["name"]]
            if drive["kind"] == "leg":
                fixed += carried
                continue
            crank = drive["kind"] == "crank"
            sites = "".join(_site(f"base {s['name']}", s["base_joint_m"], grown if crank else base) for s in carried)
            kind = "hinge" if crank else "slide"
            joint = f'<joint name={quoteattr(drive["name"])} type="{kind}" {_axis(drive["axis"])}/>'
            pivot = drive["pivot_m"] if crank else [0.0, 0.0, 0.0]
            bodies.append(f'<body pos="{_numbers(pivot, base)}" gravcomp="1">{joint}{WEIGHTLESS}{sites}</body>')
        fixed += [s for s in struts if "drive" not in s]
        bodies += [_site(f"base {s['name']}", s["base_joint_m"], base) for s in fixed]
        for s in struts:
            length = s["length_m"] * self.case.grown("struts") + self._longer(s)
            on_platform.append(_site(f"joint {s['name']}", s["platform_joint_m"], self.case.grown("platform")))
            tendons.append(_tendon(f"base {s['name']}", f"joint {s['name']}", s["stiffness_n_per_m"], length))
        for plane in self.file["planes"]:
            bodies.append(self._carriage(plane))
            for side in ("above", "below"):
                ends = (f"{plane['name']} {side}", f"joint {plane['joint']}")
                tendons.append(_tendon(*ends, 0.5 * plane["stiffness"], REACH - STRETCH))
        bodies.append(self._platform("".join(on_platform)))
        return (
            f'<mujoco><compiler angle="radian"/><option gravity="{_numbers(self.file["gravity_m_per_s2"])}">'
            '<flag contact="disable"/></option>'
            f"<worldbody>{''.join(bodies)}</worldbody><tendon>{''.join(tendons)}</tendon></mujoco>"
        )

    def _longer(self, strut: Mapping[str, Any]) -> float:
        for drive, coordinate in zip(self.file["drives"], self.case.drives, strict=True):
            if drive["kind"] == "leg" and drive["name"] == strut.get("drive"):
                return coordinate * drive["scale"] * self.case.grown("drives")
        return 0.0

    def _carriage(self, plane: Mapping[str, Any]) -> str:
        normal, name = np.array(plane["normal"]), plane["name"]
        slides = "".join(
            f'<joint name={quoteattr(f"{name} {number}")} type="slide" {_axis(along)}/>'
            for number, along in enumerate(across(plane["normal"]))
        )
        sites = _site(f"{plane['name']} above", REACH * normal) + _site(f"{plane['name']} below", -REACH * normal)
        place = _numbers(plane["point"], self.case.grown("base"))
        return f'<body pos="{place}" gravcomp="1">{slides}{WEIGHTLESS}{sites}</body>'

    def _platform(self, sites: str) -> str:
        slides = "".join(
            f'<joint name="{c}" type="slide" axis="{x} {y} {z}"/>'
            for c, x, y, z in (("x", 1, 0, 0), ("y", 0, 1, 0), ("z", 0, 0, 1))
            if not (self.planar and c == "z")
        )
        turn = '<joint name="turn" type="hinge" axis="0 0 1"/>' if self.planar else '<joint name="turn" type="ball"/>'
        weights = "".join(
            f'<body><inertial pos="{_numbers(centre, self.case.grown("platform"))}" mass="{float(mass)!r}" '
            'diaginertia="1 1 1"/></body>'
            for mass, centre in self.case.masses
            if mass > 0.0
        )
        # MuJoCo wants a mass in every moving body: the platform's own is held up by `gravcomp`.
        return f'<body name="platform" gravcomp="1">{slides}{turn}{WEIGHTLESS}{sites}{weights}</body>'


def _numbers(vector: Any, by: float = 1.0) -> str:
    return " ".join(repr(float(x) * by) for x in vector)


def _axis(direction: Any) -> str:
    return f'axis="{_numbers(direction)}"'


def _site(name: str, place: Any, by: float = 1.0) -> str:
    return f'<site name={quoteattr(name)} pos="{_numbers(place, by)}"/>'


def _tendon(start: str, end: str, stiffness: float, length: float) -> str:
    return (
        f'<spatial stiffness="{float(stiffness)!r}" springlength="{float(length)!r}">'
        f"<site site={quoteattr(start)}/><site site={quoteattr(end)}/></spatial>"
    )
