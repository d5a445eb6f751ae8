"""What is killed when: a seeded plan of campaigns, each struck several times.

One campaign with five strikes in place of five campaigns: what was measured before each kill has to outlive all that
come after it, and the time goes into kills, not into measuring the same again.
"""

from __future__ import annotations

import random
from dataclasses import dataclass
from typing import Literal

Victim = Literal["host", "mock", "drive"]
Window = Literal["measuring", "tables", "recovery"]
KINDS = ("commit", "can", "commit", "sdo")
RECOVERY_OPERATIONS = 60  # of a resumed command, in which it reconnects and puts right what it finds


@dataclass(frozen=True)
class Strike:
    """One kill. `share` says where in its window, from 0 to 1; for the mock and the drive of the readings left."""

    victim: Victim
    window: Window
    kind: str
    share: float


@dataclass(frozen=True)
class Chain:
    """One campaign and what strikes it; recovery strikes come on top of the strike before."""

    name: str
    strikes: tuple[Strike, ...]


PATTERNS: dict[Victim, tuple[tuple[Window, ...], ...]] = {
    "host": (
        ("measuring", "measuring", "tables", "recovery", "tables", "tables"),
        ("measuring", "measuring", "measuring", "tables", "tables"),
    ),
    "mock": (("measuring", "measuring", "tables", "tables", "tables"),),
    "drive": (("measuring", "measuring", "tables", "tables", "tables"),),
}
CHAINS: dict[Victim, int] = {"host": 40, "mock": 10, "drive": 10}  # 200 kills and 20 in recovery, 50, 50


def plan(seed: int) -> list[Chain]:
    """All chains, the victims by turns, so that a sweep that is cut short has met all of them."""
    chains: list[Chain] = []
    for victim, count in CHAINS.items():
        for number in range(count):
            rng = random.Random(f"{seed} {victim} {number}")
            windows = PATTERNS[victim][number % len(PATTERNS[victim])]
            strikes = tuple(
                Strike(victim, window, KINDS[rng.randrange(len(KINDS))], rng.random()) for window in windows
            )
            chains.append(Chain(f"{victim}-{number:02d}", strikes))
    order = random.Random(seed)
    order.shuffle(chains)
    return chains
