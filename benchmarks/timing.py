"""Times of competitors side by side on a machine that has other things to do: rounds in turn, medians, spreads.

Times are processor time of this process, one thread: on an idle machine the same as by the clock, on a busy one not
lengthened by waiting for a turn.
"""

from __future__ import annotations

import importlib
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import ModuleType

import numpy as np

THREADS = tuple(f"{library}_NUM_THREADS" for library in ("OPENBLAS", "OMP", "MKL", "VECLIB_MAXIMUM"))


def in_one_thread() -> None:
    """Begin this program again with one thread for linear algebra, unless it has been: libraries ask when they load."""
    if any(os.environ.get(name) != "1" for name in THREADS):
        os.environ.update(dict.fromkeys(THREADS, "1"))
        os.execv(sys.executable, sys.orig_argv)


@dataclass(frozen=True)
class Times:
    """Processor seconds of every round."""

    rounds: tuple[float, ...]

    @property
    def median(self) -> float:
        """Median of the rounds."""
        return float(np.median(self.rounds))

    def over(self, other: Times) -> Ratio:
        """How many times longer than the other, round by round."""
        return Ratio(tuple(a / b for a, b in zip(self.rounds, other.rounds, strict=True)))


@dataclass(frozen=True)
class Ratio:
    """Ratios of two competitors' times, one a round."""

    rounds: tuple[float, ...]

    @property
    def median(self) -> float:
        """Median of the rounds."""
        return float(np.median(self.rounds))

    def __str__(self) -> str:
        return f"{self.median:,.0f} ({min(self.rounds):,.0f} to {max(self.rounds):,.0f})"


@dataclass(frozen=True)
class Goal:
    """A figure that is asked for, and whether it is reached."""

    what: str
    required: str
    measured: str
    met: bool


def in_turn(tasks: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, Times]:
    """Time each task once a round, one after the other, so that all see the same disturbances."""
    seconds: dict[str, list[float]] = {name: [] for name in tasks}
    for _ in range(rounds):
        for name, task in tasks.items():
            began = time.process_time()
            task()
            seconds[name].append(time.process_time() - began)
    return {name: Times(tuple(s)) for name, s in seconds.items()}


def optional(name: str, absent: list[str]) -> ModuleType | None:
    """A peer's module; what is not installed is noted in `absent` and left out."""
    try:
        return importlib.import_module(name)
    except ImportError as missing:
        absent.append(f"{name} ({missing})")
        return None


def exponent(sizes: Sequence[int], values: Sequence[float]) -> float:
    """Slope of log value against log size: 1 where the value grows in proportion."""
    return float(np.polyfit(np.log(sizes), np.log(values), 1)[0])


def print_table(title: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A table in Markdown, columns aligned."""
    widths = [max(len(line[c]) for line in (head, *rows)) for c in range(len(head))]
    print(f"\n### {title}\n")
    for line in (head, ["-" * w for w in widths], *rows):
        print("| " + " | ".join(text.ljust(w) for text, w in zip(line, widths, strict=True)) + " |")
    print(flush=True)


def print_goals(goals: Sequence[Goal], absent: Sequence[str]) -> int:
    """The goals; exit status 1 if one is missed."""
    rows = [[g.what, g.required, g.measured, "met" if g.met else "MISSED"] for g in goals]
    print_table("Goals", ["what", "wanted", "found", ""], rows)
    for name in absent:
        print(f"not compared: {name}")
    return 0 if all(g.met for g in goals) else 1
