"""A recording as HDF5: every value, and its unit as an attribute."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.base.toml_file import parse_toml
from calibration.recording.hdf5 import require_hdf5, write_hdf5
from calibration.recording.header import RecordingFile
from tests.pkm_rig.plant_recording import record

h5py = pytest.importorskip("h5py")


def test_all_columns_with_unit_and_meaning(tmp_path):
    recording, path = record(4, calibration_poses=6), tmp_path / "r.h5"
    require_hdf5(path)
    write_hdf5(recording, path, "ab")
    with h5py.File(path) as file:
        group = file["readings"]
        assert set(group) == set(recording.columns)
        for name, values in recording.columns.items():
            if values.dtype.kind == "U":
                assert group[name].asstr()[...].tolist() == values.tolist()
            else:
                np.testing.assert_array_equal(group[name][...], values)
        assert group["x_m"].attrs["unit"] == "m"
        assert group["cov_xy_m2"].attrs["unit"] == "m²"
        assert group["air_temperature_c"].attrs["unit"] == "°C"
        assert group["uid"].attrs["unit"] == ""
        assert "Rig time" in group["t_rig_s"].attrs["meaning"]
        assert (file.attrs["campaign"], file.attrs["head"], bool(file.attrs["simulated"])) == ("plant-4", "ab", False)
        assert parse_toml(file.attrs["recording.toml"], RecordingFile, "r") == recording.file
        assert file.attrs["machine.toml"] == recording.machine.text
    with pytest.raises(InputError, match="there already"):
        require_hdf5(path)
