"""Compares pairs of recording folders for a study: paths in, results out, nothing else.

    python -m benchmarks.comparison.comparer

Each line on stdin is a JSON list of two folders; the line on stdout that answers it is the comparison as JSON, or
{"error": "..."}. It knows the recordings alone: the truth stays with the process that made them.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

from calibration.base.errors import InputError
from calibration.comparison.compare import compare
from calibration.recording.folder import read_folder


def answer(folders: list[str]) -> dict[str, Any]:
    """The comparison of two folders, as far as it is scored."""
    begun = time.process_time()
    try:
        result = compare(*(read_folder(Path(folder)) for folder in folders))
    except (InputError, ArithmeticError, ValueError) as error:
        return {"error": f"{type(error).__name__}: {error}"}
    return {
        "verdict": result.verdict,
        "place": result.place,
        "equivalent": [list(name) for name in result.equivalent],
        "ranking": dict(result.ranking),
        "changes": [
            {
                "structure": change.structure,
                "place": change.place,
                "quantities": {q.name: [q.value, q.u] for q in change.quantities},
            }
            for change in result.changes
        ],
        "seconds": time.process_time() - begun,
        "error": "",
    }


def main() -> int:
    """Answer until stdin ends."""
    for line in sys.stdin:
        print(json.dumps(answer(json.loads(line))), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
