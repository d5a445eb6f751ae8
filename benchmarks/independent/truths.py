"""The only module that reads what is true; only the scorer uses it, after the answers are on disk."""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.independent.final_runs import FinalRun
from benchmarks.independent.recordings import NoRecordings, is_even

TABLE, ARRAYS = "truth/truth.json", "truth/{}.npz"


class OddTruth(RuntimeError):
    """The truth of an odd-numbered recording was asked for outside a final run."""


@dataclass(frozen=True)
class Truth:
    """What was in a recording.

    entry: its object of truth.json; noise_free_m (r, 3): what the station would have read without noise, its frame;
    platform (k,): rows of the platform's reflectors.
    """

    entry: dict[str, Any]
    noise_free_m: NDArray[np.float64]
    platform: NDArray[np.intp]


def read_truths(archive: Path, names: Collection[str], final_run: FinalRun | None = None) -> dict[str, Truth]:
    """Truths by recording; raises OddTruth for an odd one without a final run, before anything is read."""
    odd = sorted(name for name in names if not is_even(name))
    if odd and final_run is None:
        raise OddTruth(f"{odd[0]} is of the odd half: only a final run scores it (--final)")
    entries: dict[str, Any] = {}
    arrays: dict[str, Any] = {}
    wanted = {ARRAYS.format(name): name for name in names}
    with tarfile.open(archive) as tar:
        for member in tar:
            path = member.name.removeprefix("./")
            stream = tar.extractfile(member) if path == TABLE or path in wanted else None
            if stream is None:
                continue
            if path == TABLE:
                entries = {name: entry for name, entry in json.load(stream).items() if name in names}
            else:
                with np.load(io.BytesIO(stream.read()), allow_pickle=False) as file:
                    arrays[wanted[path]] = {name: file[name] for name in file.files}
    lacking = sorted(set(names) - (entries.keys() & arrays.keys()))
    if lacking:
        raise NoRecordings(f"{archive}: no truth of {lacking[0]}; fetch the archive anew")
    return {
        name: Truth(entries[name], arrays[name]["clean_m"], np.flatnonzero(arrays[name]["platform"])) for name in names
    }
