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
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mpmath
import numpy as np

from tests.calibration.certified_objective import Array, ManyDraws, Objective
from tests.calibration.certified_tasks import TASKS, Task
from tests.calibration.reference_model import COORDINATES, EXTENDED, PARTS, Number, ReferenceModel, Vector, scaled

FOLDER = Path(__file__).parent / "certified"
MACHINES = Path(__file__).parents[2] / "calibration" / "machine" / "data"
DIGITS = 60
STATED_DIGITS = 32
MOST_ROUNDS = 12


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


def summary(problem: Mapping[str, Any]) -> str:
    """One line: size, how far Gauss-Newton and the chain are from the exact Laplace standard errors."""
    result = problem["answer"]
    laplace, gn, mcmc = (np.array(result[k], dtype=float) for k in ("laplace", "gauss_newton", "mcmc"))
    return (
        f"{problem['name']}: {len(laplace)} unknowns, {len(problem['readings'])} poses, half cost "
        f"{float(result['half_cost']):.3f}, Gauss-Newton off by {np.abs(gn / laplace - 1).max():.1e}, chain off by "
        f"{np.abs(mcmc / laplace - 1).max():.1e} (known to {result['mcmc_relative_error']:.1e}, acceptance "
        f"{result['mcmc_acceptance']})"
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
