"""The true machine's carriages, struts and platform in MuJoCo: where the platform hangs.

In the plane of motion: x to the right, y up, rotation about z. A strut is a spring between two joints. Clearance is a
pin in a wider bore, which may be anywhere inside and stands against its wall under load; a soft strut has a second
spring, and a stop that takes over once that is pressed home; a soft column lets its carriage yield sideways and tilt.
The platform is let go and damped until it rests.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import mujoco  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from benchmarks.emergent.drive_model import CARRIAGE_KG, SOLIMP, SOLREF, STEP_S

Array = NDArray[np.float64]

PIN_KG = 8.0  # without weight, as the struts
STEPS_AT_ONCE, MOST_STEPS = 20, 20_000
STILL_M_PER_S = 2e-9
STRUTS, SLIDERS = 4, 2
GRAVITY = 9.80665
PAYLOADS_KG = (0.0, 150.0, 300.0)
# Beside the platform's middle: otherwise struts bear hardly more with a payload than without.
CENTRES_M = ((0.0, 0.0), (0.25, -0.15), (-0.2, -0.05))
LEVER_M = 0.25  # of a carriage's joints, by which the stiffness of its guide against tilting is stated


@dataclass(frozen=True)
class Machine:
    """A true machine, or its nominal one. Lengths in m, machine's axes.

    platform_m, base_m (4, 2): joints on the platform, and on the carriages with the drives at zero; length_m,
    stiffness_n_per_m (4,); tilt_rad (2,): of each slide from upright, anticlockwise; scale (2,): of each drive;
    reflectors_m (7, 3): three on the platform, one on each carriage, two nests.
    """

    platform_m: Array
    base_m: Array
    length_m: Array
    stiffness_n_per_m: Array
    tilt_rad: Array
    scale: Array
    reflectors_m: Array
    mass_kg: float = 150.0
    centre_m: tuple[float, float] = (0.0, -0.1)

    def carriages_m(self, drives_m: Array) -> Array:
        """Places (..., 2 drives, 2) that the drives (..., 2) take their carriages to, from those at zero."""
        along = drives_m * self.scale
        return np.stack([-np.sin(self.tilt_rad) * along, np.cos(self.tilt_rad) * along], axis=-1)


@dataclass(frozen=True)
class StrutParts:
    """What struts and columns are made of; the defaults are good ones. All by number of strut (4,) or column (2,).

    clearance_m: each way; soft_n_per_m: of a second spring in the strut (infinite: none); stop_m: how far that goes
    until a stop takes over; column_n_per_m: of the guide across the slide, and at LEVER_M against tilting.
    """

    clearance_m: tuple[float, ...] = (0.0,) * STRUTS
    soft_n_per_m: tuple[float, ...] = (math.inf,) * STRUTS
    stop_m: tuple[float, ...] = (math.inf,) * STRUTS
    column_n_per_m: tuple[float, ...] = (math.inf,) * SLIDERS


@dataclass(frozen=True)
class Hanging:
    """Where all rest: pose (3,) x, y, rotation; carriages (2, 3): x, y over the place of drive zero, tilt."""

    pose: Array
    carriages: Array = field(default_factory=lambda: np.zeros((SLIDERS, 3)))


class Struts:
    """The machine let go, pose after pose; pins stay in their bores where the former pose left them."""

    def __init__(self, machine: Machine, parts: StrutParts) -> None:
        self.machine, self.parts = machine, parts
        self._models = [mujoco.MjModel.from_xml_string(_xml(machine, parts, k)) for k in range(len(PAYLOADS_KG))]
        self._data = [mujoco.MjData(model) for model in self._models]
        model: Any = self._models[0]
        self._pins = [i for i in range(STRUTS) if _has_pin(parts, i)]
        self._soft = [a for a in range(SLIDERS) if math.isfinite(parts.column_n_per_m[a])]
        self._pin_at = {i: int(model.joint(f"pin{i}x").qposadr[0]) for i in self._pins}
        self._carriage_at = {a: int(model.joint(f"carriage{a}x").qposadr[0]) for a in self._soft}
        self._body = [int(model.body(f"carriage{a}").mocapid[0]) for a in range(SLIDERS)]
        self._in_bore = {i: np.zeros(2) for i in self._pins}

    def rest(self, drives_m: Array, near: Array, payload: int = 0) -> Hanging:
        """Let go near a pose (3,), with the carriages where the drives (2,) are; found when nothing moves."""
        model, data = self._models[payload], self._data[payload]
        mujoco.mj_resetData(model, data)
        places = self.machine.carriages_m(drives_m)
        for a in range(SLIDERS):
            data.mocap_pos[self._body[a]] = (*places[a], 0.0)
        data.qpos[:3] = near
        for i in self._pins:
            data.qpos[self._pin_at[i] : self._pin_at[i] + 2] = self._bore(near, i) + self._in_bore[i]
        for _ in range(0, MOST_STEPS, STEPS_AT_ONCE):
            mujoco.mj_step(model, data, STEPS_AT_ONCE)
            if np.max(np.abs(data.qvel)) < STILL_M_PER_S:
                break
        pose = data.qpos[:3].copy()
        for i in self._pins:
            self._in_bore[i] = data.qpos[self._pin_at[i] : self._pin_at[i] + 2] - self._bore(pose, i)
        carriages = np.column_stack([places, np.zeros(SLIDERS)])
        for a, at in self._carriage_at.items():
            carriages[a, 0] += data.qpos[at]
            carriages[a, 2] = data.qpos[at + 1]
        return Hanging(pose, carriages)

    def _bore(self, pose: Array, i: int) -> Array:
        return pose[:2] + turned(self.machine.platform_m[i], pose[2])


def turned(point_m: Array, angle_rad: float) -> Array:
    """A point (2,) turned anticlockwise."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([c * point_m[0] - s * point_m[1], s * point_m[0] + c * point_m[1]])


