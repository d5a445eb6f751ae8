"""Parameter combinations that are known to be unobservable on such machines, and their wording.

Each is a set of deviations that may move together; whether the data constrain them is decided elsewhere.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.machine.description import FIXED, Machine
from calibration.model.parameters import MachineParameter, ParameterSet

MAX_TERMS = 8
MIN_SHARE = 0.25  # of the largest term
AXES = "xyz"


@dataclass(frozen=True)
class KnownCombination:
    """Parameters that may move together: name to deviation (SI), and the sentence for it."""

    coefficients: Mapping[str, float]
    words: str


def known_combinations(parameters: ParameterSet) -> Iterator[KnownCombination]:
    """Known combinations of a machine, simple ones first; those with parameters that are not free are omitted."""
    names = set(parameters.names)
    machine = parameters.machine
    groups = (
        _stiffness_combinations(machine),
        _joint_pair_combinations(machine),
        _guide_plane_combinations(parameters),
        _rigid_body_combinations(parameters),
    )
    for group in groups:
        for candidate in group:
            coefficients = {n: v for n, v in candidate.coefficients.items() if v != 0.0}
            if coefficients and set(coefficients) <= names:
                yield KnownCombination(coefficients, candidate.words)


def list_terms(parameters: ParameterSet, coefficients: Mapping[str, float]) -> KnownCombination:
    """A combination without a known name: its terms in units of the tolerance, the largest first."""
    tolerance = {p.name: p.tolerance for p in parameters.parameters}
    share = {name: value / tolerance[name] for name, value in coefficients.items()}
    ordered = sorted(share, key=lambda name: (-round(abs(share[name]), 6), name))
    if len(ordered) == 1:
        return KnownCombination(coefficients, f"{ordered[0]} not at all")
    largest = share[ordered[0]]
    terms_named = [name for name in ordered[:MAX_TERMS] if abs(share[name] / largest) > MIN_SHARE]
    terms = [f"{share[name] / largest:+.2g} {name}" for name in terms_named]
    more = f" and {len(ordered) - len(terms_named)} more" if len(ordered) > len(terms_named) else ""
    return KnownCombination(coefficients, f"may move together (in units of their tolerances): {', '.join(terms)}{more}")


def merge_sentences(words: Sequence[str]) -> tuple[str, ...]:
    """Sentences; those that differ only in the part that they name (in brackets) become one with all the names."""
    merged: dict[str, list[str]] = {}
    for sentence in words:
        match = re.search(r"\[([^\]]*)\]", sentence)
        pattern = sentence if match is None else sentence.replace(match.group(0), "[]", 1)
        merged.setdefault(pattern, []).append("" if match is None else match.group(1))
    return tuple(pattern.replace("[]", ", ".join(names), 1) for pattern, names in merged.items())


def _stiffness_combinations(machine: Machine) -> Iterator[KnownCombination]:
    every = (*machine.strut_names, *machine.guide_names)
    for name in every:
        yield KnownCombination(
            {f"ln_stiffness.{name}": 1.0}, f"stiffness of [{name}] not at all: no force in it changes"
        )
    together = {f"ln_stiffness.{name}": 1.0 for name in every}
    yield KnownCombination(together, "stiffnesses only as ratios: their common size needs a known load difference")


def _joint_pair_combinations(machine: Machine) -> Iterator[KnownCombination]:
    for i, name in enumerate(machine.strut_names):
        drive = machine.strut_drive[i]
        if drive != FIXED and machine.drive_kinds[drive] == "crank":
            continue
        for c in AXES:
            both = {f"platform_joint.{name}.{c}": 1.0, f"base_joint.{name}.{c}": 1.0}
            yield KnownCombination(both, f"platform and base joint along {c} of [{name}] only as their difference")


def _guide_plane_combinations(parameters: ParameterSet) -> Iterator[KnownCombination]:
    """A joint that is guided in a plane: its base joint and axis may tilt across that plane without any effect."""
    machine = parameters.machine
    for guide, strut in enumerate(machine.guide_joint):
        normal, name = machine.nominal.guide_normal[guide], machine.strut_names[strut]
        shift = {f"base_joint.{name}.{c}": float(normal[k]) for k, c in enumerate(AXES)}
        yield KnownCombination(shift, f"base joint across its guide of [{name}] not at all")
        drive = int(machine.strut_drive[strut])
        if drive != FIXED and machine.drive_kinds[drive] == "slider":
            tilt = np.cross(machine.nominal.axis[drive], normal)
            tilts = _tilts(parameters, "axis_tilt", drive, tilt)
            yield KnownCombination(
                tilts, f"lean across its guide of the axis of [{machine.drive_names[drive]}] not at all"
            )


def _rigid_body_combinations(parameters: ParameterSet) -> Iterator[KnownCombination]:
    """Base and platform as rigid bodies: open if the instrument's frame and the reflectors are unknown."""
    machine = parameters.machine
    for k, c in enumerate(AXES):
        words = f"the base as a body along {c} not at all"
        if set(machine.drive_kinds) == {"slider"} and np.all(np.abs(machine.nominal.axis[:, k]) > 0.99):
            upright = abs(machine.gravity_m_per_s2[k]) > 0.99 * np.linalg.norm(machine.gravity_m_per_s2)
            what = "heights" if upright else "places"
            words = f"{what} of the sliders {', '.join(machine.drive_names)} along {c} only as differences"
        yield KnownCombination(_move_base(parameters, np.eye(3)[k], np.zeros(3)), words)
    for k, c in enumerate(AXES):
        words = f"the base as a body about {c} not at all"
        yield KnownCombination(_move_base(parameters, np.zeros(3), np.eye(3)[k]), words)
    joints = machine.nominal.platform_joint_m
    for c in AXES:
        along = {f"platform_joint.{n}.{c}": 1.0 for n in machine.strut_names}
        yield KnownCombination(along, f"the platform's joints as a body along {c} not at all")
    for k, c in enumerate(AXES):
        turned = np.cross(np.eye(3)[k], joints)
        about = {
            f"platform_joint.{n}.{a}": float(turned[i, j])
            for i, n in enumerate(machine.strut_names)
            for j, a in enumerate(AXES)
        }
        words = f"the platform's joints as a body about {c} not at all"
        yield KnownCombination(about, words)


