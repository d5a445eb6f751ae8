"""A classifier of scikit-learn on projected scores (`benchmarks/gapbench/features.py`), as `train` has made it.

python -m benchmarks.gapbench.programs.classifier MODEL FOLDER
"""

from __future__ import annotations

import json
import pickle
import sys
from pathlib import Path

from benchmarks.gapbench.features import features_of
from calibration.recording.folder import read_folder


def main(model: str, folder: str) -> int:
    """Print the answer to a recording."""
    classifier = pickle.loads(Path(model).read_bytes())  # our own file, staged with this program
    probabilities = classifier.predict_proba(features_of(read_folder(Path(folder)))[None])[0].tolist()
    ranking = dict(zip(map(str, classifier.classes_), probabilities, strict=True))
    print(json.dumps({"verdict": max(ranking, key=lambda name: ranking[name]), "ranking": ranking}))
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
