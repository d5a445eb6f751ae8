"""Whether well-decided combinations of parameters lie where the fit says: simulation, and Markov chains on five cases.

    python -m benchmarks.joint_covariance [--rigs 12] [--chains 5] [--steps 20000]

Machines with errors drawn from the priors are measured by tool coordinates and fitted. For the directions that the
readings decide, the mean square of the error over the stated standard deviation is 1 if the covariance is right: it is
printed for the covariance at the minimum and for the joint one. Then, on five fits, a Metropolis chain on the exact
posterior tells the variance in the same directions (Gelman, Bayesian Data Analysis, ch. 12), which is compared with
both. Progress goes to standard error; Ctrl-C ends it with what is done.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

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


def main() -> int:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int, default=12)
    parser.add_argument("--chains", type=int, default=len(CHAINS))
    parser.add_argument("--steps", type=int, default=20000)
    options = parser.parse_args()
    try:
        print("machine     directions  mean square over stated: linear  joint; largest deviation: linear  joint")
        for name in MACHINES if options.rigs else ():
            linear, joint = [], []
            for seed in range(options.rigs):
                fit, truth = fitted(name, seed)
                linear.append(error_in_directions(fit, truth, fit.covariance, DECIDED))
                joint.append(error_in_directions(fit, truth, joint_covariance(fit), DECIDED))
            a, b = np.concatenate(linear), np.concatenate(joint)
            print(
                f"{name:10}  {len(b):10d}  {np.mean(a**2):31.2f}  {np.mean(b**2):5.2f}  "
                f"{np.max(np.abs(a)):25.1f}  {np.max(np.abs(b)):5.1f}",
                flush=True,
            )
        for name, seed in CHAINS[: options.chains]:
            print(f"{name}, rig {seed}: {options.steps} steps", file=sys.stderr)
            fit, _ = fitted(name, seed)
            of_chain, linear_stated, joint_stated = chain_variances(fit, joint_covariance(fit), options.steps, seed)
            print(
                f"chain {name} {seed}: variance over linear {np.median(of_chain / linear_stated):.2f} (median), "
                f"{np.max(of_chain / linear_stated):.1f} (largest); over joint "
                f"{np.median(of_chain / joint_stated):.2f}, {np.max(of_chain / joint_stated):.1f}",
                flush=True,
            )
    except KeyboardInterrupt:
        print("joint covariance: stopped", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
