"""A second model of any machine file, written from docs/reference/machine.md alone, to check `calibration` against.

It imports nothing from `calibration` and is formulated differently on purpose: the orientation is a quaternion, moves
are Cayley turns, the gradient of the energy is the balance of forces with each strut's moment taken at its base end,
and the stiffness matrix is the derivative of that balance by complex step. Slow and plain: one pose at a time.

Every number may be a float, a complex number (complex steps), a numpy array (many poses or draws at once: nothing
here asks a number for its value) or an `mpmath.mpf` (with `EXTENDED`). Vectors are lists.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import mpmath
import numpy as np

Number = Any
Vector = list[Number]

COORDINATES = ("x", "y", "z", "rx", "ry", "rz")
PARTS = ("struts", "drives", "base", "platform")
TINY = 1e-40  # complex step: no subtraction, so nothing is lost however small it is
KINDS = (
    "strut_length",
    "platform_joint",
    "base_joint",
    "pivot",
    "guide_position",
    "guide_tilt",
    "axis_tilt",
    "drive_scale",
    "ln_stiffness",
)
TOLERANCES = dict.fromkeys(KINDS, "_m") | {
    "guide_tilt": "_rad",
    "axis_tilt": "_rad",
    "drive_scale": "",
    "ln_stiffness": "",
}


@dataclass(frozen=True)
class Arithmetic:
    """The functions of one kind of number, and how a constant of the file becomes one."""

    number: Callable[[float], Number]
    sqrt: Callable[[Number], Number]
    sin: Callable[[Number], Number]
    cos: Callable[[Number], Number]
    exp: Callable[[Number], Number]


DOUBLE = Arithmetic(float, np.sqrt, np.sin, np.cos, np.exp)
EXTENDED = Arithmetic(mpmath.mpf, mpmath.sqrt, mpmath.sin, mpmath.cos, mpmath.exp)


def dot(a: Sequence[Number], b: Sequence[Number]) -> Number:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Sequence[Number], b: Sequence[Number]) -> Vector:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def added(a: Sequence[Number], b: Sequence[Number], times: Number = 1) -> Vector:
    return [x + times * y for x, y in zip(a, b, strict=True)]


def scaled(a: Sequence[Number], by: Number) -> Vector:
    return [x * by for x in a]


def quaternion_product(a: Sequence[Number], b: Sequence[Number]) -> Vector:
    """The turn b followed by the turn a; scalar part first."""
    u, v = a[1:], b[1:]
    return [a[0] * b[0] - dot(u, v), *added(added(scaled(v, a[0]), u, b[0]), cross(u, v))]


def turned(q: Sequence[Number], v: Sequence[Number]) -> Vector:
    """A vector turned by a unit quaternion."""
    twice = scaled(cross(q[1:], v), 2)
    return added(added(v, twice, q[0]), cross(q[1:], twice))


@dataclass(frozen=True)
class Pose:
    """Place of the platform origin and unit quaternion of its orientation."""

    p: Vector
    q: Vector

    def in_digits(self) -> Pose:
        """The same in extended precision: a quaternion of doubles is of length 1 to some 1e-16 only."""
        q = [mpmath.mpf(x) for x in self.q]
        norm = mpmath.sqrt(sum(x * x for x in q))
        return Pose([mpmath.mpf(x) for x in self.p], scaled(q, 1 / norm))

    def place(self, point: Sequence[Number]) -> Vector:
        """A point of the platform (already grown) in the machine frame."""
        return added(self.p, turned(self.q, point))


@dataclass(frozen=True)
class Constraint:
    """A strut (`normal` is None: `length` from `end` to the joint) or a plane through `end` with a normal."""

    name: str
    joint: Vector
    end: Vector
    length: Number
    stiffness: Number
    normal: Vector | None = None

    def residual_and_direction(self, pose: Pose, maths: Arithmetic) -> tuple[Number, Vector]:
        v = added(pose.place(self.joint), self.end, -1)
        if self.normal is not None:
            return dot(self.normal, v), self.normal
        distance = maths.sqrt(dot(v, v))
        return distance - self.length, scaled(v, 1 / distance)

    def moment_arm(self, pose: Pose) -> Vector:
        """From the platform origin to a point of the line of action: a strut's base end serves as well as its joint."""
        return added(self.end, pose.p, -1) if self.normal is None else turned(pose.q, self.joint)


