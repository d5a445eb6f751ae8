"""The function that a certified problem's answer minimises, from the reference model alone.

`Objective` evaluates it for one set of errors in any arithmetic, `ManyDraws` in double precision for many sets at once,
with its derivatives. Nothing here imports `calibration`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mpmath
import numpy as np
from numpy.typing import NDArray

from tests.calibration.reference_model import (
    COORDINATES,
    DOUBLE,
    PARTS,
    TINY,
    Arithmetic,
    Case,
    Number,
    Pose,
    ReferenceModel,
    Vector,
    added,
    quaternion,
    quaternion_product,
    scaled,
    solved,
)

Array = NDArray[np.float64]
WIDTH = "1e-18"  # of central differences: an error of its square, far below the digits stated


class Objective:
    """A stored problem as a function of the errors, for any arithmetic."""

    def __init__(self, problem: Mapping[str, Any], maths: Arithmetic = DOUBLE) -> None:
        self.maths = maths
        self.model = ReferenceModel(problem["machine_toml"], maths)
        kinds = problem["unknowns"]
        self.names = [n for n in self.model.names if n.partition(".")[0] in kinds]
        root = maths.sqrt(maths.number(3.0))
        self.prior = [maths.number(self.model.tolerance(n)) / root for n in self.names]
        self.chosen = [COORDINATES.index(c) for c in problem["coordinates"]]
        self.sigma = [maths.number(s) for s in problem["sigma"]]
        self.readings = problem["readings"]
        self.cases = [self._case(r) for r in self.readings]
        self.measured = [([maths.number(x) for x in r["tool"][:3]], self._turn(r["tool"][3:])) for r in self.readings]
        self.starts = [self._start(r["start"]) for r in self.readings]

    def _case(self, reading: Mapping[str, Any]) -> Case:
        number = self.maths.number
        payload = (number(reading["payload_kg"]), [number(x) for x in reading["payload_com_m"]])
        reference = self.model.file["reference_temperature_c"]
        growth = {}
        for part in PARTS:
            entry = self.model.file["expansion"][part]
            warmth = number(reading["temperatures_c"][entry["sensor"]]) - number(reference)
            growth[part] = number(1.0) + number(entry["coefficient_per_k"]) * warmth
        return Case([number(q) for q in reading["drives"]], [self.model.moving, payload], [], growth)

    def _turn(self, vector: Sequence[float]) -> Vector:
        if self.maths is DOUBLE:
            return quaternion(vector)
        v = [mpmath.mpf(x) for x in vector]
        angle = mpmath.sqrt(sum(x * x for x in v))
        return [mpmath.cos(angle / 2), *scaled(v, mpmath.mpf(1) / 2 if angle == 0 else mpmath.sin(angle / 2) / angle)]

    def _start(self, start: Sequence[float]) -> Pose:
        return Pose([self.maths.number(x) for x in start[:3]], self._turn(start[3:]))

    def theta(self, values: Sequence[Number]) -> dict[str, Number]:
        return dict(zip(self.names, values, strict=True))

    def differences(self, pose: Pose, row: int) -> Vector:
        """Whitened differences of the coordinates that are measured."""
        case, (place, turn) = self.cases[row], self.measured[row]
        tool = pose.place(scaled(self.model.tool_point, case.grown("platform")))
        back = [turn[0], *scaled(turn[1:], -1)]
        between = self.model.rotation_vector(Pose(pose.p, quaternion_product(pose.q, back)))
        full = [*added(tool, place, -1), *between]
        return [full[c] / s for c, s in zip(self.chosen, self.sigma, strict=True)]

    def rest(self, values: Sequence[Number], row: int) -> Pose:
        """Pose of a reading at rest in double precision."""
        return self.model.rest(self.theta(values), self.cases[row], self.starts[row])

    def rest_in_digits(self, values: Sequence[Number], row: int, start: Pose) -> Pose:
        """Pose of a reading at rest to all digits in use, from near by: all steps with one and the same stiffness."""
        theta, case = self.theta(values), self.cases[row]
        pose = start.in_digits()
        constraints, loads = self.model.constraints(theta, case), self.model.loads(case)
        stiffness = self.model.stiffness(pose, constraints, loads)
        for _ in range(30):
            step = scaled(solved(stiffness, self.model.balance(pose, constraints, loads)), -1)
            pose = self.model.moved(pose, step)
            if max(abs(x) for x in step) < mpmath.mpf(10) ** (8 - mpmath.mp.dps):
                return pose
        raise RuntimeError(f"reading {row}: not at rest")

    def pull(self, pose: Pose, row: int) -> tuple[Number, Vector]:
        """Half the squared misfit of a reading, and its derivative with the pose (f,), by central differences."""
        width = mpmath.mpf(WIDTH)
        here = self.differences(pose, row)
        slope = []
        for j in range(len(self.model.free)):
            steps = [[sign * width if i == j else 0 for i in range(len(self.model.free))] for sign in (1, -1)]
            ahead, behind = (self.differences(self.model.moved(pose, step), row) for step in steps)
            slope.append(sum(h * (a - b) for h, a, b in zip(here, ahead, behind, strict=True)) / (2 * width))
        return sum(h * h for h in here) / 2, slope

    def cost_and_gradient(self, values: Sequence[Number], near: Objective) -> tuple[Number, Vector]:
        """The function and its gradient in extended precision; `near`: the same in double precision, to start from.

        The gradient by the adjoint: -(K^-1 pull) . dG/dtheta.
        """
        cost = sum((v / s) ** 2 for v, s in zip(values, self.prior, strict=True)) / 2
        gradient = [v / s**2 for v, s in zip(values, self.prior, strict=True)]
        width = mpmath.mpf(WIDTH)
        for row in range(len(self.cases)):
            pose = self.rest_in_digits(values, row, near.rest([float(v) for v in values], row))
            theta, case = self.theta(values), self.cases[row]
            constraints, loads = self.model.constraints(theta, case), self.model.loads(case)
            misfit, pull = self.pull(pose, row)
            cost += misfit
            adjoint = solved(self.model.stiffness(pose, constraints, loads), pull)
            for j, name in enumerate(self.names):
                sides = []
                for sign in (1, -1):
                    moved = self.model.constraints(theta | {name: theta[name] + sign * width}, case)
                    balance = self.model.balance(pose, moved, loads)
                    sides.append(sum(a * g for a, g in zip(adjoint, balance, strict=True)))
                gradient[j] -= (sides[0] - sides[1]) / (2 * width)
        return cost, gradient


class ManyDraws:
    """The same function in double precision for many values of the errors at once (arrays: draws, readings)."""

    def __init__(self, problem: Mapping[str, Any]) -> None:
        self.objective = Objective(problem)
        self.model, self.prior = self.objective.model, np.array(self.objective.prior)
        cases = self.objective.cases
        self.case = Case(
            _stacked([c.drives for c in cases]),
            [
                (np.array([c.masses[i][0] for c in cases]), _stacked([c.masses[i][1] for c in cases]))
                for i in range(len(cases[0].masses))
            ],
            [],
            {part: np.array([c.growth[part] for c in cases]) for part in PARTS},
        )
        self.place = _stacked([place for place, _ in self.objective.measured])
        self.turn = _stacked([turn for _, turn in self.objective.measured])
        self.loads = self.model.loads(self.case)

    def settle(self, values: Array) -> None:
        """Find the poses at some errors: where every search starts."""
        poses = [self.objective.rest(values.tolist(), row) for row in range(len(self.objective.cases))]
        self.near = Pose(_stacked([p.p for p in poses]), _stacked([p.q for p in poses]))

    def rest(self, draws: Array) -> tuple[dict[str, Array], Pose]:
        """Errors (d, p) as arrays (d, 1), and poses (d, readings) at rest."""
        theta = {name: draws[:, j : j + 1] for j, name in enumerate(self.objective.names)}
        constraints = self.model.constraints(theta, self.case)
        pose = self.near
        stiffness = self.model.stiffness(pose, constraints, self.loads)
        for _ in range(6):
            step = solved(stiffness, self.model.balance(pose, constraints, self.loads))
            pose = self.model.moved(pose, scaled(step, -1))
        if not max(np.abs(s).max() for s in step) < 1e-11:
            raise RuntimeError(f"not at rest: {max(np.abs(s).max() for s in step):.1e}")
        return theta, pose

    def differences(self, pose: Pose) -> list[Array]:
        tool = pose.place(scaled(self.model.tool_point, self.case.grown("platform")))
        back = [self.turn[0], *scaled(self.turn[1:], -1)]
        # The imaginary part of a complex step has to pass: an analytic form of the rotation vector.
        between = quaternion_product(pose.q, back)
        u = between[1:]
        square = u[0] ** 2 + u[1] ** 2 + u[2] ** 2
        stretch = 2.0 * (1.0 + square * (1 / 6 + square * (3 / 40 + square * (15 / 336))))
        full = [*added(tool, self.place, -1), *scaled(u, stretch)]
        return [full[c] / s for c, s in zip(self.objective.chosen, self.objective.sigma, strict=True)]

    def cost(self, draws: Array) -> Array:
        """The function (d,) at draws (d, p)."""
        _, pose = self.rest(draws)
        misfit = sum(np.sum(r**2, axis=1) for r in self.differences(pose))
        return 0.5 * (misfit + np.sum((draws / self.prior) ** 2, axis=1))

    def whitened(self, draws: Array) -> tuple[Array, Array]:
        """Whitened differences (d, m) and their derivatives (d, m, p): dx = -K^-1 dG, all by complex steps."""
        theta, pose = self.rest(draws)
        stiffness = self.model.stiffness(pose, self.model.constraints(theta, self.case), self.loads)
        free = range(len(self.model.free))
        by_pose = []
        for j in free:
            step = [complex(0.0, TINY) if i == j else 0.0 for i in free]
            by_pose.append([np.imag(r) / TINY for r in self.differences(self.model.moved(pose, step))])
        columns = []
        for name in self.objective.names:
            shifted = self.model.constraints(theta | {name: theta[name] + complex(0.0, TINY)}, self.case)
            moved = [np.imag(g) / TINY for g in self.model.balance(pose, shifted, self.loads)]
            moved = solved(stiffness, moved)
            columns.append([-sum(by_pose[j][c] * moved[j] for j in free) for c in range(len(by_pose[0]))])
        here = self.differences(pose)
        shape = np.broadcast_shapes(*(r.shape for r in here), (len(draws), 1))
        flat = np.stack([np.broadcast_to(r, shape) for r in here], axis=1).reshape(len(draws), -1)
        jacobian = np.stack(
            [np.stack([np.broadcast_to(c, shape) for c in column], axis=1) for column in columns], axis=-1
        )
        return flat, jacobian.reshape(len(draws), flat.shape[1], -1)

    def gradient(self, draws: Array) -> Array:
        """Gradients (d, p) in units of the priors' standard deviations."""
        residual, jacobian = self.whitened(draws)
        return np.einsum("dm,dmp->dp", residual, jacobian) * self.prior + draws / self.prior

    def hessians(self, values: Array) -> tuple[Array, Array]:
        """Gauss-Newton and exact second derivatives (p, p), in units of the priors' standard deviations."""
        _, jacobian = self.whitened(values[None])
        scaled_jacobian = jacobian[0] * self.prior
        gauss_newton = scaled_jacobian.T @ scaled_jacobian + np.eye(len(values))
        width = 1e-3
        draws = np.concatenate([values + sign * width * np.diag(self.prior) for sign in (1.0, -1.0)])
        ahead, behind = np.split(self.gradient(draws), 2)
        exact = (ahead - behind) / (2.0 * width)
        return gauss_newton, 0.5 * (exact + exact.T)


def _stacked(rows: Sequence[Sequence[float]]) -> list[Array]:
    """Rows of equal length as one array a component."""
    return [np.array(component, dtype=float) for component in zip(*rows, strict=True)]
