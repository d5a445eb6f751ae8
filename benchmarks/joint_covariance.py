"""Whether well-decided combinations of parameters lie where the fit says: simulation, and Markov chains on five cases.

    python -m benchmarks.joint_covariance [--rigs 12] [--chains 5] [--steps 20000] [--out DIR]

Machines with errors drawn from the priors are measured by tool coordinates and fitted. For the directions that the
readings decide, the mean square of the error over the stated standard deviation is 1 if the covariance is right: it is
printed for the covariance at the minimum and for the joint one. Then, on five fits, a Metropolis chain on the exact
posterior tells the variance in the same directions (Gelman, Bayesian Data Analysis, ch. 12), which is compared with
both. Progress goes to standard error. What is done is kept in --out: stopped, the same command goes on.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.results_file import code_digest
from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.base.rotation import rotation_vector
from calibration.identification.estimators import identify
from calibration.identification.fit import Estimator, Fit
from calibration.identification.joint_covariance import joint_covariance
from calibration.identification.pose_selection import PlannedLoad, visits_at, workspace_poses
from calibration.identification.problem import LeastSquaresProblem
from calibration.instruments.tool_coordinates import ToolCoordinates
from calibration.machine.description import load_machine, shipped_machine
from calibration.model.model import Model
from calibration.model.parameters import ParameterSet
from tests.kept_results import KeptResults, key_of, until_stopped

MACHINES = ("planar4", "rrr4", "gough8", "delta8", "stewart6", "delta6", "prs3", "rrr3")
CHAINS = (("planar4", 1), ("planar4", 2), ("rrr4", 1), ("gough8", 1), ("rrr3", 1))
POSES = 60
POSITION_M, ORIENTATION_RAD = 1e-5, 2e-5
DECIDED = 1e-2


def fitted(name: str, seed: int, estimator: Estimator = "map") -> tuple[Fit, Array]:
    """A machine of the shipped ones with drawn errors, fitted to noisy tool coordinates; its true parameters (p,)."""
    machine, rng = load_machine(shipped_machine(name)), np.random.default_rng(seed)
    model = Model(ParameterSet.of(machine))
    visits = visits_at(machine, workspace_poses(machine, POSES, seed), [PlannedLoad()])
    truth = np.zeros(len(model))
    truth[: len(model.parameters)] = model.parameters.sigma * rng.standard_normal(len(model.parameters))
    poses = model.predict(truth, visits)
    coordinates = (0, 1, 5) if machine.planar else tuple(range(6))
    sigma = np.array([POSITION_M if c < 3 else ORIENTATION_RAD for c in coordinates])
    value = np.concatenate([poses.tool_m(), rotation_vector(poses.equilibrium.rotation)], axis=1)
    value[:, list(coordinates)] += sigma * rng.standard_normal((len(visits), len(coordinates)))
    readings = ToolCoordinates.of(visits, coordinates, value, sigma)
    return identify(model, visits, [readings], estimator), truth[: len(model.parameters)]


def error_in_directions(fit: Fit, truth: Array, covariance: Array, decided: float) -> Array:
    """Errors (k,) over their standard deviations, in directions of the parameters that the readings decide."""
    sigma = fit.model.parameters.sigma
    n = len(sigma)
    values, vectors = np.linalg.eigh(covariance[:n, :n] / np.outer(sigma, sigma))
    errors = vectors.T @ ((fit.theta - truth) / sigma) / np.sqrt(values)
    return np.asarray(errors[values < decided])


def chain_variances(fit: Fit, joint: Array, steps: int, seed: int) -> tuple[Array, Array, Array]:
    """Variances in directions (k,) that the readings decide: of a Metropolis chain, stated, and stated jointly.

    All in units of the priors; the directions are those of the covariance at the minimum.
    """
    problem = LeastSquaresProblem(fit.model, fit.visits, fit.instruments)
    sigma = fit.layout.sigma
    z, scale = fit.unknowns / sigma, np.outer(sigma, sigma)
    root = np.linalg.cholesky(joint / scale)
    rng, length = np.random.default_rng(seed), 2.4 / np.sqrt(len(z))
    ones = np.ones(len(z))
    here, loss, drawn = z, problem.loss(z, ones), []
    for step in range(steps):
        there = here + length * (root @ rng.standard_normal(len(z)))
        try:
            further = problem.loss(there, ones)
        except InputError:
            further = np.inf
        if np.log(rng.uniform()) < 0.5 * (loss - further):
            here, loss = there, further
        if step >= steps // 4:
            drawn.append(here - z)
    values, vectors = np.linalg.eigh(fit.covariance / scale)
    vectors = vectors[:, values < DECIDED]
    of_chain = np.mean((np.array(drawn) @ vectors) ** 2, axis=0)
    return of_chain, values[values < DECIDED], np.sum(vectors * (joint / scale @ vectors), axis=0)


def rig_errors(name: str, seed: int) -> dict[str, Any]:
    """Errors over both stated deviations, of one machine with drawn errors."""
    fit, truth = fitted(name, seed)
    covariances = {"linear": fit.covariance, "joint": joint_covariance(fit)}
    return {key: error_in_directions(fit, truth, cov, DECIDED).tolist() for key, cov in covariances.items()}


def chain_ratios(name: str, seed: int, steps: int) -> dict[str, Any]:
    """The chain's variances over both that are stated."""
    fit, _ = fitted(name, seed)
    of_chain, linear, joint = chain_variances(fit, joint_covariance(fit), steps, seed)
    return {"linear": (of_chain / linear).tolist(), "joint": (of_chain / joint).tolist()}


