"""The programs that are entered from the start, each staged in a folder that holds nothing of the makers of cases."""

from __future__ import annotations

import compileall
import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from py_compile import PycInvalidationMode

from benchmarks.gapbench.program import PYTHON, Entry
from benchmarks.results_file import ROOT

OURS, GREEDY, CLASSIFIER = "ours", "greedy_bic", "classifier"
NAMES = (OURS, GREEDY, CLASSIFIER)
STAGED = (
    "benchmarks/__init__.py", "benchmarks/gapbench/__init__.py", "benchmarks/gapbench/features.py",
    "benchmarks/gapbench/programs", "benchmarks/withheld/__init__.py", "benchmarks/withheld/baselines.py",
    "calibration",
)  # fmt: skip
MODEL = "classifier.pickle"


def shipped(names: Sequence[str], folder: Path, trained: Callable[[], Path]) -> list[Entry]:
    """Entries by name, staged below a folder; trained: makes the classifier's file where one is entered."""
    out = []
    for name in names:
        module = f"benchmarks.gapbench.programs.{name}"
        more = {MODEL: trained()} if name == CLASSIFIER else {}
        command = [PYTHON, "-m", module, *(["{program}/" + MODEL] if more else []), "{folder}"]
        out.append(Entry(name, tuple(command), home=staged(folder, more)))
    return out


def staged(folder: Path, more: dict[str, Path]) -> Path:
    """A folder with copies of STAGED and of further files by name; the same one for the same content."""
    files = {path: ROOT / path for name in STAGED for path in _files(name)} | more
    digest = hashlib.sha256()
    for name in sorted(files):
        digest.update(f"{name}\0".encode() + files[name].read_bytes() + b"\0")
    home = folder / digest.hexdigest()[:16]
    if not home.exists():
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder) as begun:
            for name, file in files.items():
                target = Path(begun) / "staged" / name
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(file, target)
            # A program may not write where it is: without this it would be compiled anew for every recording.
            compileall.compile_dir(
                Path(begun) / "staged", quiet=2, invalidation_mode=PycInvalidationMode.UNCHECKED_HASH
            )
            os.rename(Path(begun) / "staged", home)
    return home


def _files(name: str) -> list[str]:
    place = ROOT / name
    found = place.rglob("*") if place.is_dir() else [place]
    return [str(file.relative_to(ROOT)) for file in found if file.is_file() and "__pycache__" not in file.parts]
