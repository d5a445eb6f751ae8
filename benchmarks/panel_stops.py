"""Whether a page that is open makes stops slower: pairs of blocks of stops, without a page and with one, in turns.

One mock rig in a process of its own, at work all the while (`benchmarks.stop_latency`); the page is opened and closed
between blocks, which of a pair comes first changes from pair to pair.

The time from an interlock's bit to the last stop frame is mostly that until the bit is polled, and where between two
polls it falls is chance. What is compared is therefore its expectation: the wait from the intervals between all polls
in motion, sum T^2 / (2 sum T), and the median of the rest. Of one drive's fault to the other's stop it is the median.
Shown is the ratio with its 95 % interval, pairs resampled whole, so that what a busy computer does for seconds counts
once. It is decided when the interval lies on one side of the goal.

`python -m benchmarks.panel_stops [--pairs N] [--out FILE]` adds pairs until there are N; stopped, it goes on. Exit
status 1 where stops are shown to be slower than the goal or it is not decided, 2 without Chromium.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import stop_latency
from benchmarks.panel_browser import HEAD, Panel, chromium, print_table
from benchmarks.results_file import ResultsFile, code_digest
from pkm_rig.rig.rig import Rig
from tests.kept_results import until_stopped

GOAL = 1.10  # times as long
TRIPS, FAULTS = 16, 48  # stops of each kind in a block
DRAWS = 1000

Block = dict[str, list[float]]  # times in ms: "between_polls", "rest" from poll to last stop frame, "fault"
Pair = dict[str, Block]  # "without" and "with" a page


def interlock_ms(blocks: Sequence[Block]) -> float:
    """Expected time from an interlock's bit to the last stop frame."""
    between, rest = (np.concatenate([block[name] for block in blocks]) for name in ("between_polls", "rest"))
    return float(np.sum(between**2) / (2.0 * np.sum(between)) + np.median(rest))


def fault_ms(blocks: Sequence[Block]) -> float:
    """Median time from one drive's fault to the other's stop frame."""
    return float(np.median(np.concatenate([block["fault"] for block in blocks])))


KINDS: dict[str, tuple[Callable[[Sequence[Block]], float], str]] = {
    "interlock's bit to last stop frame, expected": (interlock_ms, "rest"),
    "one drive's fault to the other's stop, median": (fault_ms, "fault"),
}  # and of what the stops are counted


@dataclass(frozen=True)
class Ratio:
    """Times in ms without and with a page, their ratio's 95 % interval, and the number of stops with one."""

    without_ms: float
    with_ms: float
    low: float
    high: float
    count: int

    @property
    def verdict(self) -> str:
        """Whether the goal is met, missed, or not decided by so many pairs."""
        return "ok" if self.high <= GOAL else "missed" if self.low > GOAL else "not decided"


def ratio_of(pairs: Sequence[Pair], kind: str, seed: int = 1, draws: int = DRAWS) -> Ratio:
    """The ratio over all pairs, whole pairs resampled for its interval."""
    time_ms, counted = KINDS[kind]
    without, beside = ([pair[when] for pair in pairs] for when in ("without", "with"))
    draw = np.random.default_rng(seed)
    drawn = []
    for _ in range(draws):
        chosen = draw.integers(0, len(pairs), len(pairs))
        drawn.append(time_ms([beside[n] for n in chosen]) / time_ms([without[n] for n in chosen]))
    low, high = np.percentile(drawn, (2.5, 97.5))
    count = sum(len(block[counted]) for block in beside)
    return Ratio(time_ms(without), time_ms(beside), float(low), float(high), count)


def block_of(rows: Sequence[dict[str, Any]]) -> Block:
    """A block from what `benchmarks.stop_latency` says of its stops; one that found the drives at rest says nothing."""
    return {
        "between_polls": [ms for row in rows for ms in row.get("between_polls_ms", ())],
        "rest": [row["total_ms"] - row["polling_ms"] for row in rows if "total_ms" in row],
        "fault": [row["fault_ms"] for row in rows if "fault_ms" in row],
    }


def pairs_of(shown: Callable[[Rig], AbstractContextManager[None]], seed: int) -> Generator[Pair, None, None]:
    """Pair after pair on one rig at work, without end; `shown`: a page shows it."""
    with tempfile.TemporaryDirectory() as folder:
        path = stop_latency.rig_file(Path(folder))
        with stop_latency.at_work(path, seed) as (rig, strike):
            for _ in range(2):
                strike("trip")  # what is slow the first time
            number = 0
            while True:
                pair: Pair = {}
                order = ("without", "with") if number % 2 == 0 else ("with", "without")
                for when in order:
                    stop_latency.start_again(rig)  # supervised while a page is opened, which takes seconds
                    with shown(rig) if when == "with" else nullcontext():
                        pair[when] = block_of(
                            [strike("trip") for _ in range(TRIPS)] + [strike("fault") for _ in range(FAULTS)]
                        )
                        stop_latency.start_again(rig)  # and closed
                yield pair
                number += 1


def lines_of(pairs: Sequence[Pair]) -> tuple[list[tuple[str, str, str, str, str, str]], bool]:
    """Rows of a table, and whether every goal is met."""
    rows, good = [], True
    for kind in KINDS:
        found = ratio_of(pairs, kind)
        good = good and found.verdict == "ok"
        added = f"{found.with_ms / found.without_ms:.2f} times, 95 % {found.low:.2f} to {found.high:.2f}"
        rows.append((
            f"{kind} ({found.count} stops)", f"{found.without_ms:.2f} ms", f"{found.with_ms:.2f} ms", added,
            f"{GOAL:.2f} times", found.verdict,
        ))  # fmt: skip
    return rows, good


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=20, help="of blocks of 16 trips and 48 faults; a minute each")
    parser.add_argument("--out", type=Path, default=Path("runs/panel-stops.jsonl"))
    options = parser.parse_args()
    if chromium() is None:
        print("there is no Chromium on this computer", file=sys.stderr)
        return 2
    settings = {"trips": TRIPS, "faults": FAULTS, "code": code_digest("benchmarks/panel_stops.py", "pkm_rig/panel")}
    results = ResultsFile(options.out, settings)
    pairs: list[Pair] = [row["pair"] for row in results.rows()]
    if len(pairs) < options.pairs:
        with Panel() as panel, closing(pairs_of(panel.shown, seed=len(pairs) + 1)) as measured:
            for pair in measured:
                results.append({"pair": pair})
                pairs.append(pair)
                print(f"{len(pairs)} of {options.pairs} pairs", file=sys.stderr)
                if len(pairs) >= options.pairs:
                    break
    rows, good = lines_of(pairs)
    print_table(HEAD, rows)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(until_stopped(main))
