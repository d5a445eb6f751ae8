"""Trains the classifier on structures of another seed (`features`): extremely randomised trees (Geurts et al. 2006).

The classes are the first right name of each case, none and unknown. Features are kept as they are computed.
"""

from __future__ import annotations

import pickle
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from benchmarks.gapbench.features import features_of
from benchmarks.results_file import code_digest
from benchmarks.structures.run import MAKING_CODE
from benchmarks.structures.structure import KNOWN_CASE, NULL_CASE, Generator
from benchmarks.withheld.scorer import NONE, UNKNOWN
from calibration.machine.description import load_machine
from calibration.recording.header import RecordingFile
from calibration.recording.recording import Recording
from mock_devices.recordings.maker import MockRecording
from tests.kept_results import KeptResults, key_of

OTHER_SEED = 1_000_000  # and above: beyond any seed of cases that are scored
SAME_DESIGNS = 60  # cases on the designs of one seed
TREES = 600
CODE = ("calibration", *MAKING_CODE, "benchmarks/gapbench/features.py")


class NotInstalled(RuntimeError):
    """scikit-learn is missing; one line."""


def train(cases: int, folder: Path, machine: Path) -> Path:
    """The file of a classifier trained on so many cases, made if it is not there yet. Raises NotInstalled."""
    if find_spec("sklearn") is None:
        raise NotInstalled(
            "scikit-learn is not installed; pip install -e '.[gapbench]', or leave classifier out with --entries"
        )
    file = folder / f"classifier-{key_of(code_digest(*CODE, 'benchmarks/gapbench/train.py'), cases)}.pickle"
    if not file.exists():
        features, labels = _examples(cases, folder, machine)
        classifier = _fitted(features, labels)
        file.write_bytes(pickle.dumps(classifier))
    return file


def label_of(kind: str, names: list[str]) -> str:
    """The class of a case."""
    if kind == KNOWN_CASE:
        return names[0]
    return NONE if kind == NULL_CASE else UNKNOWN


def as_read(recording: MockRecording, machine: Path) -> Recording:
    """A mock recording as the diagnosis takes it."""
    return Recording(RecordingFile.model_validate(recording.header), load_machine(machine), recording.columns)


def _examples(cases: int, folder: Path, machine: Path) -> tuple[np.ndarray, list[str]]:
    results, code = KeptResults(folder / "training.jsonl"), code_digest(*CODE)
    generators = [Generator(OTHER_SEED + k) for k in range(-(-cases // SAME_DESIGNS))]
    started = time.monotonic()
    keys = [key_of(code, k) for k in range(cases)]
    missing = [k for k in range(cases) if keys[k] not in results]
    for done, k in enumerate(missing, start=1):
        case = generators[k // SAME_DESIGNS].case(k)
        label = label_of(case.truth["kind"], case.truth["names"])
        features = np.round(features_of(as_read(case.recording, machine)), 4).tolist()
        results.add({"key": keys[k], "label": label, "features": features})
        left_min = (time.monotonic() - started) / done * (len(missing) - done) / 60.0
        print(f"training: {k + 1} of {cases}; {left_min:.1f} min left", file=sys.stderr, flush=True)
    rows = [results[key] for key in keys]
    return np.array([row["features"] for row in rows]), [row["label"] for row in rows]


def _fitted(features: np.ndarray, labels: list[str], trees: int = TREES) -> object:
    from sklearn.ensemble import ExtraTreesClassifier  # noqa: PLC0415 - installed with the extra `gapbench`

    return ExtraTreesClassifier(
        trees, min_samples_leaf=2, max_features=0.2, class_weight="balanced", random_state=1
    ).fit(features, labels)
