"""Identification against scipy with 2-point differences and FIGAROH's solver on the same vectorised residual.

    python -m benchmarks.identification [--quick]

All minimise the same sum of squares (whitened readings and priors) from the nominal machine, scipy with its default
tolerances and with the tightest that it takes. Cost is that sum at the answer, above the lowest that anyone reached;
parameters apart is the difference of the worst one from ours in units of its standard error. One thread; a competitor
that would take more than two minutes is not run. Then time and memory of ours alone from 100 to 100,000 poses, each in
its own process.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from benchmarks.peers import figaroh_solver
from benchmarks.peers.rig import targets
from benchmarks.timing import (
    Goal,
    Times,
    exponent,
    in_one_thread,
    in_turn,
    optional,
    print_goals,
    print_table,
)
from calibration.base.arrays import Array
from calibration.identification.estimators import identify
from calibration.identification.fit import Fit
from calibration.identification.problem import LeastSquaresProblem
from calibration.instruments.tool_coordinates import ToolCoordinates
from calibration.machine.description import load_machine, shipped_machine
from calibration.model.model import Model
from calibration.model.parameters import ParameterSet
from calibration.model.visits import Visits

MACHINES = ("planar4", "gough8")
SIZES = (100, 1_000, 10_000, 100_000)
OURS, SCIPY = "this package", "scipy 2-point"
TIGHT = 1e-13
NOISE_M, NOISE_RAD = 7e-6, 30e-6
PAYLOAD_KG = 400.0
LONGEST_S = 120.0
SCIPY_GOAL, MEMORY_GOAL_MIB = 20.0, 1024.0
LINEAR = (0.9, 1.1)


@dataclass(frozen=True)
class Task:
    """Readings of all free coordinates of the tool at random poses, every second one with a payload."""

    model: Model
    visits: Visits
    readings: ToolCoordinates

    @classmethod
    def of(cls, name: str, n: int) -> Task:
        """A shipped machine with random errors as large as its tolerances, and noise."""
        machine = load_machine(shipped_machine(name))
        rng = np.random.default_rng(7)
        model = Model(ParameterSet.of(machine))
        truth = rng.uniform(-1.0, 1.0, len(model)) * np.array([p.tolerance for p in model.parameters.parameters])
        target_poses, drives = targets(machine, n, seed=8)
        visits = Visits.at_reference_temperature(
            machine, drives, target_poses, np.where(np.arange(n) % 2, PAYLOAD_KG, 0.0)
        )
        poses = model.predict(truth, visits)
        sigma = np.where(machine.dof < 3, NOISE_M, NOISE_RAD)
        value = np.concatenate([poses.tool_m(), poses.equilibrium.coordinates()[:, 3:]], axis=1)
        value[:, machine.dof] += rng.normal(size=(n, len(sigma))) * sigma
        coordinates = tuple(int(c) for c in machine.dof)
        return cls(model, visits, ToolCoordinates.of(visits, coordinates, value, sigma))

    def fit(self) -> Fit:
        """What is measured of this package."""
        return identify(self.model, self.visits, [self.readings])

    def residual(self) -> Callable[[Array], Array]:
        """Whitened residuals (m,) of scaled unknowns, without the priors: ours, vectorised, warm starts included."""
        problem = LeastSquaresProblem(self.model, self.visits, (self.readings,))
        return lambda z: np.concatenate([part.ravel() for part in problem.residuals(z)])

    def cost(self, z: Array) -> float:
        """Sum of squares of readings and priors."""
        residual = self.residual()(z)
        return float(residual @ residual + z @ z)


@dataclass
class Answer:
    """What a competitor found: scaled unknowns (u,) and how often it asked for the residual."""

    z: Array
    evaluations: str


def scipy_fit(task: Task, tolerance: float = 1e-8) -> Answer:
    """scipy's trust region with 2-point differences, priors as further rows; 1e-8 are its default tolerances."""
    residual = task.residual()
    solution = least_squares(
        lambda z: np.concatenate([residual(z), z]),
        np.zeros(len(task.model)),
        jac="2-point",
        ftol=tolerance,
        xtol=tolerance,
        gtol=tolerance,
    )
    evaluations = solution.nfev + solution.njev * len(solution.x)
    return Answer(solution.x, f"{evaluations:,} residuals")


def our_fit(task: Task) -> Answer:
    """`identify`, covariance included."""
    fit = task.fit()
    return Answer(fit.unknowns / fit.layout.sigma, "")


def compare(name: str, sizes: tuple[int, ...], rounds: int, absent: list[str]) -> tuple[list[list[str]], list[Goal]]:
    """Rows of the table and goals of one machine."""
    solvers: dict[str, Callable[[Task], Answer]] = {
        OURS: our_fit,
        SCIPY: scipy_fit,
        "scipy 2-point, tight": lambda task: scipy_fit(task, TIGHT),
    }
    if figaroh := optional("figaroh.calibration.base_calibration", absent):

        def figaroh_fit(task: Task) -> Answer:
            z, evaluations = figaroh_solver.minimise(figaroh.BaseCalibration, task.residual(), len(task.model))
            return Answer(z, f"{evaluations:,} steps")

        solvers["FIGAROH's solver"] = figaroh_fit
    rows: list[list[str]] = []
    goals: list[Goal] = []
    took, before = dict.fromkeys(solvers, 0.0), sizes[0]
    for n in sizes:
        running = {who: solve for who, solve in solvers.items() if took[who] * n / before < LONGEST_S}
        times, results = contest(Task.of(name, n), running, rounds if n <= 1_000 else 1)
        rows += [[name, f"{n:,}", who, *results.get(who, ["not run", "", "", "", ""])] for who in solvers]
        took, before = {who: times[who].median if who in times else np.inf for who in solvers}, n
        if n == 1_000:
            ratio = times[SCIPY].over(times[OURS])
            what, met = f"{name}: times {SCIPY}, 1,000 poses", ratio.median >= SCIPY_GOAL
            goals.append(Goal(what, f">= {SCIPY_GOAL:.0f}", str(ratio), met))
    return rows, goals


