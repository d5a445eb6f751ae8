"""Runs one command of `pkm-rig` at another time: `python -m benchmarks.watch_events.host SECONDS ARGUMENTS ...`.

SECONDS are added to the computer's clock, as this process sees it, so that a week need not be waited for.
"""

from __future__ import annotations

import sys
import time


def main() -> None:
    """Shift the clock, then run the command as it was typed."""
    shift_s, clock = float(sys.argv[1]), time.time
    time.time = lambda: clock() + shift_s
    sys.argv = ["pkm-rig", *sys.argv[2:]]
    from pkm_rig.cli import main as run  # noqa: PLC0415  # defaults take the clock when they are loaded

    run()


if __name__ == "__main__":
    main()