def carriage_centre(machine: Machine, a: int) -> Array:
    """What a carriage tilts about (2,), with the drive at zero: the middle of its two joints."""
    return np.asarray(machine.base_m[2 * a : 2 * a + 2].mean(axis=0))


def _has_pin(parts: StrutParts, i: int) -> bool:
    return parts.clearance_m[i] > 0.0 or math.isfinite(parts.soft_n_per_m[i])


def _xml(machine: Machine, parts: StrutParts, payload: int) -> str:
    carried, own = PAYLOADS_KG[payload], machine.mass_kg
    mass = own + carried
    centre = (own * np.array(machine.centre_m) + carried * np.array(CENTRES_M[payload])) / mass
    fastest = math.sqrt(float(np.sum(machine.stiffness_n_per_m)) / mass)
    sites, tendons = [], []
    bodies = [_carriage(machine, parts, a) for a in range(SLIDERS)]
    for i in range(STRUTS):
        sites.append(f'<site name="bore{i}" pos="{_text(machine.platform_m[i])}"/>')
        k, end = float(machine.stiffness_n_per_m[i]), f"bore{i}"
        if _has_pin(parts, i):
            end = f"pin{i}"
            damping = 0.3 * math.sqrt(k * PIN_KG)
            slides = "".join(
                f'<joint name="pin{i}{n}" type="slide" axis="{axis}" damping="{damping}"/>'
                for n, axis in (("x", "1 0 0"), ("y", "0 1 0"))
            )
            inertial = f'<inertial pos="0 0 0" mass="{PIN_KG}" diaginertia="1 1 1"/>'
            bodies.append(f'<body gravcomp="1">{slides}{inertial}<site name="pin{i}"/></body>')
            tendons.append(_bore(machine, parts, i))
        tendons.append(
            f'<spatial stiffness="{k}" damping="{k / fastest}" springlength="{float(machine.length_m[i])}">'
            f'<site site="base{i}"/><site site="{end}"/></spatial>'
        )
    inertia = mass * 0.15**2
    platform = (
        '<body><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint axis="0 0 1"/>'
        f'<inertial pos="{_text(centre)}" mass="{mass}" '
        f'diaginertia="{inertia} {inertia} {inertia}"/>{"".join(sites)}</body>'
    )
    return (
        f'<mujoco><compiler angle="radian"/><option timestep="{STEP_S}" integrator="implicit" '
        f'gravity="0 {-GRAVITY} 0" iterations="50" noslip_iterations="8"><flag contact="disable"/></option>'
        f"<worldbody>{platform}{''.join(bodies)}</worldbody><tendon>{''.join(tendons)}</tendon></mujoco>"
    )


def _bore(machine: Machine, parts: StrutParts, i: int) -> str:
    """What holds a pin to its bore: a wall all around it, or a spring and the wall once that is pressed home."""
    soft, wall = parts.soft_n_per_m[i], parts.clearance_m[i]
    spring = ""
    if math.isfinite(soft):
        wall = parts.stop_m[i]
        spring = f'stiffness="{soft}" damping="{0.3 * math.sqrt(soft * PIN_KG)}" springlength="0"'
    if math.isfinite(wall):
        spring += f' limited="true" range="0 {wall}" solreflimit="{SOLREF}" solimplimit="{SOLIMP}"'
    return f'<spatial {spring}><site site="pin{i}"/><site site="bore{i}"/></spatial>'


def _carriage(machine: Machine, parts: StrutParts, a: int) -> str:
    """A carriage where its drive holds it; with a soft column, on springs across the slide and against tilting."""
    k, centre = parts.column_n_per_m[a], carriage_centre(machine, a)
    soft = math.isfinite(k)
    sites = "".join(
        f'<site name="base{i}" pos="{_text(machine.base_m[i] - (centre if soft else 0.0))}"/>'
        for i in (2 * a, 2 * a + 1)
    )
    if not soft:
        return f'<body name="carriage{a}" mocap="true">{sites}</body>'
    inertia = CARRIAGE_KG * LEVER_M**2
    damping, turning = math.sqrt(k * CARRIAGE_KG), math.sqrt(k * LEVER_M**2 * inertia)
    return (
        f'<body name="carriage{a}" mocap="true"><body pos="{_text(centre)}" gravcomp="1">'
        f'<joint name="carriage{a}x" type="slide" axis="1 0 0" stiffness="{k}" damping="{damping}"/>'
        f'<joint name="carriage{a}tilt" type="hinge" axis="0 0 1" stiffness="{k * LEVER_M**2}" damping="{turning}"/>'
        f'<inertial pos="0 0 0" mass="{CARRIAGE_KG}" diaginertia="{inertia} {inertia} {inertia}"/>{sites}</body></body>'
    )


def _text(point_m: Array) -> str:
    return f"{float(point_m[0])} {float(point_m[1])} 0"