def contest(
    task: Task, solvers: dict[str, Callable[[Task], Answer]], rounds: int
) -> tuple[dict[str, Times], dict[str, list[str]]]:
    """Times of the solvers on one task, and the cells of the table for each."""
    answers: dict[str, Answer] = {}

    def run(who: str) -> Callable[[], None]:
        def solve() -> None:
            answers[who] = solvers[who](task)

        return solve

    times = in_turn({who: run(who) for who in solvers}, rounds)
    fit = task.fit()
    error = np.sqrt(np.diag(fit.covariance)) / fit.layout.sigma
    costs = {who: task.cost(a.z) for who, a in answers.items()}
    cells = {}
    for who, answer in answers.items():
        ratio = "1" if who == OURS else str(times[who].over(times[OURS]))
        apart = float(np.max(np.abs(answer.z - answers[OURS].z) / error))
        above = costs[who] - min(costs.values())
        cells[who] = [f"{times[who].median:.3f}", ratio, f"{above:.1e}", f"{apart:.1e}", answer.evaluations]
    return times, cells


def grown(name: str, sizes: tuple[int, ...]) -> tuple[list[list[str]], list[Goal]]:
    """Time and memory of ours over the number of poses, one process each."""
    runs = []
    for n in sizes:
        command = [sys.executable, "-m", "benchmarks.identification", "--alone", name, str(n)]
        runs.append(json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout))
    rows = [
        [
            name,
            f"{n:,}",
            f"{f['seconds']:.2f}",
            f"{f['passes']:.1f}",
            f"{1e6 * f['seconds'] / n:.0f}",
            f"{f['peak_mib']:.0f}",
        ]
        for n, f in zip(sizes, runs, strict=True)
    ]
    # Of the two largest, where what does not depend on the number of poses no longer counts.
    large = [len(sizes) - 2, len(sizes) - 1]
    counts = [sizes[i] for i in large]
    slope = exponent(counts, [runs[i]["seconds"] / runs[i]["passes"] for i in large])
    peak = max(f["peak_mib"] for f in runs)
    goal = f"{LINEAR[0]} to {LINEAR[1]}"
    goals = [
        Goal(f"{name}: exponent of time a pass", goal, f"{slope:.2f}", LINEAR[0] <= slope <= LINEAR[1]),
        Goal(f"{name}: peak memory", f"< {MEMORY_GOAL_MIB:.0f} MiB", f"{peak:.0f} MiB", peak < MEMORY_GOAL_MIB),
    ]
    growth = [runs[i]["peak_mib"] - runs[0]["peak_mib"] for i in large]
    if counts[-1] >= 100_000:
        share = exponent(counts, growth)
        goals.append(Goal(f"{name}: exponent of memory", f"<= {LINEAR[1]}", f"{share:.2f}", share <= LINEAR[1]))
    return rows, goals


def alone(name: str, n: int) -> None:
    """One fit in this process: its seconds, passes over all readings and peak memory as JSON."""
    task = Task.of(name, n)
    passes, rows = 0.0, len(task.readings) * task.readings.width
    linearise = LeastSquaresProblem.linearise

    def counted(self: LeastSquaresProblem, z: Array) -> object:
        nonlocal passes
        passes += self.n_numbers / rows
        return linearise(self, z)

    LeastSquaresProblem.linearise = counted  # type: ignore[method-assign,assignment]
    began = time.process_time()
    task.fit()
    seconds = time.process_time() - began
    peak_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    print(json.dumps({"seconds": seconds, "passes": passes, "peak_mib": peak_mib}))


def main() -> int:
    """Print the tables and the goals; 1 if one is missed."""
    in_one_thread()
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few poses and rounds: a check that it runs")
    parser.add_argument("--machines", default=",".join(MACHINES))
    parser.add_argument("--alone", nargs=2, metavar=("MACHINE", "POSES"), help="one fit, its time and memory")
    arguments = parser.parse_args()
    if arguments.alone:
        alone(arguments.alone[0], int(arguments.alone[1]))
        return 0
    sizes = SIZES[:2] if arguments.quick else SIZES
    rounds = 1 if arguments.quick else 3
    rows: list[list[str]] = []
    grown_rows: list[list[str]] = []
    goals: list[Goal] = []
    absent: list[str] = []
    for name in arguments.machines.split(","):
        more, new_goals = compare(name, sizes, rounds, absent)
        rows += more
        goals += new_goals
        more, new_goals = grown(name, (1_000, 4_000) if arguments.quick else SIZES)
        grown_rows += more
        goals += new_goals
    head = [
        "machine",
        "poses",
        "who",
        "seconds",
        "times ours (spread)",
        "cost above lowest",
        "parameters apart",
        "effort",
    ]
    print_table("Identification, one thread", head, rows)
    head = ["machine", "poses", "seconds", "passes with derivatives", "us a pose", "peak MiB"]
    print_table("Time and memory of this package", head, grown_rows)
    return print_goals(goals, sorted(set(absent)))


if __name__ == "__main__":
    sys.exit(main())
