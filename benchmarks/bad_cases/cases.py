"""What may be wrong with a campaign, drawn by seed: the kinds of mistakes, and good campaigns beside them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

GOOD = "good"
KINDS = ("swapped reflectors", "wrong payload", "wrong machine file", "sign of one drive")
PAIRS = (("P1", "P2"), ("P1", "P3"), ("P2", "P3"), ("SL", "SR"))
PAYLOADS_KG = {0: 0.0, 1: 200.0, 2: 400.0}


@dataclass(frozen=True)
class Case:
    """One campaign. `what` says in words what is wrong with it.

    swapped: two reflectors whose readings carry each other's name, from `swapped_from` (share of the visits) on.
    truly_kg, truly_com_m: what is on where the PLC reports payload n. file_changes: lines of the machine file that the
    calibration reads, old to new. turned: a drive that moves the other way. turned_table: one whose table acts with the
    other sign. Not guarded: the station says nothing of a reflector that is far from where it is predicted.
    """

    kind: str
    number: int
    what: str = ""
    swapped: tuple[str, str] | None = None
    swapped_from: float = 0.0
    truly_kg: Mapping[int, float] = field(default_factory=dict)
    truly_com_m: tuple[float, float, float] | None = None
    file_changes: tuple[tuple[str, str], ...] = ()
    turned: int | None = None
    turned_table: int | None = None
    guarded: bool = True

    @property
    def seed(self) -> int:
        """Seed of the machine and of the noise."""
        return 1000 + self.number


def draw(kind: str, number: int) -> Case:
    """Case `number` of a kind: machine, noise and mistake follow from both."""
    if kind == GOOD:
        return Case(GOOD, number, "nothing is wrong")
    rng = np.random.default_rng([15, KINDS.index(kind), number])
    return _DRAWS[kind](number, rng)


def _swapped(number: int, rng: np.random.Generator) -> Case:
    pair = PAIRS[int(rng.integers(len(PAIRS)))]
    begin = float(rng.choice([0.0, 0.0, 0.35, 0.6, 0.8]))
    when = "from the beginning" if begin == 0.0 else f"from {begin:.0%} of the visits on"
    guarded = bool(rng.uniform() < 0.5)
    what = f"{pair[0]} and {pair[1]} exchanged {when}" + ("" if guarded else ", recorded without the station's guard")
    return Case(KINDS[0], number, what, swapped=pair, swapped_from=begin, guarded=guarded)


def _payload(number: int, rng: np.random.Generator) -> Case:
    form = int(rng.integers(4))
    if form == 0:
        truly = {1: PAYLOADS_KG[2], 2: PAYLOADS_KG[1]}
        return Case(KINDS[1], number, "200 kg and 400 kg exchanged", truly_kg=truly)
    if form == 1:
        return Case(KINDS[1], number, "nothing is on in place of 400 kg", truly_kg={2: 0.0})
    if form == 2:
        factor = float(rng.choice([0.5, 0.75, 1.25, 1.5]))
        truly = {n: factor * kg for n, kg in PAYLOADS_KG.items()}
        return Case(KINDS[1], number, f"all payloads are {factor:g} times what the rig file says", truly_kg=truly)
    com = (float(rng.uniform(-0.15, 0.15)), float(rng.uniform(-0.5, 0.1)), 0.0)
    return Case(KINDS[1], number, f"centre of mass at {com[0]:.2f}, {com[1]:.2f} m", truly_com_m=com)


_LINES = {
    "length of all struts": ("length_m = 1.5", 1.5, "length_m = {}"),
    "slider of the left upper strut": ("base_joint_m = [-1.2, 0.125, 0.0]", -1.2, "base_joint_m = [{}, 0.125, 0.0]"),
    "platform joint, right lower": (
        "platform_joint_m = [0.2, -0.125, 0.0]",
        0.2,
        "platform_joint_m = [{}, -0.125, 0.0]",
    ),
    "nest of P3": ("position_m = [0.0, 0.20, 0.10]", 0.20, "position_m = [0.0, {}, 0.10]"),
    "tool point": ("tool_point_m = [0.0, 0.0, 0.0]", 0.0, "tool_point_m = [{}, 0.0, 0.0]"),
}


def _file(number: int, rng: np.random.Generator) -> Case:
    if rng.uniform() < 0.25:
        factor = float(rng.choice([0.1, 0.3, 3.0, 10.0]))
        changes = (("stiffness_n_per_m = 1.0e8", f"stiffness_n_per_m = {1e8 * factor!r}"),)
        return Case(KINDS[2], number, f"stiffness {factor:g} times the true one", file_changes=changes)
    name = list(_LINES)[int(rng.integers(len(_LINES)))]
    line, value, form = _LINES[name]
    off_m = float(rng.choice([-1.0, 1.0]) * np.exp(rng.uniform(np.log(0.5e-3), np.log(20e-3))))
    changes = ((line, form.format(repr(round(value + off_m, 6)))),)
    return Case(KINDS[2], number, f"{name}: {off_m * 1e3:+.1f} mm", file_changes=changes)


def _sign(number: int, rng: np.random.Generator) -> Case:
    drive, name = int(rng.integers(2)), "sign of one drive"
    word = ("left", "right")[drive]
    if rng.uniform() < 0.2:
        return Case(name, number, f"{word} moves the other way", turned=drive, guarded=bool(rng.uniform() < 0.5))
    return Case(name, number, f"the table of {word} acts with the other sign", turned_table=drive)


_DRAWS = dict(zip(KINDS, (_swapped, _payload, _file, _sign), strict=True))
