from __future__ import annotations

import numpy as np
import pytest

from calibration.machine import load_machine, parse_machine, shipped_machine
from calibration.toml_file import InputError


@pytest.fixture(scope="module")
def text():
    return shipped_machine("planar4").read_text(encoding="utf-8")


def test_the_default_machine_reads_as_documented(machine):
    assert machine.drive_names == ("left", "right")
    assert machine.dof.tolist() == [0, 1, 5]
    assert machine.strut_drive.tolist() == [0, 0, 1, 1]
    np.testing.assert_allclose(machine.nominal.length_m, 1.5)
    assert machine.smr("SL").on == "slider"
    assert machine.smr("N1").on == "floor"


def test_parts_grow_by_the_temperature_of_their_sensor(machine):
    warm = {"struts": np.array([30.0]), "columns": np.array([20.0]), "base": np.array([10.0])}
    factors = machine.expansion_factors({**warm, "platform": np.array([20.0])})
    assert factors["struts"][0] == pytest.approx(1.0 + 11.5e-5)
    assert factors["drives"][0] == 1.0
    assert factors["base"][0] == pytest.approx(1.0 - 11.5e-5)
    with pytest.raises(InputError, match="no temperature 'platform'"):
        machine.expansion_factors(warm)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("format = 1", "format = 2", "format"),
        ("format = 1", "format = 1\ncolour = 3", "unknown key 'colour'"),
        ('drive = "left"', 'drive = "middle"', "unknown drive 'middle'"),
        ("axis = [0.0, 1.0, 0.0]", "axis = [0.0, 2.0, 0.0]", "not of length 1"),
        ("length_m = 1.5", "length_m = -1.5", "length_m"),
        ("length_m = 1.5", "length_m = inf", "length_m"),
        ('name = "left_lower"', 'name = "left_upper"', "same name"),
        ("[expansion.base]", "[expansion.bed]", "expansion"),
        ('on = "left"', 'on = "ceiling"', "ceiling"),
        ("[platform]", "[platform", "not TOML"),
    ],
)
def test_bad_machine_files_are_one_clear_line(text, old, new, complaint):
    assert old in text
    with pytest.raises(InputError, match=complaint) as caught:
        parse_machine(text.replace(old, new, 1), "machine.toml")
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("machine.toml")


def test_missing_and_huge_files_are_named(tmp_path):
    with pytest.raises(InputError, match="check the path"):
        load_machine(tmp_path / "none.toml")
    (tmp_path / "huge.toml").write_bytes(b"#" * 2_000_000)
    with pytest.raises(InputError, match="larger than"):
        load_machine(tmp_path / "huge.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="UTF-8"):
        load_machine(tmp_path / "binary.toml")
