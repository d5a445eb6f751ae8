"""Writes the certified problems: data, and the answer in many digits from the reference model alone.

    python -m tests.calibration.certify [name ...]

A problem is the maximum a posteriori estimate of a machine's errors from measured coordinates of its tool. The answer
is the minimum of

    1/2 sum ((predicted - measured) / sigma)^2 + 1/2 sum (theta / prior)^2,  prior = tolerance / sqrt 3,

rotations compared by the vector of the rotation from measured to predicted. The minimum is found in `DIGITS` digits,
every derivative by differences of the reference model in that arithmetic. Standard errors come from the second
derivatives of the same function at the minimum (Laplace; double precision, differences of complex-step gradients) and
from a Markov chain on it (`sample`). Nothing here imports `calibration`.
"""

from __future__ import annotations

import json
import re
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
from numpy.typing import NDArray

from tests.calibration.reference_model import (
    COORDINATES,
    DOUBLE,
    EXTENDED,
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
FOLDER = Path(__file__).parent / "certified"
MACHINES = Path(__file__).parents[2] / "calibration" / "machine" / "data"
DIGITS = 60
STATED_DIGITS = 32
WIDTH = "1e-18"  # of central differences: an error of its square, far below the digits stated
MOST_ROUNDS = 12


@dataclass(frozen=True)
class Task:
    """What a problem is made of. error, noise: shares of the tolerances and sigmas that the data are drawn with."""

    name: str
    about: str
    machine: str
    coordinates: tuple[str, ...]
    poses: int
    seed: int
    payloads: tuple[tuple[float, tuple[float, float, float]], ...] = ((0.0, (0.0, 0.0, 0.0)),)
    sigma_m: float = 5e-6
    sigma_rad: float = 3e-5
    error: float = 1.0
    noise: float = 1.0
    warm: bool = False
    kinds: tuple[str, ...] | None = None
    tolerances: Mapping[str, float] = field(default_factory=dict)  # instead of those of the shipped machine
    bold: float = 0.9  # of the chain's moves: 1 forgets where it was
    steps: int = 500


NOTHING = (0.0, (0.0, 0.0, 0.0))
POSE = ("x", "y", "z", "rx", "ry", "rz")
PLANAR_POSE = ("x", "y", "rz")


def fine(metres: float) -> dict[str, float]:
    """Tolerances so small that the posterior of an over-constrained machine is close to a Gaussian.

    The product of a misfit and a stiffness error is what bends it: with the shipped tolerances the Laplace standard
    errors of the stiffnesses are too large by up to a tenth (`planar4-shop`).
    """
    lengths = ("strut_length_m", "platform_joint_m", "base_joint_m")
    return dict.fromkeys(lengths, metres) | {"ln_stiffness": 0.05}


TASKS = (
    Task(
        "planar4-pose",
        "Over-constrained by one; full pose; with and without a known load, each part at its own temperature.",
        "planar4",
        PLANAR_POSE,
        12,
        1,
        (NOTHING, (400.0, (0.0, -0.2, 0.0))),
        error=0.3,
        noise=0.1,
        warm=True,
        tolerances=fine(2e-5),
    ),
    Task(
        "planar4-xy",
        "Over-constrained by one; x and y only; no load difference.",
        "planar4",
        ("x", "y"),
        12,
        2,
        noise=0.1,
        tolerances=fine(3e-5),
    ),
    Task(
        "planar4-shop",
        "Shipped tolerances and full noise: what a Gaussian cannot say about a strained machine's stiffness.",
        "planar4",
        PLANAR_POSE,
        12,
        3,
        (NOTHING, (400.0, (0.0, -0.2, 0.0))),
        bold=0.4,
        steps=3000,
    ),
    Task("rrr3-pose", "Exactly constrained, cranks; full pose; no load in its plane.", "rrr3", PLANAR_POSE, 12, 4),
    Task(
        "rrr4-xy",
        "Over-constrained by one, cranks; x and y only.",
        "rrr4",
        ("x", "y"),
        16,
        5,
        noise=0.1,
        tolerances=fine(3e-5),
    ),
    Task(
        "delta6-xyz",
        "Exactly constrained; the tool point only; with and without a known load.",
        "delta6",
        ("x", "y", "z"),
        12,
        6,
        (NOTHING, (40.0, (0.0, 0.0, -0.08))),
        noise=0.2,
        tolerances={"ln_stiffness": 0.05},
    ),
    Task(
        "delta8-pose",
        "Over-constrained by two; full pose; no load difference; each part at its own temperature.",
        "delta8",
        POSE,
        10,
        7,
        error=0.3,
        noise=0.1,
        warm=True,
        tolerances=fine(1.5e-5),
    ),
    Task(
        "stewart6-pose",
        "Exactly constrained, legs; full pose; with and without a known load.",
        "stewart6",
        POSE,
        10,
        8,
        (NOTHING, (400.0, (0.02, 0.01, 0.25))),
        error=0.3,
        noise=0.2,
        tolerances={"ln_stiffness": 0.05},
    ),
    Task(
        "gough8-height",
        "Over-constrained by two, legs; the height only; with and without a known load.",
        "gough8",
        ("z",),
        20,
        9,
        (NOTHING, (400.0, (0.02, 0.01, 0.25))),
        noise=0.1,
        tolerances=fine(3e-5),
    ),
    Task(
        "hexaglide-pose",
        "Exactly constrained, sliders; full pose; no load difference.",
        "hexaglide",
        POSE,
        8,
        10,
        noise=0.2,
        tolerances={"ln_stiffness": 0.05},
    ),
    Task(
        "prs3-height",
        "Guide planes; the height only; with and without a known load.",
        "prs3",
        ("z",),
        20,
        11,
        (NOTHING, (60.0, (0.01, 0.0, -0.12))),
        noise=0.2,
        tolerances={"ln_stiffness": 0.05},
    ),
)


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


@dataclass(frozen=True)
class Chain:
    """What a Markov chain found: standard errors (p,) and how well they are known."""

    standard_error: Array
    mean: Array
    relative_error: float  # largest standard error of a standard error, relative
    effective: float  # smallest number of independent draws that would do as well
    acceptance: float
    draws: int


def sample(many: ManyDraws, values: Array, exact: Array, task: Task, chains: int = 400) -> Chain:
    """Metropolis-Hastings with moves that keep the Laplace approximation's Gaussian (preconditioned Crank-Nicolson).

    z' = sqrt(1 - b^2) z + b xi leaves N(0, 1) as it is, so a move is accepted by the ratio of the true density to the
    Gaussian alone. Many chains side by side; a tenth of the steps is thrown away.
    """
    rng = np.random.default_rng(task.seed)
    bold, steps = task.bold, task.steps
    spread = np.linalg.cholesky(np.linalg.inv(exact)) * many.prior[:, None]

    def surplus(z: Array) -> Array:
        return 0.5 * np.sum(z**2, axis=1) - many.cost(values + z @ spread.T)

    z = rng.standard_normal((chains, len(values)))
    level = surplus(z)
    burn = steps // 10
    taken = 0
    kept = np.empty((steps - burn, chains, len(values)))
    for step in range(steps):
        proposal = np.sqrt(1.0 - bold**2) * z + bold * rng.standard_normal(z.shape)
        other = surplus(proposal)
        yes = np.log(rng.uniform(size=chains)) < other - level
        z[yes], level[yes] = proposal[yes], other[yes]
        taken += int(yes.sum())
        if step >= burn:
            kept[step - burn] = z @ spread.T
    mean = kept.mean(axis=(0, 1))
    square = (kept - mean) ** 2
    by_chain = square.mean(axis=0)  # (chains, p): chains are independent, so their scatter tells the error of the mean
    variance = by_chain.mean(axis=0)
    error = by_chain.std(axis=0, ddof=1) / np.sqrt(chains) / variance / 2.0
    return Chain(
        np.sqrt(variance),
        mean,
        float(error.max()),
        float((0.5 / error**2).min()),
        taken / (steps * chains),
        kept[..., 0].size,
    )


def data(task: Task) -> dict[str, Any]:
    """A problem without its answer: errors, poses and noise are drawn from the seed."""
    text = (MACHINES / f"{task.machine}.toml").read_text(encoding="utf-8")
    for key, value in task.tolerances.items():
        text, found = re.subn(rf"^{key} = [0-9].*$", f"{key} = {value!r}", text, flags=re.MULTILINE)
        assert found == 1, key
    model = ReferenceModel(text)
    rng = np.random.default_rng(task.seed)
    kinds = list(task.kinds or dict.fromkeys(n.partition(".")[0] for n in model.names))
    trial = model.trial(task.seed, task.poses)
    theta = {n: task.error * v for n, v in trial.theta.items() if n.partition(".")[0] in kinds}
    chosen = [COORDINATES.index(c) for c in task.coordinates]
    sigma = [task.sigma_rad if c > 2 else task.sigma_m for c in chosen]
    reference = model.file["reference_temperature_c"]
    sensors = [model.file["expansion"][part]["sensor"] for part in PARTS]
    readings = []
    for number, (case, start) in enumerate(zip(trial.cases, trial.starts, strict=True)):
        mass, centre = task.payloads[number % len(task.payloads)]
        readings.append(
            {
                "drives": [round(q, 6) for q in case.drives],
                "payload_kg": mass,
                "payload_com_m": list(centre),
                "temperatures_c": {
                    s: round(reference + float(rng.uniform(-3.0, 8.0)), 2) if task.warm else reference for s in sensors
                },
                "start": [*start.p, *(float(x) for x in model.rotation_vector(start))],
                "tool": [0.0] * 6,
            }
        )
    problem = {
        "format": 1,
        "name": task.name,
        "about": task.about,
        "machine": task.machine,
        "machine_toml": text,
        "unknowns": kinds,
        "coordinates": list(task.coordinates),
        "sigma": sigma,
        "readings": readings,
    }
    objective = Objective(problem)
    for row, reading in enumerate(readings):
        pose = objective.rest([theta[n] for n in objective.names], row)
        tool = pose.place(scaled(model.tool_point, objective.cases[row].grown("platform")))
        place = np.array([*tool, *(float(x) for x in model.rotation_vector(pose))])
        place[chosen] += task.noise * np.array(sigma) * rng.standard_normal(len(chosen))
        reading["tool"] = [round(float(x), 10) for x in place]
        # Not measured, but where the search starts: near, not exact.
        reading["start"] = [round(float(x), 4) for x in reading["start"]]
    return problem


def near_minimum(many: ManyDraws, size: int) -> Array:
    """The minimum to double precision, by Newton steps with the exact second derivatives."""
    values = np.zeros(size)
    for _ in range(MOST_ROUNDS):
        many.settle(values)
        gauss_newton, exact = many.hessians(values)
        positive = np.linalg.eigvalsh(exact)[0] > 0.0
        step = np.linalg.solve(exact if positive else gauss_newton, many.gradient(values[None])[0])
        values = values - step * many.prior
        if np.abs(step).max() < 1e-9:
            many.settle(values)
            return values
    raise RuntimeError(f"the last step is {np.abs(step).max():.1e} standard deviations of the prior")


def answer(problem: Mapping[str, Any], task: Task) -> dict[str, Any]:
    """The answer of a problem."""
    many = ManyDraws(problem)
    near = near_minimum(many, len(many.objective.names))
    gauss_newton, exact = many.hessians(near)
    with mpmath.workdps(DIGITS):
        objective = Objective(problem, EXTENDED)
        values = [mpmath.mpf(x) for x in near.tolist()]
        inverse = np.linalg.inv(exact)
        for _ in range(MOST_ROUNDS):
            cost, gradient = objective.cost_and_gradient(values, many.objective)
            largest = max(abs(g * s) for g, s in zip(gradient, objective.prior, strict=True))
            step = _product(inverse, [g * s for g, s in zip(gradient, objective.prior, strict=True)])
            values = [v - d * s for v, d, s in zip(values, step, objective.prior, strict=True)]
            if largest < mpmath.mpf(10) ** (-STATED_DIGITS):
                break
        else:
            raise RuntimeError(f"the gradient is still {mpmath.nstr(largest, 3)}")
        # What is zero (stiffnesses that nothing strains) comes out as the square of the differences' width.
        zero = mpmath.mpf(10) ** -(STATED_DIGITS + 4)
        values = [v if abs(v) > zero * s else mpmath.mpf(0) for v, s in zip(values, objective.prior, strict=True)]
        stated = [mpmath.nstr(v, STATED_DIGITS, strip_zeros=False) for v in values]
        cost_stated = mpmath.nstr(cost, STATED_DIGITS)
    chain = sample(many, near, exact, task)

    def errors(information: Array) -> list[str]:
        return [f"{x:.9e}" for x in np.sqrt(np.diag(np.linalg.inv(information))) * many.prior]

    return {
        "names": many.objective.names,
        "deviation": stated,
        "half_cost": cost_stated,
        "laplace": errors(exact),
        "gauss_newton": errors(gauss_newton),
        "mcmc": [f"{x:.5e}" for x in chain.standard_error],
        "mcmc_mean_shift": [f"{x:.3e}" for x in chain.mean],
        "mcmc_relative_error": round(chain.relative_error, 5),
        "mcmc_effective_draws": round(chain.effective),
        "mcmc_draws": chain.draws,
        "mcmc_acceptance": round(chain.acceptance, 4),
    }


def _product(a: Array, x: Sequence[Number]) -> Vector:
    return [sum(mpmath.mpf(a[i, j]) * x[j] for j in range(len(x))) for i in range(len(x))]


def _stacked(rows: Sequence[Sequence[float]]) -> list[Array]:
    """Rows of equal length as one array a component."""
    return [np.array(component, dtype=float) for component in zip(*rows, strict=True)]


def summary(problem: Mapping[str, Any]) -> str:
    """One line: size, how far Gauss-Newton and the chain are from the exact Laplace standard errors."""
    found = problem["answer"]
    laplace, gn, mcmc = (np.array(found[k], dtype=float) for k in ("laplace", "gauss_newton", "mcmc"))
    return (
        f"{problem['name']}: {len(laplace)} unknowns, {len(problem['readings'])} poses, half cost "
        f"{float(found['half_cost']):.3f}, Gauss-Newton off by {np.abs(gn / laplace - 1).max():.1e}, chain off by "
        f"{np.abs(mcmc / laplace - 1).max():.1e} (known to {found['mcmc_relative_error']:.1e}, acceptance "
        f"{found['mcmc_acceptance']})"
    )


def main(names: Sequence[str]) -> None:
    FOLDER.mkdir(exist_ok=True)
    for task in TASKS:
        if names and task.name not in names:
            continue
        began = time.monotonic()
        problem = data(task)
        problem["answer"] = answer(problem, task)
        (FOLDER / f"{task.name}.json").write_text(json.dumps(problem, indent=1) + "\n", encoding="utf-8")
        print(f"{summary(problem)}; {time.monotonic() - began:.0f} s", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
