"""Pinocchio: kinematics and Jacobians of the platform from the library, springs and Newton's method from us.

Pinocchio is made for rigid trees with exact constraints: it has no elastic loop closures and no statics solver for
them. What is compared is a loop over poses in Python that calls its compiled kinematics (joint placements, frame
Jacobians, generalised gravity, integration on the manifold); the few struts are then numpy, as a user would write.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np

from benchmarks.peers.rig import Rig
from calibration.base.arrays import Array

MOST_STEPS = 40
SHORTEST_STEP = 1e-12


class Newton:
    """One machine: the platform is a planar or a free-flying joint, its joints are frames."""

    def __init__(self, pin: ModuleType, rig: Rig) -> None:
        self._pin, self._rig = pin, rig
        model = pin.Model()
        joint = pin.JointModelPlanar() if rig.machine.planar else pin.JointModelFreeFlyer()
        platform = model.addJoint(0, joint, pin.SE3.Identity(), "platform")
        mass = rig.machine.moving_mass_kg
        model.appendBodyToJoint(platform, pin.Inertia(mass, rig.centre, mass * np.eye(3)), pin.SE3.Identity())
        model.gravity.linear = rig.machine.gravity_m_per_s2
        self._frames = [
            model.addFrame(pin.Frame(f"joint{c}", platform, 0, pin.SE3(np.eye(3), point), pin.FrameType.OP_FRAME))
            for c, point in enumerate(rig.joints)
        ]
        self._model: Any = model
        self._data: Any = model.createData()

    def rests(self) -> tuple[Array, float]:
        """Poses (n, 12), place and rotation by rows, and the mean number of steps."""
        found, steps = np.empty((len(self._rig.drives), 12)), 0
        for i in range(len(found)):
            placement, used = self._rest(i)
            found[i, :3], found[i, 3:] = placement.translation, placement.rotation.ravel()
            steps += used
        return found, steps / len(found)

    def _rest(self, pose: int) -> tuple[Any, int]:
        pin, model, data = self._pin, self._model, self._data
        ends, lengths = self._rig.ends(pose)
        start = self._rig.start[pose]
        if self._rig.machine.planar:
            q = np.array([start[0], start[1], np.cos(start[5]), np.sin(start[5])])
        else:
            q = pin.SE3ToXYZQUAT(pin.SE3(pin.exp3(start[3:]), start[:3]))
        k = self._rig.stiffness
        steps = 0
        for _ in range(MOST_STEPS):
            steps += 1
            pin.computeJointJacobians(model, data, q)
            pin.updateFramePlacements(model, data)
            force = pin.computeGeneralizedGravity(model, data, q)
            rows = []
            stretch = np.empty(len(self._frames))
            for c, frame in enumerate(self._frames):
                v = data.oMf[frame].translation - ends[c]
                length = np.sqrt(v @ v)
                stretch[c] = length - lengths[c]
                jacobian = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
                rows.append((v / length) @ jacobian[:3])
            j = np.array(rows)
            # Gauss-Newton: near rest the geometric stiffness is a ten-thousandth, one or two steps more.
            move = np.linalg.solve(j.T @ (k[:, None] * j), -(force + j.T @ (k * stretch)))
            q = pin.integrate(model, q, move)
            if np.max(np.abs(move)) < SHORTEST_STEP:
                break
        pin.forwardKinematics(model, data, q)
        return data.oMi[1].copy(), steps
