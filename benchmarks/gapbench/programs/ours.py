"""The diagnosis of this project: what `pkm-rig diagnose FOLDER --json` says of its verdict.

python -m benchmarks.gapbench.programs.ours FOLDER
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

from calibration.diagnosis.diagnose import diagnose
from calibration.recording.folder import read_folder


def main(folder: str) -> int:
    """Print the answer to a recording."""
    diagnosis = diagnose(read_folder(Path(folder)))
    shrink = diagnosis.gap.shrink if math.isfinite(diagnosis.gap.shrink) else None
    print(json.dumps({"verdict": diagnosis.verdict, "ranking": dict(diagnosis.ranking), "shrink": shrink}))
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
