"""`calibration` against the second model of the machine file, for every shipped machine and three that are made up.

`Twin` also serves the other tests here: it hands the same errors, drives, loads and growth to both models.
"""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass
from functools import cache

import mpmath
import numpy as np
import pytest

from calibration.base.arrays import Array
from calibration.base.rotation import rotation_vector
from calibration.machine import inverse
from calibration.machine.description import Geometry, Machine, parse_machine, shipped_machine, shipped_machines
from calibration.machine.equilibrium import Conditions, Equilibrium, carriers_of, solve, state_at
from calibration.model.parameters import ParameterSet
from tests.calibration.reference_model import (
    COORDINATES,
    EXTENDED,
    PARTS,
    TINY,
    Case,
    Pose,
    ReferenceModel,
    Trial,
    dot,
    matrix,
    quaternion,
)

SAME_REST = 1e-13  # m or rad


@dataclass(frozen=True)
class Twin:
    """One machine file in both models."""

    machine: Machine
    parameters: ParameterSet
    reference: ReferenceModel

    @classmethod
    def of(cls, text: str) -> Twin:
        machine = parse_machine(text, "machine.toml")
        return cls(machine, ParameterSet.of(machine), ReferenceModel(text))

    def theta(self, trial: Trial) -> Array:
        """The trial's errors in the order of `calibration`."""
        return np.array([trial.theta[name] for name in self.parameters.names])

    def geometry(self, trial: Trial) -> Geometry:
        return self.parameters.geometry(self.theta(trial))

    def drives(self, trial: Trial) -> Array:
        return np.array([case.drives for case in trial.cases])

    def conditions(self, trial: Trial) -> Conditions:
        """Loads and growth of a trial; a pose with fewer loads than another gets loads of nothing."""
        origin = [0.0, 0.0, 0.0]
        most = max(len(case.masses) for case in trial.cases)
        masses = [[*case.masses, *[(0.0, origin)] * (most - len(case.masses))] for case in trial.cases]
        pushes = [case.forces[0] if case.forces else (origin, origin) for case in trial.cases]
        return Conditions(
            masses=tuple(
                (np.array([row[i][0] for row in masses]), np.array([row[i][1] for row in masses])) for i in range(most)
            ),
            factors={part: np.array([case.growth.get(part, 1.0) for case in trial.cases]) for part in PARTS},
            forces=((np.array([f for f, _ in pushes]), np.array([at for _, at in pushes])),),
        )

    def solve(self, trial: Trial) -> Equilibrium:
        start = np.array([[*pose.p, *self.reference.rotation_vector(pose)] for pose in trial.starts])
        return solve(self.machine, self.geometry(trial), self.drives(trial), self.conditions(trial), start)


@cache
def twin(name: str) -> Twin:
    return Twin.of(shipped_machine(name).read_text(encoding="utf-8"))


def apart(rest: Equilibrium, poses: list[Pose]) -> tuple[float, float]:
    """Largest distance (m) and turn (rad) between poses at rest and a list of others."""
    assert rest.converged.all(), rest.status
    other = np.array([pose.p for pose in poses])
    turn = np.array([matrix(pose.q) for pose in poses])
    between = rotation_vector(rest.rotation @ turn.transpose(0, 2, 1))
    return (
        float(np.linalg.norm(rest.position_m - other, axis=1).max()),
        float(np.linalg.norm(between, axis=1).max()),
    )


LINE = """
[[guides]]
name = "rail"
kind = "line"
joint = "left_upper"
point_m = [-0.2, 0.125, 0.0]
direction = [0.6, 0.8, 0.0]
stiffness_n_per_m = 2.0e7

[tolerances]"""


def near_the_middle(text: str) -> str:
    """A workspace of some millimetres: the rail leaves no more."""
    return re.sub(r"^([xyz]_m) = .*$", r"\1 = [-2e-3, 2e-3]", text, flags=re.MULTILINE)


def with_line(text: str, entries: str) -> str:
    text = text.replace("\n[tolerances]", entries, 1)
    return text.replace("ln_stiffness = 0.3", "ln_stiffness = 0.3\nguide_position_m = 1e-4\nguide_tilt_rad = 1e-4")


@cache
def twin_on_a_line() -> Twin:
    """planar4 with one joint also on a slanting rail, and a link that stands on the base."""
    text = shipped_machine("planar4").read_text(encoding="utf-8")
    strut = '\n[[struts]]\nname = "post"\nplatform_joint_m = [0.1, -0.1, 0.0]\nbase_joint_m = [0.5, -0.9, 0.0]\n'
    strut += "length_m = 0.894427\nstiffness_n_per_m = 1.0e5\n"
    return Twin.of(with_line(near_the_middle(text), strut + LINE))


