"""The mock's reader of the machine file."""

from __future__ import annotations

import pytest

from mock_devices.machine_file import MachineFileError, read_machine_file


def test_the_example_machine_is_read_as_its_file_says(machine_file):
    assert machine_file.name == "planar4"
    assert [slider.name for slider in machine_file.sliders] == ["left", "right"]
    assert machine_file.sliders[0].axis == 1j
    assert machine_file.struts[2].platform_joint == 0.2 + 0.125j
    assert machine_file.struts[2].drive == 1
    assert machine_file.gravity == -9.80665j
    assert machine_file.expansion["drives"].sensor == "columns"
    assert [smr.name for smr in machine_file.smrs] == ["P1", "P2", "P3", "SL", "SR", "N1", "N2"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('["x", "y", "rz"]', '["x", "y", "z"]', "planar"),
        ('kind = "slider"', 'kind = "leg"', "sliders only"),
        ('on = "floor"', 'on = "moon"', "there is no moon"),
        ("format = 1", "format = 1\nweather = 2", "unknown keys: weather"),
        ("travel_m = [0.32, 1.70]", "travel_m = [1.70, 0.32]", "not a range"),
        ("moving_mass_kg = 150.0", "", "moving_mass_kg"),
        ('drive = "left"', 'drive = "middle"', "middle"),
    ],
)
def test_a_file_that_the_plant_cannot_stand_for_is_refused(machine_path, tmp_path, old, new, message):
    path = tmp_path / "machine.toml"
    path.write_text(machine_path.read_text().replace(old, new))
    with pytest.raises(MachineFileError, match=message):
        read_machine_file(path)
