"""Which cases a run consists of: slots by kind, effect and size, the same list for every run of one length."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np

from mock_devices.effects import CATALOGUE, OUTSIDE, OUTSIDE_FINAL, SPECS
from mock_devices.settings import DisturbanceLevels

FULL = {
    "effect": 888,
    "null": 1600,
    "pair": 150,
    "outside": 476,
    "removed": 120,
    "platform_only": 200,
    "next": 120,
    "misdeclared": 120,
}
DECOYS = 150  # cases of other kinds whose catalogue lacks a name that is not the true one
BATCH = 40

RAW_OF_EFFECT = (3.0, 5.0, 3.0, 5.0, 3.0, 1.0, 5.0, 3.0)
RAW_OF_OUTSIDE = (3.0, 3.0, 5.0, 3.0, 1.0)
RAW_TO_FIND = (3.0, 5.0)

# Of stated values the index of air alone is no effect of its own, but some variants of one: of three single cases of
# refraction two have these, so that a full run has 20 cases of it that are to be found, as of other stated values.
REFRACTION = "refraction"
INDEX_OF_AIR = tuple(v for v in SPECS[REFRACTION].variants if v.startswith("index_"))
OF_THREE, OTHER_TURN = 3, 2

SEVERAL = 4  # of single effects that have places, one in so many is at several of them

STYLES = ("rich", "platform", "poor")  # of the designs of null and outside cases
GROSS = 5  # one case in so many has gross readings, another is given some once its verdict is sure
SPOILED = ("effect", "null", "pair", "outside")

# What a rig declares over what it really has; None declares nothing.
RIGHT = "right"
DECLARED: dict[str, float | None] = {RIGHT: 1.0, "too small": 1.0 / 3.0, "too large": 3.0, "not": None}
MISDECLARED = tuple(name for name in DECLARED if name != RIGHT)

# What each rig really has, and declares unless its case says otherwise, one standard deviation each
# (docs/reference/recording.md).
PROFILES: dict[str, DisturbanceLevels] = {
    "small": DisturbanceLevels(drift_m=2e-6, reseat_m=1e-6, reversal_m=5e-7, temperature_k=0.01),
    "drifting": DisturbanceLevels(drift_m=1.5e-5, reseat_m=1e-6, reversal_m=5e-7, temperature_k=0.02),
    "reseating": DisturbanceLevels(drift_m=3e-6, reseat_m=6e-6, reversal_m=5e-7, temperature_k=0.02),
    "reversing": DisturbanceLevels(drift_m=3e-6, reseat_m=1e-6, reversal_m=4e-6, temperature_k=0.02),
    "warm": DisturbanceLevels(drift_m=5e-6, reseat_m=2e-6, reversal_m=1e-6, temperature_k=0.15),
}


@dataclass(frozen=True)
class Slot:
    """A case to be made. effects: names, empty for null; raw: their sizes in sigma; profile: '' draws one.

    style: of its design, '' as its kind wants; declared: a name of DECLARED; gross: whether some readings are gross;
    spoiled: whether a sure verdict is asked for again with gross readings; variants: those from which that of an effect
    is drawn, all if empty; several: whether that is at more than one place.
    """

    key: str
    kind: str
    effects: tuple[str, ...] = ()
    raw: tuple[float, ...] = ()
    profile: str = ""
    decoy: bool = False
    style: str = ""
    declared: str = RIGHT
    gross: bool = False
    spoiled: bool = False
    variants: tuple[str, ...] = ()
    several: bool = False


def counts(n: int) -> dict[str, int]:
    """Cases by kind of a run of about n cases; n = 0 is the full run."""
    full = sum(FULL.values())
    share = n / full if n else 1.0
    return {kind: max(1, round(count * share)) for kind, count in FULL.items()}


def plan(n: int = 0, kinds: Collection[str] = (), *, final: bool = False) -> list[Slot]:
    """All slots of a run; `kinds` keeps some kinds only. A final run has further effects outside the catalogue."""
    outside = (*OUTSIDE, *OUTSIDE_FINAL) if final else OUTSIDE
    slots: list[Slot] = []
    for kind, count in counts(n).items():
        if not kinds or kind in kinds:
            slots += [_slot(kind, i, outside) for i in range(count)]
    slots = [_with_gross(slot) for slot in slots]
    share = len(slots) / sum(FULL.values())
    return _with_decoys(slots, round(DECOYS * share))


def _with_gross(slot: Slot) -> Slot:
    turn = crc32(slot.key.encode()) % GROSS
    return replace(slot, gross=turn == 0, spoiled=turn == 1 and slot.kind in SPOILED)


def drawn_order(slots: list[Slot], rng: np.random.Generator) -> list[Slot]:
    """The slots in a random order: a batch's place tells nothing of its cases."""
    return [slots[int(k)] for k in rng.permutation(len(slots))]


def _slot(kind: str, i: int, outside: tuple[str, ...]) -> Slot:
    key = f"{kind}-{i}"
    names, turn = CATALOGUE, i // len(CATALOGUE)
    name = names[i % len(names)]
    if kind == "null":  # 4 declarations, 5 profiles and 3 styles: all combinations, as no two share a factor
        profile, style = list(PROFILES)[i % len(PROFILES)], STYLES[i % len(STYLES)]
        return Slot(key, kind, profile=profile, style=style, declared=list(DECLARED)[i % len(DECLARED)])
    if kind == "misdeclared":
        return Slot(key, kind, (name,), (max(RAW_TO_FIND),), declared=MISDECLARED[i % len(MISDECLARED)])
    if kind == "pair":
        step = 1 + turn % (len(names) - 1)  # every effect with another partner each time round
        other = names[(i + step * 7) % len(names)]
        if other == name:
            other = names[(i + 1) % len(names)]
        sizes = (RAW_TO_FIND[i % 2], RAW_TO_FIND[turn % 2])
        return Slot(key, kind, (name, other), sizes)
    if kind == "outside":
        turn, style = i // len(outside), STYLES[(i + i // len(outside)) % len(STYLES)]
        raw = RAW_OF_OUTSIDE[turn % len(RAW_OF_OUTSIDE)]
        return Slot(key, kind, (outside[i % len(outside)],), (raw,), style=style)
    if kind == "effect":
        raw = RAW_OF_EFFECT[turn % len(RAW_OF_EFFECT)]
        several = turn % SEVERAL == SEVERAL - 1 and SPECS[name].place != "rig"
        return Slot(key, kind, (name,), (raw,), variants=_variants(name, turn), several=several)
    return Slot(key, kind, (name,), (RAW_TO_FIND[(turn + i) % 2],))


def _variants(name: str, turn: int) -> tuple[str, ...]:
    """Those from which a case of one effect is drawn, the effects being gone through for the `turn`-th time."""
    if name != REFRACTION:
        return ()
    index = turn % OF_THREE != OTHER_TURN
    return INDEX_OF_AIR if index else tuple(v for v in SPECS[name].variants if v not in INDEX_OF_AIR)


def _with_decoys(slots: list[Slot], count: int) -> list[Slot]:
    """Spread decoys evenly over effect and null cases."""
    able = [k for k, slot in enumerate(slots) if slot.kind in ("effect", "null")]
    if not able or not count:
        return slots
    chosen = {able[int(k)] for k in np.linspace(0, len(able) - 1, min(count, len(able)))}
    return [replace(slot, decoy=True) if k in chosen else slot for k, slot in enumerate(slots)]
