"""Equilibria of many moments at once, for structures that effects have changed: force laws, compliant carriages, loads.

The unknowns of a moment are the platform's x, y, rz and, where a carriage gives way, its motion along, across and in
yaw. Newton's iteration with the linear part of the Hessian: what it leaves out is a ten-thousandth (force over length
against stiffness), so that it still gains four digits a step; the gradient, and so the solution, is exact.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mock_devices.effects.base import Array, Complex, Law
from mock_devices.plant.structure import NoEquilibrium

_TOLERANCE = 2e-12
_MOST_STEPS = 150
_LONGEST_STEP = 0.05
_RIGID = 1.0e16


@dataclass(frozen=True)
class Structure:
    """n moments of one structure; all arrays have n rows.

    platform_joint, base_joint: complex (n, s); centre: complex (n, d), about which carriages yaw; axis: (d,).
    loads: points of the platform and forces, complex (n,) each. compliance, hardening: (n, d, 3), or None if rigid.
    """

    platform_joint: Complex
    base_joint: Complex
    length_m: Array
    stiffness: Array
    drive: tuple[int, ...]
    axis: Complex
    centre: Complex
    loads: list[tuple[Complex, Complex]]
    moment_nm: Array
    laws: dict[int, list[Law]] = field(default_factory=dict)
    compliance: Array | None = None
    hardening: Array | None = None


@dataclass(frozen=True)
class Equilibria:
    """Where n moments come to rest: platform origin, rotation, carriage motion (n, d, 3), strut forces (n, s)."""

    p: Complex
    rz_rad: Array
    carriage: Array
    force_n: Array


def start(structure: Structure, branch: int, first: int, other: int) -> Complex:
    """Where two struts meet on the side of the branch: the start for Newton (n,)."""
    a = structure.base_joint[:, first] - structure.platform_joint[:, first]
    b = structure.base_joint[:, other] - structure.platform_joint[:, other]
    la, lb = structure.length_m[:, first], structure.length_m[:, other]
    apart = b - a
    distance = np.abs(apart)
    along = (distance**2 + la**2 - lb**2) / (2.0 * distance)
    if not np.all(np.abs(along) <= la):
        raise NoEquilibrium("the struts do not reach each other")
    direction = apart / distance
    across = 1j * direction * np.sqrt(la**2 - along**2)
    up = structure.axis[structure.drive[first]]
    candidate = a + along * direction + across
    below = branch * ((a - candidate) * np.conj(up)).real > 0.0
    return np.where(below, candidate, a + along * direction - across)


def solve(structure: Structure, p: Complex) -> Equilibria:
    """The poses at rest near `p`; raises NoEquilibrium."""
    n, drives = len(p), len(structure.axis)
    soft = structure.compliance is not None
    size = 3 + (3 * drives if soft else 0)
    rz, u = np.zeros(n), np.zeros((n, drives, 3))
    stiff = _stiffness(structure.compliance) if structure.compliance is not None else None
    force = np.zeros_like(structure.length_m)
    damping, last = np.ones(n), np.full(n, np.inf)
    for _ in range(_MOST_STEPS):
        turn = np.exp(1j * rz)[:, None]
        slopes, elongation = _elongation_derivatives(structure, p, turn, u, size)
        force, tangent = _forces(structure, elongation)
        gradient = np.einsum("nsk,ns->nk", slopes, force)
        hessian = np.matmul(np.swapaxes(slopes, 1, 2), slopes * tangent[:, :, None])
        for point, load in structure.loads:
            gradient[:, 0] -= load.real
            gradient[:, 1] -= load.imag
            gradient[:, 2] -= (np.conj(1j * turn[:, 0] * point) * load).real
        gradient[:, 2] -= structure.moment_nm
        if stiff is not None:
            _add_carriages(structure, stiff, u, gradient, hessian)
        step = np.linalg.solve(hessian, gradient[:, :, None])[:, :, 0]
        if not np.all(np.isfinite(step)):
            break
        length = np.abs(step[:, 0]) + np.abs(step[:, 1]) + np.abs(step[:, 2])
        # Where a law has a kink Newton can jump to and fro across it: shorter steps wherever they do not shrink.
        shrank = length <= (1.0 - 0.3 * damping) * last
        damping = np.where(shrank, np.minimum(1.0, 1.5 * damping), 0.5 * damping)
        last = length
        step *= (damping * np.minimum(1.0, _LONGEST_STEP / np.maximum(length, 1e-300)))[:, None]
        p = p - (step[:, 0] + 1j * step[:, 1])
        rz = rz - step[:, 2]
        if soft:
            u = u - step[:, 3:].reshape(n, drives, 3)
        if float(length.max(initial=0.0)) < _TOLERANCE:
            return Equilibria(p, rz, u, force)
    raise NoEquilibrium("no equilibrium of the structure with its effects")


def _elongation_derivatives(
    structure: Structure, p: Complex, turn: Complex, u: Array, size: int
) -> tuple[Array, Array]:
    """Derivatives of the elongations (n, s, size) and the elongations (n, s)."""
    joint = turn * structure.platform_joint
    which = list(structure.drive)
    axis, centre = structure.axis[which], structure.centre[:, which]
    arm = structure.base_joint - centre
    base = structure.base_joint
    if size > 3:
        mine = u[:, which]
        arm = arm * np.exp(1j * mine[:, :, 2])
        base = centre + arm + axis * (mine[:, :, 0] + 1j * mine[:, :, 1])
    way = p[:, None] + joint - base
    length = np.abs(way)
    unit = way / length
    slopes = np.zeros((*length.shape, size))
    slopes[:, :, 0], slopes[:, :, 1] = unit.real, unit.imag
    slopes[:, :, 2] = (np.conj(unit) * 1j * joint).real
    if size > 3:
        for i, a in enumerate(which):
            slopes[:, i, 3 + 3 * a] = -(np.conj(unit[:, i]) * axis[i]).real
            slopes[:, i, 4 + 3 * a] = -(np.conj(unit[:, i]) * 1j * axis[i]).real
            slopes[:, i, 5 + 3 * a] = -(np.conj(unit[:, i]) * 1j * arm[:, i]).real
    return slopes, length - structure.length_m


def _forces(structure: Structure, elongation: Array) -> tuple[Array, Array]:
    """Forces and their derivatives (n, s). Of several laws of one strut the last one counts."""
    force, tangent = structure.stiffness * elongation, structure.stiffness.copy()
    for i, laws in structure.laws.items():
        force[:, i], tangent[:, i] = laws[-1](elongation[:, i], structure.stiffness[:, i])
    return force, tangent


def _stiffness(compliance: Array) -> Array:
    return np.asarray(1.0 / np.maximum(compliance, 1.0 / _RIGID))


def _add_carriages(structure: Structure, stiff: Array, u: Array, gradient: Array, hessian: Array) -> None:
    """What holds the carriages: k u + c u^3."""
    cubic = structure.hardening if structure.hardening is not None else np.zeros_like(stiff)
    n = len(u)
    gradient[:, 3:] += (stiff * u + cubic * u**3).reshape(n, -1)
    k = np.arange(3, hessian.shape[1])
    hessian[:, k, k] += (stiff + 3.0 * cubic * u**2).reshape(n, -1)