def _move_base(parameters: ParameterSet, shift: Array, turn: Array) -> dict[str, float]:
    """Deviations (m, rad) of everything that is fixed to the base when the base moves by a shift and a small turn."""
    machine, g = parameters.machine, parameters.machine.nominal
    out: dict[str, float] = {}
    for i, name in enumerate(machine.strut_names):
        drive = int(machine.strut_drive[i])
        on_crank = drive != FIXED and machine.drive_kinds[drive] == "crank"
        moved = np.cross(turn, g.base_joint_m[i]) + (0.0 if on_crank else shift)
        out |= {f"base_joint.{name}.{c}": float(moved[k]) for k, c in enumerate(AXES)}
    for d, name in enumerate(machine.drive_names):
        if machine.drive_kinds[d] == "crank":
            moved = shift + np.cross(turn, g.pivot_m[d])
            out |= {f"pivot.{name}.{c}": float(moved[k]) for k, c in enumerate(AXES)}
        out |= _tilts(parameters, "axis_tilt", d, turn)
    for p, name in enumerate(machine.guide_names):
        moved = shift + np.cross(turn, g.guide_point_m[p])
        out[f"guide_position.{name}"] = float(g.guide_normal[p] @ moved)
        out |= _tilts(parameters, "guide_tilt", p, turn)
    if machine.planar:
        return {n: v for n, v in out.items() if not n.endswith(".z")}
    return out


def _tilts(parameters: ParameterSet, kind: str, part: int, turn: Array) -> dict[str, float]:
    """A small rotation as tilt parameters of a part, without the component about the part's own axis."""
    tilts: list[MachineParameter] = [p for p in parameters.parameters if p.kind == kind and p.part == part]
    return {p.name: float(np.array(p.about) @ turn) for p in tilts}
