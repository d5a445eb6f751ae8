"""Derivatives of poses at rest against complex steps through the second model of the machine file.

The reference side is dx = -K^-1 dG with dG and K by complex step of its own balance of forces: no subtraction, no
shared formula. Entries are held to a share of the largest of their block: one kind of quantity, places or turns.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from calibration.base.arrays import Array
from calibration.machine.description import shipped_machine, shipped_machines
from calibration.machine.inverse import tool_jacobian
from calibration.machine.sensitivity import Sensitivity
from tests.calibration.machine.test_reference_model import TWINS, Twin, every_machine, twin
from tests.calibration.reference_model import COORDINATES, PARTS, TINY, Case, Pose, Trial, solved

AGREEMENT = 1e-9
STEP = complex(0.0, TINY)
Changed = Callable[[dict[str, complex], Case, complex], tuple[dict[str, complex], Case]]


class AtRest:
    """One trial at rest in both models."""

    def __init__(self, pair: Twin, trial: Trial) -> None:
        self.pair, self.trial = pair, trial
        geometry, drives, at = pair.geometry(trial), pair.drives(trial), pair.conditions(trial)
        self.rest = pair.solve(trial)
        assert self.rest.converged.all()
        self.at = at
        self.ours = Sensitivity.at_equilibrium(pair.machine, geometry, drives, at, self.rest)
        self.poses = [pair.reference.rest(trial.theta, c, s) for c, s in zip(trial.cases, trial.starts, strict=True)]

    def reference(self, changed: Changed) -> Array:
        """Derivative (n, f) of the free coordinates with whatever `changed` changes by its step."""
        rows = []
        model = self.pair.reference
        for case, pose in zip(self.trial.cases, self.poses, strict=True):
            constraints, loads = model.constraints(self.trial.theta, case), model.loads(case)
            stiffness = model.stiffness(pose, constraints, loads)
            theta, other = changed(dict(self.trial.theta), case, STEP)
            moved = model.balance(pose, model.constraints(theta, other), model.loads(other))
            rows.append(solved(stiffness, [-np.imag(g) / TINY for g in moved]))
        return np.array(rows)

    def worst(self, ours: Array, reference: Array) -> float:
        """Largest difference (n, f, k) in shares of the largest entry: of places and of turns apart."""
        turns = np.array([c.startswith("r") for c in self.pair.reference.free])
        shares = []
        for rows in (turns, ~turns):
            if np.any(rows):
                difference = np.abs(ours[:, rows] - reference[:, rows]).max()
                shares.append(difference / np.abs(reference[:, rows]).max())
        return max(shares)


def at_rest(pair: Twin, *, loaded: bool = True) -> AtRest:
    return AtRest(pair, pair.reference.trial(seed=21, count=6, loaded=loaded))


def with_parameter(name: str) -> Changed:
    return lambda theta, case, step: (theta | {name: theta[name] + step}, case)


def with_growth(part: str) -> Changed:
    return lambda theta, case, step: (theta, replace(case, growth={**case.growth, part: case.grown(part) + step}))


def with_drive(drive: int) -> Changed:
    def changed(theta, case, step):
        return theta, replace(case, drives=[q + step * (a == drive) for a, q in enumerate(case.drives)])

    return changed


def with_mass(index: int, per_kg: float, shift: Array) -> Changed:
    def changed(theta, case, step):
        masses = list(case.masses)
        if index < len(masses):
            mass, centre = masses[index]
            masses[index] = (mass + step * per_kg, [x + step * s for x, s in zip(centre, shift, strict=True)])
        elif per_kg:  # `Twin.conditions` fills up with a mass of nothing at the platform's origin
            masses.append((step * per_kg, [0.0, 0.0, 0.0]))
        return theta, replace(case, masses=masses)

    return changed


def with_push(force: Array, point: Array) -> Changed:
    return lambda theta, case, step: (theta, replace(case, forces=[*case.forces, (force * step, point)]))


@every_machine
def test_derivatives_with_every_parameter(make):
    s = at_rest(make())
    names = np.array([name.partition(".")[0] for name in s.pair.parameters.names])
    ours = s.ours.pose_derivatives(s.pair.parameters.gradient_columns(s.ours))
    reference = np.stack([s.reference(with_parameter(name)) for name in s.pair.parameters.names], axis=2)
    sigma = s.pair.parameters.sigma
    worst = {
        str(kind): s.worst((ours * sigma)[:, :, names == kind], (reference * sigma)[:, :, names == kind])
        for kind in np.unique(names)
    }
    print(f"\n{s.pair.machine.name}: " + ", ".join(f"{kind} {share:.0e}" for kind, share in worst.items()))
    assert all(share < AGREEMENT for share in worst.values())


@every_machine
def test_derivatives_with_the_drives(make):
    s = at_rest(make())
    reference = np.stack([s.reference(with_drive(a)) for a in range(len(s.pair.machine.drive_names))], axis=2)
    share = s.worst(s.ours.drives(), reference)
    print(f"\n{s.pair.machine.name}: drives {share:.0e}")
    assert share < AGREEMENT


@every_machine
def test_derivatives_with_masses_centres_of_mass_and_forces(make):
    s = at_rest(make())
    rng = np.random.default_rng(22)
    n = len(s.poses)
    masses = [s.ours.mass(i) for i in range(2)]
    centres = [s.ours.centre_of_mass(i, axis) for i in range(2) for axis in range(3)]
    pushes = [(rng.normal(size=3), rng.uniform(-0.2, 0.2, 3)) for _ in range(3)]
    forces = [s.ours.force(np.tile(f[:, None], n), np.tile(p[:, None], n)) for f, p in pushes]
    still = np.zeros(3)
    reference = {
        "mass": [s.reference(with_mass(i, 1.0, still)) for i in range(2)],
        "centre": [s.reference(with_mass(i, 0.0, shift)) for i in range(2) for shift in np.eye(3)],
        "force": [s.reference(with_push(f, p)) for f, p in pushes],
    }
    for kind, columns in (("mass", masses), ("centre", centres), ("force", forces)):
        ours, other = s.ours.pose_derivatives(columns), np.stack(reference[kind], axis=2)
        if np.abs(other).max() == 0.0:  # the weight of a horizontal planar machine is across its plane
            assert kind in {"mass", "centre"}
            assert s.pair.machine.name in {"rrr3", "rrr4"}
            assert np.abs(ours).max() == 0.0
            continue
        # A centre of mass moves no force: places and turns share one scale.
        together = float(np.abs(ours - other).max() / np.abs(other).max())
        share = together if kind == "centre" else s.worst(ours, other)
        print(f"\n{s.pair.machine.name}: {kind} {share:.0e}")
        assert share < AGREEMENT


@every_machine
@pytest.mark.parametrize("part", PARTS)
def test_derivatives_with_the_growth_of_a_part(make, part):
    s = at_rest(make())
    ours = s.ours.pose_derivatives([s.ours.growth(part)])
    share = s.worst(ours, s.reference(with_growth(part))[:, :, None])
    print(f"\n{s.pair.machine.name}: growth of {part} {share:.0e}")
    assert share < AGREEMENT


@pytest.mark.parametrize("name", shipped_machines())
def test_stiffness_is_without_effect_where_nothing_is_strained(name):
    """An exactly constrained machine without load: all residuals are round-off, and so are these columns.

    An over-constrained one is strained by its errors and the columns are not zero.
    """
    s = at_rest(twin(name), loaded=False)
    columns = s.ours.pose_derivatives(
        [s.ours.ln_stiffness(c) for c in range(len(s.pair.machine.nominal.stiffness_n_per_m))]
    )
    reference = [s.reference(with_parameter(n)) for n in s.pair.reference.names if n.startswith("ln_stiffness")]
    assert np.abs(columns - np.stack(reference, axis=2)).max() < 1e-14
    if s.pair.machine.redundancy == 0:
        assert np.abs(columns).max() < 1e-14
    else:
        assert np.abs(columns).max() > 1e-6


@every_machine
def test_derivatives_of_the_tool_point(make):
    s = at_rest(make())
    machine, model = s.pair.machine, s.pair.reference
    columns = s.ours.drives()
    ours = tool_jacobian(machine, columns, s.rest, s.at)
    for i, (case, pose) in enumerate(zip(s.trial.cases, s.poses, strict=True)):
        tool = [x * case.grown("platform") for x in machine.tool_point_m]
        for a in range(columns.shape[2]):
            moved: Pose = model.moved(pose, [STEP * x for x in columns[i, :, a]])
            reference = np.imag(moved.place(tool)) / TINY
            assert np.abs(ours[i, :3, a] - reference).max() < 1e-12
            turns = [columns[i, model.free.index(c), a] if c in model.free else 0.0 for c in COORDINATES[3:]]
            np.testing.assert_array_equal(ours[i, 3:, a], turns)


@pytest.mark.parametrize("name", ["planar4", "delta8", "rrr4", "cranks in space"])
def test_derivatives_of_what_a_drive_carries(name):
    """The place of a reflector on a slider or crank with every parameter of that drive."""
    s = at_rest(TWINS[name]())
    point = np.array([0.11, -0.23, 0.05])
    for a, drive in enumerate(s.pair.machine.drive_names):
        ours = s.pair.parameters.shift_of_carried_point(s.ours, a, point)
        for j, parameter in enumerate(s.pair.parameters.names):
            theta = s.trial.theta | {parameter: s.trial.theta[parameter] + STEP}
            places = [s.pair.reference.carried_point(theta, case, drive, list(point)) for case in s.trial.cases]
            np.testing.assert_allclose(ours[:, :, j], np.imag(places) / TINY, rtol=0.0, atol=1e-12)


COUNTERBALANCE = """
[[struts]]
name = "spring"
platform_joint_m = [0.0, 0.0, 0.0]
base_joint_m = [0.0, 1.5, 0.0]
length_m = 1.0
stiffness_n_per_m = 3.0e3

[tolerances]"""


def test_derivatives_with_a_soft_spring_far_from_its_free_length():
    """A counterbalance holds the platform's weight: at rest it is strained by half of its length."""
    text = shipped_machine("planar4").read_text(encoding="utf-8")
    s = at_rest(Twin.of(text.replace("\n[tolerances]", COUNTERBALANCE, 1)))
    name = "strut_length.left_upper"
    column = s.pair.parameters.gradient_columns(s.ours)[s.pair.parameters.names.index(name)]
    assert s.worst(s.ours.pose_derivatives([column]), s.reference(with_parameter(name))[:, :, None]) < AGREEMENT


def test_every_shipped_machine_is_among_those_tested():
    assert set(shipped_machines()) <= set(TWINS)
