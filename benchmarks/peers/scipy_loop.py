"""Pose by pose with `scipy.optimize.root` and the analytic Jacobian."""

from __future__ import annotations

import numpy as np
from scipy.optimize import root

from benchmarks.peers.rig import Rig
from benchmarks.peers.statics import Pose, rotation
from calibration.base.arrays import Array


def rests(rig: Rig, method: str) -> tuple[Array, float]:
    """Poses (n, f) as increments of the start's rotation, and the mean number of evaluations."""
    found, evaluations = np.empty((len(rig.drives), len(rig.dof))), 0
    for i in range(len(found)):
        pose, x = problem(rig, i)
        answer = root(pose.balance, x, jac=True, method=method, tol=1e-12)
        found[i] = answer.x
        evaluations += answer.nfev
    return found, evaluations / len(found)


def problem(rig: Rig, i: int) -> tuple[Pose, Array]:
    """Statics of one pose and where to start: the commanded pose."""
    x = rig.start[i].copy()
    first = rotation(x[3:])
    x[3:] = 0.0
    return Pose(rig, *rig.ends(i), first), x[rig.dof]
