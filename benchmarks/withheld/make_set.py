"""A development set: recordings with their truth beside them, for tuning. Never of a final run: its variants stay out.

    python -m benchmarks.withheld.make_set --seed 1 --n 200 --out DIR [--kinds effect,null]

DIR/NAME/ are recording folders, NAME.npz beside them holds `noise_free_m` (r, 3) of every row in the station's frame,
`rows` of the platform's reflectors and `turn` into the machine's axes; truth.json says of each NAME what it is,
and under `mimics_sigma` how near other effects come (`mimics`).
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np

from benchmarks.withheld.cases import FULL, drawn_order, plan
from benchmarks.withheld.designs import Designs
from benchmarks.withheld.making import make_case
from benchmarks.withheld.mimics import MimicLibraries
from benchmarks.withheld.sizes import platform_rows
from mock_devices.recordings.files import write_recording


def main() -> int:
    """Make the set."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--n", type=int, default=200)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--kinds", default="", help=f"some of {', '.join(FULL)}, separated by commas")
    parser.add_argument("--effects", default="", help="cases of these effects only, separated by commas")
    options = parser.parse_args()
    kinds = [kind for kind in options.kinds.split(",") if kind]
    if unknown := sorted(set(kinds) - set(FULL)):
        parser.error(f"no kind of case is called {', '.join(unknown)}; there are {', '.join(FULL)}")
    if options.n < 1 or options.seed < 0:
        parser.error("--n must be positive, --seed not negative")
    total = sum(FULL.values())
    wanted = round(options.n * total / sum(FULL[k] for k in kinds)) if kinds else options.n
    rng = np.random.default_rng(options.seed)
    slots = drawn_order(plan(wanted, kinds, final=False), rng)
    if options.effects:
        names = set(options.effects.split(","))
        slots = [slot for slot in slots if names & set(slot.effects)]
        if not slots:
            parser.error(f"no case of {options.effects} among {options.n}; give other names or a larger --n")
    designs = Designs(options.seed)
    libraries = MimicLibraries()
    truth, began = {}, time.monotonic()
    for number, slot in enumerate(slots):
        case = make_case(slot, np.random.default_rng([options.seed, number]), designs, final=False)
        name = f"c{number:04d}"
        write_recording(case.recording, options.out / name)
        np.savez(
            options.out / f"{name}.npz",
            noise_free_m=case.noise_free_m,
            change_m=case.change_m,
            rows=platform_rows(case.bench),
            turn=case.bench.view.rotation,
        )
        truth[name] = libraries.to_json(case)
        if number % 20 == 19:
            print(f"{number + 1} of {len(slots)}, {time.monotonic() - began:.0f} s", file=sys.stderr)
    (options.out / "truth.json").write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
