"""The 200 cases: what each of them is to have, by its number and nothing else."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from benchmarks.emergent.campaign import STYLES
from benchmarks.emergent.disturbances import PROFILES

SEED = 20261123
SINGLE, PAIR, NULL, OUTSIDE = "single", "pair", "null", "outside"
SINGLES = (
    ("play", 20), ("windup", 20), ("stick_slip", 20), ("settling", 20), ("clearance", 20), ("soft_strut", 10),
    ("soft_column", 10),
)  # fmt: skip
PAIRS = (
    ("play", "settling"), ("play", "soft_column"), ("play", "clearance"), ("windup", "settling"), ("windup", "play"),
    ("windup", "clearance"), ("stick_slip", "soft_column"), ("stick_slip", "clearance"), ("settling", "soft_column"),
    ("settling", "stick_slip"),
)  # fmt: skip
EACH_PAIR, NULLS, EACH_OUTSIDE = 3, 30, 5
OUTSIDERS = ("tooth", "cable_drag", "loose_clamp", "limit_cycle")
BY_DWELL = ("settling", "limit_cycle")
BY_LOAD = (
    "windup", "stick_slip", "clearance", "soft_strut", "soft_column", "loose_clamp", "cable_drag",
)  # fmt: skip


@dataclass(frozen=True)
class Plan:
    """A case before it is made. name: its recording's; causes: what is wrong; style: of the campaign."""

    name: str
    seed: tuple[int, int]
    kind: str
    causes: tuple[str, ...]
    style: str
    profile: str


def plan(seed: int = SEED) -> list[Plan]:
    """All cases, the kinds mixed so that a part of them is a fair sample.

    Their names have even numbers: the check that scores them shows odd ones in final runs only.
    """
    kinds: list[tuple[str, tuple[str, ...]]] = [(SINGLE, (cause,)) for cause, count in SINGLES for _ in range(count)]
    kinds += [(PAIR, pair) for pair in PAIRS for _ in range(EACH_PAIR)]
    kinds += [(NULL, ())] * NULLS
    kinds += [(OUTSIDE, (cause,)) for cause in OUTSIDERS for _ in range(EACH_OUTSIDE)]
    rng = np.random.default_rng([seed, 0])
    out = []
    for number, k in enumerate(_mixed(kinds)):
        kind, causes = kinds[k]
        style = STYLES[0]
        if rng.uniform() < 0.3 and not {*BY_DWELL, *BY_LOAD} & {*causes}:
            style = str(rng.choice(STYLES[1:] if kind == NULL else STYLES[1:2]))
        profile = str(rng.choice(list(PROFILES)))
        out.append(Plan(f"rec{2 * number + 2:03d}", (seed, number + 1), kind, causes, style, profile))
    return out


def _mixed(kinds: list[tuple[str, tuple[str, ...]]]) -> list[int]:
    """An order in which each kind of case comes at even distances."""
    count, seen = Counter(kinds), Counter[tuple[str, tuple[str, ...]]]()
    at = []
    for k, kind in enumerate(kinds):
        at.append(((seen[kind] + 0.5) / count[kind], k))
        seen[kind] += 1
    return [k for _, k in sorted(at)]
