"""How the rivals' limits were set: on years of development, each to the false-alarm rate of the project's own rules.

`python -m benchmarks.year_study.rival_limits` prints that rate and those of the limits that it is given.
"""

from __future__ import annotations

import argparse
import sys

from benchmarks.year_study.policies import run_year
from benchmarks.year_study.tasks import DEVELOPMENT, decider
from benchmarks.year_study.truths import WEEKS, draw_year
from benchmarks.year_study.workshop import workshop


def main() -> int:
    """The command: NAME=LIMIT, any number of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("limits", nargs="*", metavar="NAME=LIMIT")
    parser.add_argument("--years", type=int, default=30)
    options = parser.parse_args()
    shop = workshop()
    for text in ("ours", *options.limits):
        name, _, limit = text.partition("=")
        rows = []
        for seed in range(DEVELOPMENT + 40_000, DEVELOPMENT + 40_000 + options.years):
            make = None if name == "ours" else decider(name, seed, float(limit))
            rows.append(run_year(shop, draw_year(shop, seed), make, 0))
        quiet = sum(r["quiet_weeks"] for r in rows) / WEEKS
        alarms = sum(r["false_alarms"] for r in rows)
        print(f"{text}: {alarms / quiet:.2f} false alarms a quiet year ({alarms} in {quiet:.1f})", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