@cache
def twin_on_a_rail_in_space() -> Twin:
    """delta8 with a slanting line in space for one of its joints."""
    text = near_the_middle(shipped_machine("delta8").read_text(encoding="utf-8"))
    line = LINE.replace("left_upper", "a_left").replace("[-0.2, 0.125, 0.0]", "[0.12, 0.1, 0.05]")
    return Twin.of(with_line(text, line.replace("[0.6, 0.8, 0.0]", "[0.0, 0.6, 0.8]")))


@cache
def twin_on_cranks_in_space() -> Twin:
    """stewart6 with a crank about a slanting axis in place of each leg, its arm partly along that axis."""
    text = shipped_machine("stewart6").read_text(encoding="utf-8")
    for strut in tomllib.loads(text)["struts"]:
        pivot = np.array(strut["base_joint_m"])
        outwards = pivot / np.linalg.norm(pivot)
        axis = np.cross([0.0, 0.0, 1.0], outwards) + np.array([0.0, 0.0, 0.3])
        axis /= np.linalg.norm(axis)
        arm = 0.2 * outwards + 0.06 * axis
        reach = np.array(strut["platform_joint_m"]) + np.array([0.0, 0.0, 1.0]) - pivot
        branch = 1 if axis @ np.cross(arm, reach) > 0.0 else -1
        crank = f'kind = "crank"\npivot_m = {pivot.tolist()}\naxis = {axis.tolist()}\nbranch = {branch}\n'
        text = text.replace('kind = "leg"\ntravel_m = [0.0, 0.5]\n', crank + "travel_rad = [-0.5, 0.5]\n", 1)
        text = text.replace(f"base_joint_m = {strut['base_joint_m']}", f"base_joint_m = {arm.tolist()}", 1)
        text = text.replace("length_m = 0.882356", f"length_m = {float(np.linalg.norm(reach - arm))!r}", 1)
    text = re.sub(r"^(r[xyz]_rad|[xy]_m) = .*$", r"\1 = [-0.05, 0.05]", text, flags=re.MULTILINE)
    text = text.replace("z_m = [1.0, 1.2]", "z_m = [1.05, 1.15]")
    return Twin.of(text.replace("drive_scale =", "pivot_m = 1e-4\naxis_tilt_rad = 1e-4\ndrive_scale =", 1))


TWINS = {name: (lambda name=name: twin(name)) for name in shipped_machines()}
TWINS |= {"planar4 on a line": twin_on_a_line, "delta8 on a line": twin_on_a_rail_in_space}
TWINS["cranks in space"] = twin_on_cranks_in_space
every_machine = pytest.mark.parametrize("make", TWINS.values(), ids=TWINS.keys())


@every_machine
def test_both_models_name_the_same_unknowns(make):
    t = make()
    assert list(t.parameters.names) == t.reference.names
    assert [p.tolerance for p in t.parameters.parameters] == [t.reference.tolerance(n) for n in t.reference.names]


@every_machine
def test_the_references_own_balance_is_the_gradient_of_its_energy(make):
    """Away from rest, by complex step: the check of the reference itself."""
    model = make().reference
    trial = model.trial(seed=101, count=6)
    for case, start in zip(trial.cases, trial.starts, strict=True):
        constraints, loads = model.constraints(trial.theta, case), model.loads(case)
        pose = model.moved(start, [1e-3, -2e-3, 3e-3, 1e-3, -2e-3, 3e-3][: len(model.free)])
        balance = np.array(model.balance(pose, constraints, loads))
        for j, component in enumerate(balance):
            step = [complex(0.0, TINY) if i == j else 0.0 for i in range(len(model.free))]
            slope = model.energy(model.moved(pose, step), constraints, loads).imag / TINY
            assert abs(slope - component) < 1e-13 * np.abs(balance).max()


@every_machine
def test_both_models_come_to_rest_in_the_same_place(make):
    """80 poses of each machine, each with errors, payload, push and temperatures of its own."""
    t = make()
    far = turn = stretch = 0.0
    for seed in (1, 2):
        trial = t.reference.trial(seed, count=40)
        poses = [t.reference.rest(trial.theta, c, s) for c, s in zip(trial.cases, trial.starts, strict=True)]
        rest = t.solve(trial)
        position, angle = apart(rest, poses)
        far, turn = max(far, position), max(turn, angle)
        for i, (case, pose) in enumerate(zip(trial.cases, poses, strict=True)):
            for c, constraint in enumerate(t.reference.constraints(trial.theta, case)):
                residual, _ = constraint.residual_and_direction(pose, t.reference.maths)
                stretch = max(stretch, abs(rest.force_n[i, c] / constraint.stiffness - residual))
    print(f"\n{t.machine.name}: {far:.1e} m, {turn:.1e} rad, elongations {stretch:.1e} m")
    assert max(far, turn, stretch) < SAME_REST


