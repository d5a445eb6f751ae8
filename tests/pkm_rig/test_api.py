"""The Python interface, from a recording to tables and on a connected mock rig."""

from __future__ import annotations

from importlib.metadata import version

import numpy as np
import pytest

import pkm_rig
from calibration.base.errors import InputError
from calibration.recording.folder import write_folder
from pkm_rig.errors import CampaignRefused
from pkm_rig.rig.config import embedded_rig_path
from tests.pkm_rig.plant_recording import record


def test_its_version_is_that_of_the_distribution():
    assert pkm_rig.__version__ == version("pkm-rig")


def test_machines_come_by_name_or_path(tmp_path):
    shipped = pkm_rig.load_machine("planar4")
    (tmp_path / "own.toml").write_text(shipped.text, encoding="utf-8")
    assert pkm_rig.load_machine(str(tmp_path / "own.toml")).drive_names == shipped.drive_names
    with pytest.raises(InputError, match="not shipped"):
        pkm_rig.load_machine("planar5")


def test_a_recording_becomes_tables(tmp_path):
    write_folder(record(4, calibration_poses=12), tmp_path / "folder")
    recording = pkm_rig.read_recording(str(tmp_path / "folder"))
    assert len(pkm_rig.reduce(recording).observations) > 100
    identification = pkm_rig.identify(recording)
    table = pkm_rig.build_tables(identification, payload=1)
    assert table.conditions.payload_kg == 200.0
    assert 1e-6 < np.max(np.abs(table.correction_m)) < 1e-3
    assert pkm_rig.diagnose(recording).campaign == "plant-4"


def test_a_rig_is_connected_and_measured_with(tmp_path):
    text = embedded_rig_path().read_text(encoding="utf-8")
    path = tmp_path / "rig.toml"
    path.write_text(text + "\n[campaign]\nwarm_up_max_s = 0.0\n", encoding="utf-8")
    file, machine = pkm_rig.load_rig(path)
    assert [drive.name for drive in file.drives] == list(machine.drive_names)
    lines = []
    with pkm_rig.open_store(tmp_path) as store, pkm_rig.connect(path, seed=3) as rig:
        assert rig.positions_m().shape == (2,)
        with pytest.raises(CampaignRefused, match="warm-up"):
            pkm_rig.measure(rig, store, notify=lines.append)
        assert store.campaigns()[0][0] in lines[0]
