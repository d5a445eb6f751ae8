"""The free part of a correction: what drives may be moved by without moving the tool, to take away internal force.

With more drives than commanded coordinates a pose can be held by many positions of the drives; they differ in
how far the struts strain one another. The identified model says by how much to move them, but which moves leave
the tool alone depends on the struts' stiffness, and readings tell the product of stiffness and misfit well,
each alone poorly. Moved by d with stiffness known to a share s, the tool moves by something like s d: taken to
the end, internal force of 6 kN costs ten times the uncertainty of the pose (docs/decisions/0027-internal-
force.md). So as much is taken away as lets the predicted uncertainty of the tool grow by no more than a
twentieth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from calibration.base.arrays import Array
from calibration.compensation.correction import ToolError, correct_drives, drive_jacobian, model_error
from calibration.identification.fit import Fit
from calibration.identification.prediction import ROTATION_LEVER_M, rigid_motions, unprojected_derivatives
from calibration.machine.description import Machine
from calibration.machine.inverse import nominal_drives, nominal_poses
from calibration.machine.led_path import tool_coordinates
from calibration.model.operating_conditions import OperatingConditions
from calibration.reduction.report_frame import ReportFrame

MOST_GROWTH = 0.05  # of the tool's predicted standard uncertainty, RMS over the poses
POSES = 64
SEED = 15
STEP = 1e-5  # of a drive, m or rad, for differences of forces
FAR_STEP = 1e-4  # for differences of derivatives
UNKNOWN_STEP = 1e-3  # of an unknown's prior
PRICES = np.logspace(4.0, -6.0, 81)  # of uncertainty in internal force, tried in turn
RIDGE = 1e-9  # of the coefficients that poses leave open, such as shifts that move the tool


@dataclass(frozen=True)
class FreePart:
    """Shifts of the drives, linear in the commanded coordinates over a box (k, 2): coefficients (d, 1 + k), m or rad.

    Of a shift only what leaves the tool alone is taken. u_growth: by which share the tool's predicted U grows.
    """

    machine: Machine
    box: Array
    coefficients: Array
    u_growth: float

    def at(self, target_m: Array) -> Array:
        """Shifts (n, d) at platform poses (n, 6)."""
        return _terms(self.machine, self.box, target_m) @ self.coefficients.T


def strut_forces(fit: Fit, conditions: OperatingConditions, drives: Array, target_m: Array) -> Array:
    """Predicted forces (n, s) of the struts with the drives at (n, d), tension positive."""
    poses = fit.predict(conditions.at_poses(drives, target_m))
    return poses.equilibrium.force_n[:, : len(fit.machine.strut_names)]


def force_u(fit: Fit, conditions: OperatingConditions, drives: Array, target_m: Array) -> Array:
    """Standard uncertainties (n, s) of the predicted forces of the struts, linear in the unknowns."""
    count, visits = len(fit.model), conditions.at_poses(drives, target_m)
    struts, sigma = len(fit.machine.strut_names), fit.layout.sigma[:count]
    columns = []
    for unknown, width in enumerate(UNKNOWN_STEP * sigma):
        step = width * np.eye(count)[unknown]
        ahead, behind = (
            fit.model.predict(fit.unknowns[:count] + sign * step, visits).equilibrium.force_n[:, :struts]
            for sign in (1.0, -1.0)
        )
        columns.append((ahead - behind) / (2.0 * width))
    by_unknown = np.stack(columns, axis=2)
    covariance = fit.covariance[:count, :count]
    return np.sqrt(np.maximum(np.einsum("nsu,uv,nsv->ns", by_unknown, covariance, by_unknown), 0.0))


def find_free_part(fit: Fit, report: ReportFrame, conditions: OperatingConditions, box: Array) -> FreePart:
    """The shifts that leave least elastic energy in the struts while the tool stays as well known, over a box (k, 2).

    Both are quadratic in the coefficients: the energy by the forces' differences with the drives, the uncertainty by
    those of the pose's derivatives, in the frame in which the machine was seen without a correction. The free
    directions are those of the identified model at each pose.
    """
    machine = report.machine
    unit = qmc.Sobol(len(box), seed=SEED).random(POSES)
    target = nominal_poses(machine, box[:, 0] + (box[:, 1] - box[:, 0]) * unit)
    error = model_error(fit, report, conditions)
    drives = correct_drives(machine, error, target)
    good = np.all(np.isfinite(drives), axis=1)
    target, drives = target[good], drives[good]
    terms, free = _terms(machine, box, target), _free_directions(machine, error, drives, target)
    moved = [
        np.einsum("ndf,nf->nd", free, free[:, drive] * terms[:, [term]])
        for drive in range(drives.shape[1])
        for term in range(terms.shape[1])
    ]
    energy = _Quadratic.of(*_strains(fit, conditions, drives, target, moved))
    variance = _Quadratic.of(*_uncertainties(fit, conditions, drives, target, free, moved))
    nothing, best = np.zeros(len(moved)), (np.zeros(len(moved)), 1.0)
    for price in PRICES:
        found = energy.least(variance, price)
        ratio = variance.at(found)
        if ratio > (1.0 + MOST_GROWTH) ** 2:
            break
        if energy.at(found) < min(energy.at(nothing), energy.at(best[0])):
            best = (found, ratio)
    shape = (drives.shape[1], terms.shape[1])
    return FreePart(machine, box, best[0].reshape(shape), float(np.sqrt(best[1])) - 1.0)


@dataclass(frozen=True)
class _Quadratic:
    """|a + B x|^2 as a share of |a|^2: 1 + 2 g x + x H x."""

    slope: Array
    curvature: Array

    @classmethod
    def of(cls, constant: Array, columns: Array) -> _Quadratic:
        size = max(float(constant @ constant), 1e-300)
        return cls(columns.T @ constant / size, columns.T @ columns / size)

    def at(self, x: Array) -> float:
        return float(1.0 + 2.0 * self.slope @ x + x @ self.curvature @ x)

    def least(self, other: _Quadratic, price: float) -> Array:
        """Where this and `price` times the other are least together."""
        curvature = self.curvature + price * other.curvature
        ridge = RIDGE * np.trace(curvature) / len(curvature) * np.eye(len(curvature))
        return np.linalg.solve(curvature + ridge, -(self.slope + price * other.slope))


def _terms(machine: Machine, box: Array, target_m: Array) -> Array:
    """1 and the commanded coordinates, from -1 to 1 over the box (n, 1 + k)."""
    inside = (tool_coordinates(machine, target_m) - box.mean(axis=1)) / (0.5 * np.ptp(box, axis=1))
    return np.hstack([np.ones((len(inside), 1)), inside])


def _free_directions(machine: Machine, error: ToolError, drives: Array, target_m: Array) -> Array:
    """Directions (n, d, f) of the drives' space in which the predicted tool stays where it is."""
    jac = drive_jacobian(error, drives, target_m)[:, machine.commanded]
    return np.linalg.svd(jac)[2][:, jac.shape[1] :].transpose(0, 2, 1)