@every_machine
def test_both_models_see_the_same_stiffness_and_it_is_symmetric_at_rest(make):
    t = make()
    trial = t.reference.trial(seed=4, count=8)
    rest = t.solve(trial)
    state = state_at(t.machine, t.geometry(trial), t.drives(trial), t.conditions(trial), rest.position_m, rest.rotation)
    ours = state.hessian()
    for i, (case, start) in enumerate(zip(trial.cases, trial.starts, strict=True)):
        pose = t.reference.rest(trial.theta, case, start)
        constraints, loads = t.reference.constraints(trial.theta, case), t.reference.loads(case)
        other = np.array(t.reference.stiffness(pose, constraints, loads))
        scale = np.sqrt(np.outer(np.diag(other), np.diag(other)))
        assert np.abs((other - other.T) / scale).max() < 1e-12
        assert np.abs((ours[:, :, i] - other) / scale).max() < 1e-12


@pytest.mark.parametrize("name", ["planar4", "rrr4", "gough8", "prs3"])
def test_forty_digits_change_nothing(name):
    """The reference's rest in extended precision: what double precision costs either model."""
    t = twin(name)
    trial = t.reference.trial(seed=5, count=3)
    rest = t.solve(trial)
    with mpmath.workdps(40):
        exact = ReferenceModel(t.machine.text, EXTENDED)
        poses = []
        for case, start in zip(trial.cases, trial.starts, strict=True):
            near = t.reference.rest(trial.theta, case, start).in_digits()
            pose = exact.rest(trial.theta, case, near, steps=3)
            assert max(abs(x) for x in exact.unrest(trial.theta, case, pose)) < mpmath.mpf("1e-35")
            poses.append(Pose([float(x) for x in pose.p], [float(x) for x in pose.q]))
    assert max(apart(rest, poses)) < SAME_REST


@every_machine
def test_nominal_drive_positions_close_their_struts_on_the_right_side(make):
    """The closed formulas of docs/reference/machine.md, checked by length and branch, then `calibration`."""
    t = make()
    trial = t.reference.trial(seed=6, count=30, loaded=False)
    target = np.array([[*pose.p, *t.reference.rotation_vector(pose)] for pose in trial.starts])
    ours = inverse.rigid_drives(t.machine, t.machine.nominal, target)
    np.testing.assert_allclose(ours, t.drives(trial), atol=1e-14)
    for case, pose in zip(trial.cases, trial.starts, strict=True):
        constraints = {c.name: c for c in t.reference.constraints({}, case)}
        for entry in t.reference.drives:
            strut = constraints[next(s["name"] for s in t.reference.file["struts"] if s.get("drive") == entry["name"])]
            residual, _ = strut.residual_and_direction(pose, t.reference.maths)
            assert abs(residual) < 1e-14
            w = pose.place(strut.joint)
            if entry["kind"] == "slider":
                assert entry["branch"] * dot(entry["axis"], np.subtract(strut.end, w)) > 0.0
            if entry["kind"] == "crank":
                arm, reach = np.subtract(strut.end, entry["pivot_m"]), np.subtract(w, entry["pivot_m"])
                assert entry["branch"] * dot(entry["axis"], np.cross(arm, reach)) > 0.0


@pytest.mark.parametrize(
    ("pose", "left_m", "right_m"),
    [((0.0, 0.0), 1.118033988749895, 1.118033988749895), ((0.35, 0.30), 0.953834841531101, 1.651850583459577)],
)
def test_golden_poses_of_the_machine_document(pose, left_m, right_m):
    t = twin("planar4")
    at = Pose([*pose, 0.0], [1.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(t.reference.nominal_drives(at), [left_m, right_m], atol=2e-15)
    rest = t.reference.rest({}, Case([left_m, right_m]), Pose([0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]))
    np.testing.assert_allclose(rest.p, [*pose, 0.0], atol=1e-15)


@pytest.mark.parametrize("name", ["planar4", "rrr3", "hexaglide"])
def test_what_a_drive_carries_is_in_the_same_place(name):
    """Reflectors on sliders and cranks ride like joints."""
    t = twin(name)
    trial = t.reference.trial(seed=7, count=5)
    carriers = carriers_of(t.machine, t.geometry(trial), t.drives(trial), t.conditions(trial))
    point = [0.11, -0.23, 0.05]
    for a, drive in enumerate(t.machine.drive_names):
        places = [t.reference.carried_point(trial.theta, case, drive, point) for case in trial.cases]
        np.testing.assert_allclose(carriers[a].position(np.array(point)).T, places, atol=1e-15)


def test_a_quaternion_and_its_rotation_vector_are_inverse():
    model = twin("gough8").reference
    for vector in ([0.0, 0.0, 0.0], [1e-9, 0.0, 2e-9], [0.3, -1.2, 2.0]):
        pose = Pose([0.0, 0.0, 0.0], quaternion(vector))
        np.testing.assert_allclose(model.rotation_vector(pose), vector, atol=1e-15)
        np.testing.assert_allclose(rotation_vector(np.array(matrix(pose.q))[None])[0], vector, atol=1e-15)
    assert len(COORDINATES) == 6
