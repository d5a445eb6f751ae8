"""Writes archives of recordings with their truths, in the form that this check reads.

For simulators of this repository and for tests; the other simulator's archive is somebody else's.
"""

from __future__ import annotations

import io
import json
import os
import shutil
import tarfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.independent.recordings import ARCHIVE
from benchmarks.independent.truths import ARRAYS, TABLE


def write_case(
    folder: Path, files: Mapping[str, bytes], entry: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
) -> None:
    """Write one recording and its truth; whole when this returns, or not there. One that another process has written
    meanwhile, such as one that outlives its killed parent, is the same and stays.

    files: contents by name; entry: its object of the table of truths; arrays: `clean_m` (r, 3) and `platform` (r,).
    """
    under_way = folder.with_name(f"{folder.name}.{os.getpid()}.part")
    under_way.mkdir(parents=True, exist_ok=True)
    for name, data in files.items():
        (under_way / name).write_bytes(data)
    (under_way / "entry.json").write_text(json.dumps(entry, allow_nan=False), encoding="utf-8")
    (under_way / "arrays.npz").write_bytes(packed_arrays(arrays))
    try:
        under_way.rename(folder)
    except OSError:
        if not folder.is_dir():
            raise
        shutil.rmtree(under_way)


def pack(cases: Path, folder: Path, names: Iterable[str]) -> Path:
    """The archive of some of the cases that `write_case` has written below `cases`; the same bytes each time."""
    files: dict[str, bytes] = {}
    entries: dict[str, Any] = {}
    for case in (cases / name for name in sorted(names)):
        entries[case.name] = json.loads((case / "entry.json").read_text(encoding="utf-8"))
        files[ARRAYS.format(case.name)] = (case / "arrays.npz").read_bytes()
        for file in sorted(case.iterdir()):
            if file.name not in ("entry.json", "arrays.npz"):
                files[f"{case.name}/{file.name}"] = file.read_bytes()
    return write_archive(folder, {TABLE: json.dumps(entries).encode(), **files})


def write_archive(folder: Path, files: Mapping[str, bytes]) -> Path:
    """An archive of some files, which is whole or not there."""
    folder.mkdir(parents=True, exist_ok=True)
    under_way = folder / f"{ARCHIVE}.part"
    with tarfile.open(under_way, "w:xz", preset=1) as tar:
        for name, data in files.items():
            member = tarfile.TarInfo(f"./{name}")  # its time is zero: the archive's hash tells of its content only
            member.size = len(data)
            tar.addfile(member, io.BytesIO(data))
    return under_way.replace(folder / ARCHIVE)


def packed_arrays(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Arrays as the content of an .npz file; numpy gives its members a fixed time."""
    stream = io.BytesIO()
    np.savez(stream, **dict(arrays))  # type: ignore[arg-type]
    return stream.getvalue()
