"""What the recordings of the archives are to be: effects, forms and machines, each by a seed of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.other_simulator.forms.catalogue import (
    EFFECTS,
    EIGHTH,
    FIFTH,
    FIRST,
    FOURTH,
    NINTH,
    OUTSIDE,
    SECOND,
    SEVENTH,
    SIXTH,
    SPACE,
    TENTH,
    THIRD,
    names_of_forms,
)
from benchmarks.other_simulator.nominal import DELTA, PLANAR, STEWART

SEEDS = {
    FIRST: 1101, SECOND: 2202, SPACE: 3303, THIRD: 4404, FOURTH: 5505, FIFTH: 6606, SIXTH: 7707, SEVENTH: 8808,
    EIGHTH: 9909, NINTH: 10910, TENTH: 11011,
}  # fmt: skip
NUMBERED_FROM = {
    FIRST: 0, SECOND: 300, SPACE: 600, THIRD: 900, FOURTH: 1200, FIFTH: 1500, SIXTH: 1800, SEVENTH: 2100, EIGHTH: 2400,
    NINTH: 2700, TENTH: 3000,
}  # fmt: skip
SINGLE, PAIR, NULL = "single", "pair", "null"
EACH, PAIRS, NULLS, SPATIAL_NULLS, SPATIAL_MORE = 3, 14, 24, 14, 16
# Effects of carriages, which legs have not.
OF_CARRIAGES = (
    "column_thermal_growth", "column_compliance", "guide_straightness", "guide_angular", "foundation_settling",
)  # fmt: skip
SPATIAL_OUTSIDE = (
    "crane_tilts_machine", "neighbour_vibrates", "eccentric_reflectors", "cyclic_error_of_ranges", "joints_run_out",
    "miscounts_by_interference",
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """A recording to be made.

    kind: SINGLE, PAIR, NULL or OUTSIDE; effects: names and their forms; base: the machine file that it is drawn around.
    """

    name: str
    archive: str
    kind: str
    effects: tuple[tuple[str, str], ...]
    base: str
    seed: int


Wanted = tuple[str, list[tuple[str, str]], str]  # kind, effects with forms, base


def cases_of(archive: str) -> list[Case]:
    """The cases of an archive, mixed; all have even numbers."""
    rng = np.random.default_rng(SEEDS[archive])
    wanted = _spatial(rng) if archive == SPACE else _planar(archive, rng)
    out = []
    for number, k in enumerate(rng.permutation(len(wanted)), 1):
        kind, effects, base = wanted[k]
        name = f"rec{NUMBERED_FROM[archive] + 2 * number:03d}"
        out.append(Case(name, archive, kind, tuple(effects), base, int(rng.integers(1 << 40))))
    return out


def _planar(archive: str, rng: np.random.Generator) -> list[Wanted]:
    out: list[Wanted] = []
    for effect in EFFECTS:
        forms = names_of_forms(effect, archive)
        out += [(SINGLE, [(effect, forms[k % len(forms)])], PLANAR) for k in range(EACH)]
    for _ in range(PAIRS):
        two = [str(effect) for effect in rng.choice(EFFECTS, 2, replace=False)]
        out.append((PAIR, [(effect, str(rng.choice(names_of_forms(effect, archive)))) for effect in two], PLANAR))
    out += [(NULL, [], PLANAR)] * NULLS
    out += [(OUTSIDE, [(OUTSIDE, form)], PLANAR) for form in names_of_forms(OUTSIDE, archive)]
    return out


def _spatial(rng: np.random.Generator) -> list[Wanted]:
    out: list[Wanted] = []
    more = [effect for effect in EFFECTS if effect not in OF_CARRIAGES][:SPATIAL_MORE]
    for k, effect in enumerate([*EFFECTS, *more]):
        base = DELTA if effect in OF_CARRIAGES or k % 2 else STEWART
        out.append((SINGLE, [(effect, str(rng.choice(names_of_forms(effect, SPACE))))], base))
    out += [(NULL, [], STEWART if k % 2 else DELTA) for k in range(SPATIAL_NULLS)]
    out += [(OUTSIDE, [(OUTSIDE, form)], (DELTA, STEWART)[rng.integers(2)]) for form in SPATIAL_OUTSIDE]
    return out
