"""Tables for people."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from benchmarks.scoring.measure import status

PLAIN = (" in s ", "class size", "error", "log score")  # measures that are no proportions


def measure_lines(measures_data: Sequence[dict[str, Any]]) -> list[str]:
    """The measures as a table."""
    lines = [f"{'measure':58} {'goal':>18} {'reached':>8} {'95 % interval':>18} {'cases':>6}"]
    for m in measures_data:
        plain = any(word in m["name"] for word in PLAIN)
        value = "-" if m["value"] is None else number(m["value"], plain)
        interval = "-" if m["value"] is None else f"{number(m['low'], plain)} to {number(m['high'], plain)}"
        lines.append(f"{m['name']:58} {m['goal']:>18} {value:>8} {interval:>18} {m['n']:>6}  {status(m)}".rstrip())
    return lines


def effect_lines(effects: Sequence[dict[str, Any]]) -> list[str]:
    """Hits of each visible effect as a table."""
    return [
        f"{'effect':26} {'right':>9}   taken for",
        *(
            f"{e['effect']:26} {e['right']:>3} of {e['cases']:<3}   "
            f"{e['taken_for']} {', '.join(e['variants_missed'])}".rstrip()
            for e in effects
        ),
    ]


def number(value: float, plain: bool) -> str:
    """A proportion in per cent, anything else as it is."""
    return f"{value:.3g}" if plain else f"{100.0 * value:.1f} %"