def _strains(
    fit: Fit, conditions: OperatingConditions, drives: Array, target_m: Array, moved: list[Array]
) -> tuple[Array, Array]:
    """Roots of the struts' elastic energies, and their changes with the coefficients."""
    machine = fit.machine
    root = 1.0 / np.sqrt(machine.nominal.stiffness_n_per_m[: len(machine.strut_names)])
    now = strut_forces(fit, conditions, drives, target_m)
    ahead = [
        (strut_forces(fit, conditions, drives + STEP * axis, target_m) - now) / STEP for axis in np.eye(drives.shape[1])
    ]
    by_drive = np.stack(ahead, axis=2) * root[:, None]
    columns = [np.einsum("nsd,nd->ns", by_drive, shift).ravel() for shift in moved]
    return (now * root).ravel(), np.stack(columns, axis=1)


def _uncertainties(
    fit: Fit, conditions: OperatingConditions, drives: Array, target_m: Array, free: Array, moved: list[Array]
) -> tuple[Array, Array]:
    """The commanded coordinates' derivatives with all unknowns, whitened, and their changes with the coefficients.

    Each kind of coordinate counts as its share of the uncertainty without a free part. The frame is fitted to the poses
    without correction: a shift of all poses against it is an error like any other.
    """
    machine = fit.machine
    values, vectors = np.linalg.eigh(fit.covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    lever = np.where(np.arange(6) < 3, 1.0, ROTATION_LEVER_M)

    def derivatives(at: Array) -> tuple[Array, Array]:
        poses = fit.predict(conditions.at_poses(at, target_m))
        d = unprojected_derivatives(fit.model, fit.layout, poses).both * lever[None, :, None]
        return d @ root, rigid_motions(poses.tool_m(), poses.equilibrium.rotation)

    now, motions = derivatives(drives)
    seen, _ = derivatives(nominal_drives(machine, target_m))
    if any(part.free_rigid_motion for part in fit.instruments):
        in_frame = motions @ (np.linalg.pinv(motions) @ seen.reshape(motions.shape[0], -1))
    else:
        in_frame = np.zeros_like(seen)
    known = now - in_frame.reshape(now.shape)
    weight = np.zeros(6)
    for kind in (machine.commanded[machine.commanded < 3], machine.commanded[machine.commanded > 2]):
        if kind.size:
            weight[kind] = 1.0 / np.sqrt(max(float(np.sum(known[:, kind] ** 2)), 1e-300))
    by_free = np.stack(
        [
            (derivatives(drives + FAR_STEP * free[:, :, f])[0] - now) * (weight / FAR_STEP)[None, :, None]
            for f in range(free.shape[2])
        ],
        axis=3,
    )
    columns = []
    for shift in moved:
        along = np.einsum("ndf,nd->nf", free, shift)
        columns.append(np.einsum("niuf,nf->niu", by_free, along).ravel())
    return (known * weight[None, :, None]).ravel(), np.stack(columns, axis=1)