def printed_machine(name: str, rows: list[dict[str, Any]]) -> str:
    """One line of the table: all rigs of a machine."""
    a, b = (np.concatenate([row[key] for row in rows]) for key in ("linear", "joint"))
    return (
        f"{name:10}  {len(b):10d}  {np.mean(a**2):31.2f}  {np.mean(b**2):5.2f}  "
        f"{np.max(np.abs(a)):25.1f}  {np.max(np.abs(b)):5.1f}"
    )


def printed_chain(name: str, seed: int, row: dict[str, Any]) -> str:
    """One line for one chain."""
    linear, joint = row["linear"], row["joint"]
    return (
        f"chain {name} {seed}: variance over linear {np.median(linear):.2f} (median), {np.max(linear):.1f} (largest); "
        f"over joint {np.median(joint):.2f}, {np.max(joint):.1f}"
    )


def main(arguments: list[str] | None = None) -> int:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int, default=12)
    parser.add_argument("--chains", type=int, default=len(CHAINS))
    parser.add_argument("--steps", type=int, default=20000)
    parser.add_argument("--out", type=Path, default=Path("runs/joint-covariance"))
    options = parser.parse_args(arguments)
    if options.rigs < 0:
        parser.error(f"--rigs is {options.rigs}; give the number of rigs of each machine, 0 for none")
    if not 0 <= options.chains <= len(CHAINS):
        parser.error(f"--chains is {options.chains}; give 0 to {len(CHAINS)}")
    if options.rigs == options.chains == 0:
        parser.error("--rigs and --chains are both 0; give at least one of them")
    if options.steps < 1:
        parser.error(f"--steps is {options.steps}; give the number of steps of a chain, 1 or more")
    kept = KeptResults(options.out / "results.jsonl")
    code = code_digest("calibration")

    def result(*case: str | int, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        key = key_of(code, *case)
        if key not in kept:
            print(*case, file=sys.stderr)
            kept.add({"key": key} | make())
        return kept[key]

    if options.rigs:
        print("machine     directions  mean square over stated: linear  joint; largest deviation: linear  joint")
        for name in MACHINES:
            rows = [result(name, seed, make=partial(rig_errors, name, seed)) for seed in range(options.rigs)]
            print(printed_machine(name, rows), flush=True)
    for name, seed in CHAINS[: options.chains]:
        chain = partial(chain_ratios, name, seed, options.steps)
        print(printed_chain(name, seed, result("chain", name, seed, options.steps, make=chain)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(until_stopped(main))
