"""How long one diagnosis takes on its core, of campaigns of 500 visits (docs/explanation/benchmarks.md).

    python -m benchmarks.diagnosis_time [--n N] [--seed S]

N cases of the mock in the proportions of the check on withheld data (24), each on a campaign of its own of 500 visits
of which every one reads the platform's three reflectors: 1,500 readings, more where the effect needs others to be seen.
Processor time of one thread, reading of files not included. A table with the goals goes to standard output, every case
to standard error; exit status 1 if a goal is missed. It takes minutes, keeps nothing, and begins anew when stopped.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from benchmarks.scoring.goals import times
from benchmarks.scoring.lines import measure_lines
from benchmarks.timing import in_one_thread
from benchmarks.withheld.cases import plan
from benchmarks.withheld.designs import OPTIONS, Designs
from benchmarks.withheld.making import make_case
from calibration.diagnosis.diagnose import diagnose
from calibration.recording.folder import read_folder
from mock_devices.recordings.files import write_recording

VISITS = 500
KINDS = ("effect", "null", "pair", "outside")
STYLE = "platform"


def main(arguments: list[str] | None = None) -> int:
    """Time the cases, then print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=24, help="cases")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    if options.n < 1:
        parser.error(f"--n is {options.n}; give the number of cases, 1 or more")
    if options.seed < 0:
        parser.error(f"--seed is {options.seed}; give 0 or more")
    measures = times([seconds_of(number, options.seed) for number in range(options.n)])
    print("\n".join(measure_lines([asdict(measure) for measure in measures])))
    return 0 if all(measure.ok is not False for measure in measures) else 1


def seconds_of(number: int, seed: int) -> float:
    """Processor seconds of the diagnosis of one case."""
    slots = plan(0, KINDS)
    rng = np.random.default_rng([seed, number])
    slot = replace(slots[int(rng.integers(len(slots)))], style=STYLE)
    long = {style: replace(of_style, visits=VISITS, poses=VISITS) for style, of_style in OPTIONS.items()}
    case = make_case(slot, rng, Designs(int(rng.integers(2**31)), dict.fromkeys(long, 1), long), final=False)
    with tempfile.TemporaryDirectory() as folder:
        write_recording(case.recording, Path(folder) / "recording")
        recording = read_folder(Path(folder) / "recording")
    begun = time.process_time()
    found = diagnose(recording)
    seconds = time.process_time() - begun
    true = " and ".join(fact["effect"] for fact in case.truth["effects"]) or "none"
    print(f"{number + 1}: {len(recording)} readings, {true}: {found.verdict}, {seconds:.1f} s", file=sys.stderr)
    return seconds


if __name__ == "__main__":
    in_one_thread()
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
