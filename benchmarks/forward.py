"""Poses at rest a second against loops over poses: scipy, MuJoCo settling, pinocchio. One thread.

    python -m benchmarks.forward [--quick]

Each competitor gets the same machine with errors, the same drives, and starts from the commanded pose. The gap is
how far any strut's length is from that at rest, which an independent residual finds in extended precision.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.peers import mujoco_settling, pinocchio_loop, scipy_loop
from benchmarks.peers.rig import Rig
from benchmarks.peers.statics import cross_matrix
from benchmarks.timing import Goal, Times, in_one_thread, in_turn, optional, print_goals, print_table
from calibration.base.arrays import Array
from calibration.base.rotation import rotation_matrix, rotation_vector

MACHINES = ("planar4", "stewart6", "gough8")
OURS = "this package"
GAP_NM = 0.1
SCIPY_GOAL, MUJOCO_GOAL = 300.0, 10.0


@dataclass(frozen=True)
class Competitor:
    """Somebody who finds the first `poses` poses: a task that gives place (n, 3), rotation (n, 3, 3), effort."""

    name: str
    poses: int
    rests: Callable[[], tuple[Array, Array, str]]


def competitors(rig: Rig, quick: bool, absent: list[str]) -> list[Competitor]:
    """All that are installed."""
    few = 20 if quick else 200
    competitors_of_rig = [Competitor(OURS, len(rig.drives), lambda: _ours(rig))]
    for method in ("hybr", "lm"):
        competitors_of_rig.append(Competitor(f"scipy root {method}, pose by pose", few, _scipy(rig.part(few), method)))
    if mujoco := optional("mujoco", absent):
        settling = mujoco_settling.Settling(mujoco, rig.part(few // 10))
        competitors_of_rig.append(Competitor("MuJoCo settling", few // 10, _quaternions(settling)))
    if pinocchio := optional("pinocchio", absent):
        newton = pinocchio_loop.Newton(pinocchio, rig.part(few))
        competitors_of_rig.append(Competitor("pinocchio kinematics, pose by pose", few, _matrices(newton)))
    return competitors_of_rig


def _ours(rig: Rig) -> tuple[Array, Array, str]:
    rest = rig.solve()
    return rest.position_m, rest.rotation, "" if rest.converged.all() else "NOT CONVERGED"


def _scipy(rig: Rig, method: str) -> Callable[[], tuple[Array, Array, str]]:
    def rests() -> tuple[Array, Array, str]:
        x, evaluations = scipy_loop.rests(rig, method)
        full = np.zeros((len(x), 6))
        full[:, rig.dof] = x
        return (
            full[:, :3],
            rotation_matrix(full[:, 3:]) @ rotation_matrix(rig.start[:, 3:]),
            f"{evaluations:.1f} evaluations",
        )

    return rests


def _quaternions(settling: mujoco_settling.Settling) -> Callable[[], tuple[Array, Array, str]]:
    def rests() -> tuple[Array, Array, str]:
        solutions, steps = settling.rests()
        rotation = []
        for w, *xyz in solutions[:, 3:]:
            k = cross_matrix(np.array(xyz))
            rotation.append(np.eye(3) + 2.0 * w * k + 2.0 * k @ k)
        return solutions[:, :3], np.array(rotation), f"{steps:,.0f} time steps"

    return rests


def _matrices(newton: pinocchio_loop.Newton) -> Callable[[], tuple[Array, Array, str]]:
    def rests() -> tuple[Array, Array, str]:
        solutions, steps = newton.rests()
        return solutions[:, :3], solutions[:, 3:].reshape(-1, 3, 3), f"{steps:.1f} steps"

    return rests


def gap_nm(rig: Rig, position: Array, rotation: Array, reference: list[Array]) -> float:
    """Largest difference of a strut's length from that at rest, over the poses that have a reference, in nm."""
    worst = 0.0
    for i, lengths in enumerate(reference[: len(position)]):
        pose, _ = scipy_loop.problem(rig, i)
        v = position[i] + rig.joints @ rotation[i].T - pose.ends
        distance = np.sqrt(np.sum(v.astype(np.longdouble) ** 2, axis=1))
        worst = max(worst, float(np.max(np.abs(distance - lengths))))
    return worst * 1e9


def reference_lengths(rig: Rig, position: Array, rotation: Array) -> list[Array]:
    """Strut lengths (c,) at rest in extended precision, pose by pose; our poses are only where the search starts."""
    lengths = []
    for i in range(len(position)):
        pose, _ = scipy_loop.problem(rig, i)
        turn = rotation_vector((rotation[i] @ pose.first.T)[None])[0]
        x = pose.reference(np.concatenate([position[i], turn])[rig.dof])
        lengths.append(pose.lengths_at(x))
    return lengths


def compare(name: str, quick: bool, absent: list[str]) -> tuple[list[list[str]], list[Goal]]:
    """Rows of the table and goals of one machine."""
    rig = Rig.of(name, 4_000 if quick else 40_000)
    field = competitors(rig, quick, absent)
    answers = {c.name: c.rests() for c in field}
    checked = 20 if quick else 200
    position, rotation, _ = answers[OURS]
    reference = reference_lengths(rig, position[:checked], rotation[:checked])
    times = in_turn({c.name: c.rests for c in field}, 3 if quick else 9)
    each = {c.name: Times(tuple(t / c.poses for t in times[c.name].rounds)) for c in field}
    gaps = {n: gap_nm(rig, p[:checked], r[:checked], reference) for n, (p, r, _) in answers.items()}
    rows = []
    for c in field:
        per_s = f"{1.0 / each[c.name].median:,.0f}"
        ratio = "1" if c.name == OURS else str(each[c.name].over(each[OURS]))
        rows.append([name, c.name, per_s, ratio, f"{gaps[c.name]:.1e}", answers[c.name][2]])
    return rows, _goals(name, each, gaps)


def _goals(name: str, each: dict[str, Times], gaps: dict[str, float]) -> list[Goal]:
    goals = [Goal(f"{name}: our loop gap", f"< {GAP_NM} nm", f"{gaps[OURS]:.1e} nm", gaps[OURS] < GAP_NM)]
    if name == "planar4":
        scipy = min((t for n, t in each.items() if n.startswith("scipy")), key=lambda t: t.median)
        ratio = scipy.over(each[OURS])
        goal = f">= {SCIPY_GOAL:.0f}"
        goals.append(Goal(f"{name}: times the faster scipy loop", goal, str(ratio), ratio.median >= SCIPY_GOAL))
    if "MuJoCo settling" in each:
        ratio = each["MuJoCo settling"].over(each[OURS])
        goal = f">= {MUJOCO_GOAL:.0f}"
        goals.append(Goal(f"{name}: times MuJoCo settling", goal, str(ratio), ratio.median >= MUJOCO_GOAL))
    return goals


def main() -> int:
    """Print the table and the goals; 1 if one is missed."""
    in_one_thread()
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few poses and rounds: a check that it runs")
    quick = parser.parse_args().quick
    rows: list[list[str]] = []
    goals: list[Goal] = []
    absent: list[str] = []
    for name in MACHINES:
        more, new_goals = compare(name, quick, absent)
        rows += more
        goals += new_goals
    head = ["machine", "who", "poses a second", "times our time (spread)", "largest gap, nm", "effort a pose"]
    print_table("Poses at rest, one thread", head, rows)
    return print_goals(goals, sorted(set(absent)))


if __name__ == "__main__":
    sys.exit(main())
