"""Signatures of effects, the first that lowers BIC most (`benchmarks/withheld/baselines.py`); sure of it, as BIC is.

python -m benchmarks.gapbench.programs.greedy_bic FOLDER
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from benchmarks.withheld.baselines import simple_answers
from calibration.recording.folder import read_folder


def main(folder: str) -> int:
    """Print the answer to a recording."""
    verdict = simple_answers(read_folder(Path(folder)))["greedy_bic"]
    print(json.dumps({"verdict": verdict, "ranking": {verdict: 1.0}}))
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
