from __future__ import annotations

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.machine.description import load_machine, parse_machine, shipped_machine, shipped_machines

GUIDE = '[[guides]]\nname = "g"\nkind = "plane"\npoint_m = [0.0, 0.0, 0.0]\nstiffness_n_per_m = 1.0e8\n'


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
        ('"x", "y", "rz"]', '"x", "y", "rx", "rz"]', "of the rotations none, one or all three"),
        ('"x", "y", "rz"]', '"x", "y", "rz"]\ncommanded = ["z"]', "z is not a free coordinate"),
        ('"x", "y", "rz"]', '"x", "y", "rz"]\ncommanded = ["x", "y", "rz"]', "more coordinates than drives"),
        ('"x", "y", "rz"]', '"x", "y", "z", "rx", "ry", "rz"]', "4 constraints cannot hold 6"),
        ("travel_m = [0.32, 1.70]", "travel_m = [1.70, 0.32]", "not a range"),
        ('kind = "slider"', 'kind = "rope"', "drives.0"),
        ("axis_tilt_rad = 1.0e-4\n", "", "axis_tilt_rad is missing"),
        ("[tolerances]", GUIDE + 'joint = "none"\ndirection = [0.0, 0.0, 1.0]\n[tolerances]', "unknown strut 'none'"),
        ("[tolerances]", GUIDE + 'joint = "left_upper"\ndirection = [0.0, 0.0, 2.0]\n[tolerances]', "not of length 1"),
        ("[tolerances]", GUIDE + 'joint = "left_upper"\ndirection = [0.0, 0.0, 1.0]\n[tolerances]', "guide_position_m"),
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


@pytest.mark.parametrize("name", shipped_machines())
def test_every_shipped_machine_reads_and_counts_its_constraints(name):
    machine = load_machine(shipped_machine(name))
    expected = {"planar4": 1, "rrr4": 1, "delta8": 2, "gough8": 2}
    assert machine.redundancy == expected.get(name, 0)
    assert set(machine.commanded.tolist()) <= set(machine.dof.tolist())
    assert machine.planar == (name in ("planar4", "rrr3", "rrr4"))
    assert sum(s.on == "platform" for s in machine.smrs) >= 3
    assert len(machine.load_cases) == (0 if name == "planar4" else 2)


def test_a_line_is_two_planes_across_it():
    text = shipped_machine("prs3").read_text(encoding="utf-8")
    machine = parse_machine(text.replace('kind = "plane"', 'kind = "line"', 1), "line.toml")
    assert machine.guide_names[:2] == ("hinge_a.1", "hinge_a.2")
    direction = np.array(machine.file.guides[0].direction)
    np.testing.assert_allclose(machine.nominal.guide_normal[:2] @ direction, 0.0, atol=1e-15)
    assert machine.nominal.guide_normal[0] @ machine.nominal.guide_normal[1] == pytest.approx(0.0, abs=1e-15)


def test_a_reflector_cannot_ride_on_a_leg():
    text = shipped_machine("stewart6").read_text(encoding="utf-8").replace('on = "platform"', 'on = "leg1"', 1)
    with pytest.raises(InputError, match="is on the leg 'leg1'; put it on the platform"):
        parse_machine(text, "legs.toml")
