"""A control's own kinematics with the parameters that come nearest to the full correction.

A control that knows the machine computes each drive from the pose by a formula with few rigid parameters. They are
fitted to the drive positions that put the tool where it is commanded, load included: so they take along what of
stiffness and payload looks like geometry, and need no frame of their own. What they cannot carry is the loss.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from calibration.base.arrays import Array
from calibration.base.rotation import rotation_matrix
from calibration.compensation.correction import Correction, Samples
from calibration.machine.description import Machine

# Of the prior, against the samples: it decides only what they leave open, such as a joint moved along all struts alike.
PRIOR_WEIGHT = 1e-4

Formula = Callable[[Array, Array], Array]
"""(parameters (p,), tool poses (n, 6)) -> drive coordinates (n, d)."""


@dataclass(frozen=True)
class Kinematics:
    """A control's kinematics with parameters: nominal ones, and the calibrated."""

    formula: Formula
    nominal: Array
    values: Array

    def drives(self, pose: Array) -> Array:
        """Drive coordinates (n, d) that the control computes for tool poses (n, 6)."""
        return self.formula(self.values, pose)


@dataclass(frozen=True)
class KinematicsFiles:
    """Files (name to text), the kinematics as the control will read them, rounding included."""

    files: Mapping[str, str]
    kinematics: Kinematics


@dataclass(frozen=True)
class KinematicsFormat:
    """A control's kinematics. refusal: why a machine is not of this kind, None if it is; build: fit, round, write."""

    name: str
    title: str
    control: str
    parameters: str
    read_by: str | None
    refusal: Callable[[Machine], str | None]
    build: Callable[[Correction, tuple[str, ...]], KinematicsFiles]

    @property
    def trial(self) -> str:
        """Whether the control has read such a file, in one sentence."""
        if self.read_by is None:
            return f"No {self.control} has read a file of ours yet: try it with the axes held."
        return f"Read by {self.read_by}."


def tool_poses(machine: Machine, target_m: Array) -> Array:
    """Tool poses (n, 6), point in m and rotation vector in rad, of platform poses (n, 6)."""
    tool = target_m.copy()
    tool[:, :3] += rotation_matrix(target_m[:, 3:]) @ machine.tool_point_m
    return tool


def fit_parameters(formula: Formula, nominal: Array, sigma: Array, machine: Machine, samples: Samples) -> Kinematics:
    """The parameters (p,) whose drive positions come nearest to the corrected ones, in least squares.

    sigma (p,): how far they may be from nominal, roughly; in these units they are searched.
    """
    pose = tool_poses(machine, samples.target_m)
    wanted = samples.drives + samples.correction
    size = max(float(np.sqrt(np.mean(samples.correction**2))), 1e-9)

    def residual(x: Array) -> Array:
        off = (formula(nominal + sigma * x, pose) - wanted) / size
        return np.concatenate([off.ravel() / np.sqrt(off.size), PRIOR_WEIGHT * x])

    found = least_squares(residual, np.zeros(nominal.size), method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    return Kinematics(formula, nominal, nominal + sigma * found.x)


@dataclass(frozen=True)
class KinematicsLoss:
    """What a kinematics leaves of the corrections at other poses, and how large those were: (d,) each, m."""

    max_left: Array
    rms_left: Array
    max_before: Array
    rms_before: Array

    @classmethod
    def of(cls, kinematics: Kinematics, machine: Machine, samples: Samples) -> KinematicsLoss:
        """At the poses of some samples."""
        left = samples.drives + samples.correction - kinematics.drives(tool_poses(machine, samples.target_m))
        return cls(
            np.max(np.abs(left), axis=0),
            np.sqrt(np.mean(left**2, axis=0)),
            np.max(np.abs(samples.correction), axis=0),
            np.sqrt(np.mean(samples.correction**2, axis=0)),
        )

    @property
    def remaining_share(self) -> float:
        """RMS over all drives of what is left, as a share of that of the corrections."""
        return float(np.sqrt(np.sum(self.rms_left**2) / max(float(np.sum(self.rms_before**2)), 1e-300)))
