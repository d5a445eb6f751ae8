"""A recording as one HDF5 file: a data set a column, its unit and meaning as attributes (extra `[hdf5]`).

For programs that read HDF5; what is analysed is the store or the recording folder.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np

from calibration.base.errors import InputError
from calibration.base.toml_text import to_toml
from calibration.recording.recording import Recording

MISSING = "an HDF5 file needs h5py; install it with: pip install 'pkm-rig[hdf5]'"


def require_hdf5(path: Path) -> None:
    """InputError where h5py is not installed, or the file is there already."""
    if importlib.util.find_spec("h5py") is None:
        raise InputError(f"--hdf5: {MISSING}")
    if path.exists():
        raise InputError(f"{path}: there already; choose another name")


def write_hdf5(recording: Recording, path: Path, head: str = "") -> None:
    """Write a recording. Texts are UTF-8, numbers float64 in SI; a number that is missing is NaN.

    Group `readings`: a data set a column, with `unit` (empty for texts and counts) and `meaning`. Attributes of the
    file: `campaign`, `head` of its chain, `simulated`, and as text `recording.toml` and `machine.toml`.
    """
    import h5py  # noqa: PLC0415  # an extra

    table = {column.name: column for column in recording.file.column_table()}
    with h5py.File(path, "x") as file:
        file.attrs["campaign"] = recording.file.campaign
        file.attrs["head"] = head
        file.attrs["simulated"] = recording.file.simulated
        file.attrs["recording.toml"] = to_toml(recording.file)
        file.attrs["machine.toml"] = recording.machine.text
        group = file.create_group("readings")
        for name, values in recording.columns.items():
            is_text = values.dtype.kind in "UO"
            stored = values.astype(h5py.string_dtype("utf-8")) if is_text else np.asarray(values, dtype=np.float64)
            dataset = group.create_dataset(name, data=stored)
            column = table.get(name)
            dataset.attrs["unit"] = "" if column is None else column.unit
            dataset.attrs["meaning"] = "" if column is None else column.meaning