@dataclass(frozen=True)
class Load:
    """A force in the machine frame at a (grown) point of the platform."""

    force: Vector
    point: Vector


@dataclass(frozen=True)
class Case:
    """What a pose at rest depends on besides the parameters.

    masses: mass and centre (platform frame); forces: force (machine frame) and point (platform frame);
    growth: thermal length factor of a part, 1 where it is not listed.
    """

    drives: Sequence[Number]
    masses: Sequence[tuple[Number, Sequence[Number]]] = ()
    forces: Sequence[tuple[Sequence[Number], Sequence[Number]]] = ()
    growth: Mapping[str, Number] = field(default_factory=dict)

    def grown(self, part: str) -> Number:
        return self.growth.get(part, 1)


@dataclass(frozen=True)
class Trial:
    """Random errors within the tolerances, and random poses: what acts there and where to start looking for rest."""

    theta: dict[str, float]
    cases: list[Case]
    starts: list[Pose]


@dataclass(frozen=True)
class Tilt:
    """A direction about which an axis or a normal may be in error, and what it is called."""

    label: str
    about: tuple[float, float, float]


class ReferenceModel:
    """One machine file. Parameters are named deviations from nominal; those that are not given are zero."""

    def __init__(self, text: str, maths: Arithmetic = DOUBLE) -> None:
        self.file = tomllib.loads(text)
        self.maths = maths
        self.free = [c for c in COORDINATES if c in self.file["degrees_of_freedom"]]
        self.planar = not {"z", "rx", "ry"} & set(self.free)
        self.drives = self.file["drives"]
        self.drive_names = [d["name"] for d in self.drives]
        self.planes = [plane for guide in self.file.get("guides", []) for plane in planes_of(guide)]
        self.gravity = [maths.number(g) for g in self.file["gravity_m_per_s2"]]
        platform = self.file["platform"]
        self.moving = (
            maths.number(platform["moving_mass_kg"]),
            [maths.number(c) for c in platform["centre_of_mass_m"]],
        )
        self.tool_point = [maths.number(c) for c in platform["tool_point_m"]]
        self.tilts: dict[str, tuple[float, float, float]] = {}
        self.names = list(self._names())

    def _names(self) -> list[str]:
        struts = [s["name"] for s in self.file["struts"]]
        axes = "xy" if self.planar else "xyz"
        names = [f"strut_length.{s}" for s in struts]
        names += [f"{end}_joint.{s}.{c}" for end in ("platform", "base") for s in struts for c in axes]
        names += [f"pivot.{d['name']}.{c}" for d in self.drives if d["kind"] == "crank" for c in axes]
        names += [f"guide_position.{plane['name']}" for plane in self.planes]
        tilted = [("guide_tilt", plane["name"], plane["turns"]) for plane in self.planes]
        tilted += [("axis_tilt", d["name"], across(d["axis"])) for d in self.drives if d["kind"] != "leg"]
        for kind, name, turns in tilted:
            for tilt in named_tilts(turns):
                if tilt.label == "rz" or not self.planar:
                    self.tilts[f"{kind}.{name}.{tilt.label}"] = tilt.about
                    names.append(f"{kind}.{name}.{tilt.label}")
        names += [f"drive_scale.{d}" for d in self.drive_names]
        return names + [f"ln_stiffness.{c}" for c in (*struts, *(plane["name"] for plane in self.planes))]

    def tolerance(self, name: str) -> float:
        """Half-width of a parameter's uniform distribution."""
        kind, _, _ = name.partition(".")
        return float(self.file["tolerances"][kind + TOLERANCES[kind]])

    # --- the machine with its errors ---------------------------------------------------------------------------------

    def constraints(self, theta: Mapping[str, Number], case: Case) -> list[Constraint]:
        """Struts and planes as they stand, grown and moved by the drives."""
        made = []
        for s in self.file["struts"]:
            name = s["name"]
            joint = self._point(theta, "platform_joint", name, s["platform_joint_m"])
            base = self._point(theta, "base_joint", name, s["base_joint_m"])
            length = (self.maths.number(s["length_m"]) + theta.get(f"strut_length.{name}", 0)) * case.grown("struts")
            end, longer = self._carried(theta, case, s.get("drive"), base)
            stiffness = self.maths.number(s["stiffness_n_per_m"]) * self._softer(theta, name)
            made.append(Constraint(name, scaled(joint, case.grown("platform")), end, length + longer, stiffness))
        joints = {c.name: c.joint for c in made}
        for plane in self.planes:
            name = plane["name"]
            nominal = [self.maths.number(c) for c in plane["normal"]]
            point = [self.maths.number(c) for c in plane["point"]]
            point = added(point, nominal, theta.get(f"guide_position.{name}", 0))
            normal = self._tilted(theta, "guide_tilt", name, nominal)
            stiffness = self.maths.number(plane["stiffness"]) * self._softer(theta, name)
            end = scaled(point, case.grown("base"))
            made.append(Constraint(name, joints[plane["joint"]], end, 0, stiffness, normal))
        return made

    def carried_point(
        self, theta: Mapping[str, Number], case: Case, drive: str | None, point: Sequence[Number]
    ) -> Vector:
        """Place of a point that a drive (or the base: None) carries, in the machine frame."""
        return self._carried(theta, case, drive, point)[0]

    def _carried(
        self, theta: Mapping[str, Number], case: Case, drive: str | None, point: Sequence[Number]
    ) -> tuple[Vector, Number]:
        """Place of a carried point, and by how much a leg's drive lengthens its strut."""
        if drive is None:
            return scaled(point, case.grown("base")), 0
        index = self.drive_names.index(drive)
        entry = self.drives[index]
        travel = case.drives[index] * (1 + theta.get(f"drive_scale.{drive}", 0))
        if entry["kind"] == "leg":
            return scaled(point, case.grown("base")), travel * case.grown("drives")
        axis = self._tilted(theta, "axis_tilt", drive, [self.maths.number(c) for c in entry["axis"]])
        if entry["kind"] == "slider":
            return added(scaled(point, case.grown("base")), axis, travel * case.grown("drives")), 0
        pivot = self._point(theta, "pivot", drive, entry["pivot_m"])
        half = travel / 2
        arm = turned([self.maths.cos(half), *scaled(axis, self.maths.sin(half))], point)
        return added(scaled(pivot, case.grown("base")), arm, case.grown("drives")), 0

    def loads(self, case: Case) -> list[Load]:
        """The forces on the platform: weights and pushes, at grown points."""
        weights = [Load(scaled(self.gravity, mass), list(centre)) for mass, centre in case.masses]
        pushes = [Load(list(force), list(point)) for force, point in case.forces]
        return [Load(load.force, scaled(load.point, case.grown("platform"))) for load in (*weights, *pushes)]

    def _point(self, theta: Mapping[str, Number], kind: str, name: str, nominal: Sequence[float]) -> Vector:
        return [self.maths.number(x) + theta.get(f"{kind}.{name}.{c}", 0) for x, c in zip(nominal, "xyz", strict=True)]

    def _softer(self, theta: Mapping[str, Number], name: str) -> Number:
        ln_ratio = theta.get(f"ln_stiffness.{name}", 0)
        return self.maths.exp(ln_ratio)

    def _tilted(self, theta: Mapping[str, Number], kind: str, name: str, direction: Vector) -> Vector:
        """exp([tilt]x) direction, with the series of the exponential: tilts are small and their root is singular."""
        tilt: Vector = [0, 0, 0]
        for label in ("rx", "ry", "rz", "t1", "t2"):
            value = theta.get(f"{kind}.{name}.{label}", 0)
            if f"{kind}.{name}.{label}" in self.tilts:
                tilt = added(tilt, [self.maths.number(c) for c in self.tilts[f"{kind}.{name}.{label}"]], value)
        term, total = direction, direction
        for order in range(1, 13):
            term = scaled(cross(tilt, term), self.maths.number(1.0) / order)
            total = added(total, term)
        return total

    # --- statics -----------------------------------------------------------------------------------------------------

    def energy(self, pose: Pose, constraints: Sequence[Constraint], loads: Sequence[Load]) -> Number:
        """V of docs/reference/machine.md."""
        total = 0
        for c in constraints:
            residual, _ = c.residual_and_direction(pose, self.maths)
            total = total + c.stiffness * residual * residual / 2
        for load in loads:
            total = total - dot(load.force, pose.place(load.point))
        return total

    def balance(self, pose: Pose, constraints: Sequence[Constraint], loads: Sequence[Load]) -> Vector:
        """Gradient of V over the free coordinates: minus the force and moment on the platform."""
        force: Vector = [0, 0, 0]
        moment: Vector = [0, 0, 0]
        for c in constraints:
            residual, direction = c.residual_and_direction(pose, self.maths)
            pull = scaled(direction, c.stiffness * residual)
            force = added(force, pull)
            moment = added(moment, cross(c.moment_arm(pose), pull))
        for load in loads:
            force = added(force, load.force, -1)
            moment = added(moment, cross(turned(pose.q, load.point), load.force), -1)
        both = [*force, *moment]
        return [both[COORDINATES.index(c)] for c in self.free]

    def moved(self, pose: Pose, step: Sequence[Number]) -> Pose:
        """A pose moved by a step of its free coordinates, turning on the left (Cayley: exact to second order)."""
        full: Vector = [0] * 6
        for c, value in zip(self.free, step, strict=True):
            full[COORDINATES.index(c)] = value
        half = scaled(full[3:], self.maths.number(0.5))
        shrink = 1 / self.maths.sqrt(self.maths.number(1.0) + dot(half, half))
        turn = [shrink, *scaled(half, shrink)]
        return Pose(added(pose.p, full[:3]), quaternion_product(turn, pose.q))

    def stiffness(self, pose: Pose, constraints: Sequence[Constraint], loads: Sequence[Load]) -> list[Vector]:
        """Derivative (f, f) of the balance with the free coordinates, by complex step (real numbers only)."""
        if self.maths is EXTENDED:
            return self._stiffness_by_differences(pose, constraints, loads)
        columns = []
        for j in range(len(self.free)):
            step = [complex(0.0, TINY) if i == j else 0.0 for i in range(len(self.free))]
            columns.append([np.imag(g) / TINY for g in self.balance(self.moved(pose, step), constraints, loads)])
        return [list(row) for row in zip(*columns, strict=True)]

    def _stiffness_by_differences(
        self, pose: Pose, constraints: Sequence[Constraint], loads: Sequence[Load]
    ) -> list[Vector]:
        """Central differences whose error is a third of the digits in use away from nothing."""
        width = mpmath.mpf(10) ** (-mpmath.mp.dps // 3)
        columns = []
        for j in range(len(self.free)):
            steps = [[sign * width if i == j else 0 for i in range(len(self.free))] for sign in (1, -1)]
            ahead, behind = (self.balance(self.moved(pose, step), constraints, loads) for step in steps)
            columns.append(scaled(added(ahead, behind, -1), 1 / (2 * width)))
        return [list(row) for row in zip(*columns, strict=True)]

    def rest(self, theta: Mapping[str, Number], case: Case, start: Pose, steps: int = 8) -> Pose:
        """The pose at rest by `steps` Newton steps: no test of convergence, so that arrays pass; see `unrest`."""
        constraints, loads = self.constraints(theta, case), self.loads(case)
        pose = start
        for _ in range(steps):
            gradient = self.balance(pose, constraints, loads)
            pose = self.moved(pose, scaled(solved(self.stiffness(pose, constraints, loads), gradient), -1))
        return pose

    def unrest(self, theta: Mapping[str, Number], case: Case, pose: Pose) -> Vector:
        """The Newton step that is still missing at a pose."""
        constraints, loads = self.constraints(theta, case), self.loads(case)
        return solved(self.stiffness(pose, constraints, loads), self.balance(pose, constraints, loads))

    def rotation_vector(self, pose: Pose) -> Vector:
        """Rotation vector of a real pose, for angles below pi."""
        w, u = pose.q[0], pose.q[1:]
        sine = self.maths.sqrt(dot(u, u))
        if self.maths is EXTENDED:
            return scaled(u, 2 if sine == 0 else 2 * mpmath.atan2(sine, w) / sine)
        safe = np.where(sine > 1e-150, sine, 1.0)
        return scaled(u, np.where(sine > 1e-150, 2.0 * np.arctan2(sine, w) / safe, 2.0))

    # --- random poses ------------------------------------------------------------------------------------------------

    def trial(self, seed: int, count: int, *, loaded: bool = True) -> Trial:
        """Errors within the tolerances; poses of the workspace, each with its own payload, push and temperatures.

        Every fifth pose carries nothing but the moving mass; none carries anything if not `loaded`.
        """
        rng = np.random.default_rng(seed)
        theta = {name: self.tolerance(name) * rng.uniform(-1.0, 1.0) for name in self.names}
        heaviest = max([case["mass_kg"] for case in self.file.get("load_cases", [])], default=300.0)
        cases, starts = [], []
        for number in range(count):
            space = self.file["workspace"]
            ranges = [space.get(f"{c}_{'rad' if c[0] == 'r' else 'm'}", (0.0, 0.0)) for c in COORDINATES]
            target = [float(rng.uniform(*r)) for r in ranges]
            q = quaternion(target[3:])
            pose = Pose(added(target[:3], turned(q, self.file["platform"]["tool_point_m"]), -1), q)
            growth = {part: 1.0 + 11e-6 * float(rng.uniform(-5.0, 10.0)) for part in PARTS}
            payload = (heaviest * float(rng.uniform()), rng.uniform(-0.1, 0.1, 3).tolist())
            push = (
                [float(c) for c in rng.normal(0.0, 5.0 * heaviest, 3)],
                rng.uniform(-0.1, 0.1, 3).tolist(),
            )
            acting = loaded and number % 5 != 0
            masses = [self.moving, payload] if acting else [self.moving] if loaded else []
            cases.append(Case(self.nominal_drives(pose), masses, [push] if acting else [], growth if loaded else {}))
            starts.append(pose)
        return Trial(theta, cases, starts)

    # --- nominal drive positions -------------------------------------------------------------------------------------

    def nominal_drives(self, pose: Pose) -> list[float]:
        """Drive coordinates that close the first strut of every nominal drive, docs/reference/machine.md."""
        items = []
        for entry in self.drives:
            s = next(s for s in self.file["struts"] if s.get("drive") == entry["name"])
            w, b, length = pose.place(s["platform_joint_m"]), s["base_joint_m"], s["length_m"]
            if entry["kind"] == "leg":
                items.append(math.dist(w, b) - length)
            elif entry["kind"] == "slider":
                d = added(w, b, -1)
                along = dot(entry["axis"], d)
                aside = added(d, entry["axis"], -along)
                items.append(along + entry["branch"] * math.sqrt(length**2 - dot(aside, aside)))
            else:
                items.append(_crank_angle(added(w, entry["pivot_m"], -1), b, entry["axis"], length, entry["branch"]))
        return items


def _crank_angle(d: Vector, b: Sequence[float], u: Sequence[float], length: float, branch: int) -> float:
    d_across, b_across = added(d, u, -dot(u, d)), added(b, u, -dot(u, b))
    reach = math.sqrt(dot(d_across, d_across) * dot(b_across, b_across))
    cosine = (dot(d, d) + dot(b, b) - length**2 - 2.0 * dot(u, d) * dot(u, b)) / (2.0 * reach)
    between = math.atan2(dot(u, cross(b_across, d_across)), dot(b_across, d_across))
    return math.remainder(between - branch * math.acos(cosine), math.tau)


def across(direction: Sequence[float]) -> list[tuple[float, float, float]]:
    """Two directions across a third: the first near a machine axis that the direction has little of, then the other."""
    largest = max(range(3), key=lambda c: (abs(direction[c]), c))
    little = min(c for c in range(3) if c != largest)
    first = [float(c == little) - direction[little] * direction[c] for c in range(3)]
    norm = math.sqrt(dot(first, first))
    first = [c / norm for c in first]
    second = cross(direction, first)
    return [(first[0], first[1], first[2]), (second[0], second[1], second[2])]


def named_tilts(turns: Sequence[tuple[float, float, float]]) -> list[Tilt]:
    """'rx' along +x and so on where the direction is an axis of the machine, else 't1' and 't2'."""
    tilts = []
    for number, about in enumerate(turns, start=1):
        along = max(range(3), key=lambda c, about=about: abs(about[c]))
        if abs(about[along]) > 1.0 - 1e-12:
            sign = math.copysign(1.0, about[along])
            tilts.append(Tilt("r" + "xyz"[along], (about[0] * sign, about[1] * sign, about[2] * sign)))
        else:
            tilts.append(Tilt(f"t{number}", about))
    return tilts


def planes_of(guide: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The planes of a guide: one, or two that meet in its line."""
    first, second = across(guide["direction"])
    common = {"joint": guide["joint"], "point": guide["point_m"], "stiffness": guide["stiffness_n_per_m"]}
    if guide["kind"] == "plane":
        return [common | {"name": guide["name"], "normal": guide["direction"], "turns": [first, second]}]
    return [
        common | {"name": f"{guide['name']}.1", "normal": first, "turns": [second]},
        common | {"name": f"{guide['name']}.2", "normal": second, "turns": [first]},
    ]


def solved(matrix: Sequence[Sequence[Number]], right: Sequence[Number]) -> Vector:
    """Solution of a positive definite system by elimination without pivoting."""
    a = [[*row, r] for row, r in zip(matrix, right, strict=True)]
    n = len(a)
    for i in range(n):
        for j in range(i + 1, n):
            factor = a[j][i] / a[i][i]
            a[j] = [x - factor * y for x, y in zip(a[j], a[i], strict=True)]
    x: Vector = [0] * n
    for i in reversed(range(n)):
        total = a[i][n]
        for j in range(i + 1, n):
            total = total - a[i][j] * x[j]
        x[i] = total / a[i][i]
    return x


def quaternion(vector: Sequence[float]) -> Vector:
    """Unit quaternion of a rotation vector of floats."""
    angle = math.sqrt(dot(vector, vector))
    return [math.cos(angle / 2.0), *scaled(vector, 0.5 if angle == 0.0 else math.sin(angle / 2.0) / angle)]


def matrix(q: Sequence[Number]) -> list[Vector]:
    """Rotation matrix of a unit quaternion."""
    return [list(row) for row in zip(*(turned(q, [float(i == j) for i in range(3)]) for j in range(3)), strict=True)]
