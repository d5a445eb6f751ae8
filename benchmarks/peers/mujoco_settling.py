"""MuJoCo: a platform on spatial tendons that is let go and damped until it rests, as one would do with a simulator.

MuJoCo integrates tendon stiffness explicitly, so the step is bounded by the stiffest mode; the damping is in proportion
to the stiffness and about critical for the middle modes. Carriages of sliders are mocap bodies.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np

from benchmarks.peers.rig import Rig
from calibration.base.arrays import Array

STEP_S = 1e-4
STEPS_AT_ONCE = 25
MOST_STEPS = 20_000
STILL = 1e-13  # m/step, of the fastest coordinate


class Settling:
    """One machine; poses are set by the tendons' lengths (legs) or the carriages' places (sliders)."""

    def __init__(self, mujoco: ModuleType, rig: Rig) -> None:
        self._mujoco, self._rig = mujoco, rig
        self._model: Any = mujoco.MjModel.from_xml_string(self._xml())
        self._data: Any = mujoco.MjData(self._model)
        self._planar = rig.machine.planar

    def rests(self) -> tuple[Array, float]:
        """Poses (n, 7), place and quaternion, and the mean number of steps."""
        found, steps = np.empty((len(self._rig.drives), 7)), 0
        body = self._model.body("platform").id
        for i in range(len(found)):
            steps += self._settle(i)
            self._mujoco.mj_kinematics(self._model, self._data)
            found[i, :3], found[i, 3:] = self._data.xpos[body], self._data.xquat[body]
        return found, steps / len(found)

    def _settle(self, pose: int) -> int:
        model, data = self._model, self._data
        ends, lengths = self._rig.ends(pose)
        self._mujoco.mj_resetData(model, data)
        model.tendon_lengthspring[:] = lengths[:, None]
        data.mocap_pos[:] = ends
        start = self._rig.start[pose]
        if self._planar:
            data.qpos[:] = start[[0, 1, 5]]
        else:
            data.qpos[:3] = start[:3]
            angle = np.linalg.norm(start[3:])
            axis = start[3:] / angle if angle > 0.0 else np.zeros(3)
            data.qpos[3:] = np.concatenate([[np.cos(0.5 * angle)], np.sin(0.5 * angle) * axis])
        for steps in range(STEPS_AT_ONCE, MOST_STEPS, STEPS_AT_ONCE):
            self._mujoco.mj_step(model, data, STEPS_AT_ONCE)
            if np.max(np.abs(data.qvel)) * STEP_S < STILL:
                return steps
        return MOST_STEPS

    def _xml(self) -> str:
        rig, machine = self._rig, self._rig.machine
        mass, centre = machine.moving_mass_kg, _text(rig.centre)
        inertia = mass * 0.15**2
        fastest = float(np.sqrt(np.sum(rig.stiffness) / mass))
        bodies, sites, tendons = [], [], []
        for c, joint in enumerate(rig.joints):
            bodies.append(f'<body name="end{c}" mocap="true"><site name="base{c}"/></body>')
            sites.append(f'<site name="joint{c}" pos="{_text(joint)}"/>')
            k = float(rig.stiffness[c])
            tendons.append(
                f'<spatial stiffness="{k!r}" damping="{k / fastest!r}" springlength="1"><site site="base{c}"/>'
                f'<site site="joint{c}"/></spatial>'
            )
        joints = "<freejoint/>"
        if machine.planar:
            joints = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint axis="0 0 1"/>'
        return (
            f'<mujoco><compiler angle="radian"/><option timestep="{STEP_S}" integrator="implicit" '
            f'gravity="{_text(machine.gravity_m_per_s2)}"><flag contact="disable"/></option>'
            f'<worldbody>{"".join(bodies)}<body name="platform">{joints}'
            f'<inertial pos="{centre}" mass="{mass}" diaginertia="{inertia} {inertia} {inertia}"/>{"".join(sites)}'
            f"</body></worldbody><tendon>{''.join(tendons)}</tendon></mujoco>"
        )


def _text(vector: Array) -> str:
    return " ".join(repr(float(x)) for x in vector)
