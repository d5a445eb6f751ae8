"""What a rig cannot do is said before any device is touched: status 2, one line."""

from __future__ import annotations

import re
import sys

import pytest

import pkm_rig.virtual.mock_rig
from calibration.machine.description import shipped_machine
from pkm_rig.cli import main
from pkm_rig.rig.capabilities import can_verify
from pkm_rig.rig.config import demo_rig_path, embedded_rig_path, load_rig

HOMING = re.compile(r"\n\[drives.homing\]\n(.+\n)+")
NO_TABLES = ("metres_per_increment = 1.0e-8", 'metres_per_increment = 1.0e-8\nprofile = "plain-402"')


class Touched(BaseException):
    """A command has come as far as the devices."""


@pytest.fixture
def refused(monkeypatch, capsys, tmp_path):
    """The last line of a command that must end with status 2 and touch no device."""

    def touched(*_arguments, **_options):
        raise Touched

    def command(name, *options, rig, machine=None, homing=False):
        text = embedded_rig_path().read_text(encoding="utf-8")
        if not homing:
            text = HOMING.sub("", text)
        for old, new in rig:
            assert old in text
            text = text.replace(old, new)
        if machine is not None:
            own = shipped_machine("planar4").read_text(encoding="utf-8")
            (tmp_path / "machine.toml").write_text(own.replace(*machine), encoding="utf-8")
        (tmp_path / "rig.toml").write_text(text, encoding="utf-8")
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(pkm_rig.virtual.mock_rig.MockRig, "__enter__", touched)
        monkeypatch.setattr(sys, "argv", ["pkm-rig", name, "--rig", "rig.toml", *options])
        with pytest.raises(SystemExit) as ended:
            main()
        assert not (tmp_path / "runs").exists()
        lines = capsys.readouterr().err.strip().splitlines()
        assert (ended.value.code, len(lines)) == (2, 1), lines
        return lines[0]

    return command


def test_a_calibration_of_drives_without_tables(refused):
    line = refused("calibrate", rig=[NO_TABLES])
    assert "drive left" in line
    assert "stores no compensation tables" in line


def test_measuring_needs_no_tables(refused):
    with pytest.raises(Touched):
        refused("measure", rig=[NO_TABLES])


def test_homing_of_drives_that_have_no_way_to_be_homed(refused):
    assert "[drives.homing]" in refused("home", "--again", rig=[])


def test_homing_of_a_make_that_cannot_say_whether_it_succeeded(refused):
    assert "needs a profile with [referenced]" in refused("home", "--again", rig=[NO_TABLES], homing=True)


def test_a_payload_that_is_not_in_the_list(refused):
    line = refused("calibrate", rig=[("[nuisance]", "[campaign]\nloaded_payload = 3\n[nuisance]")])
    assert "payload 3 is not in [[payloads]]" in line


def test_a_crank_counts_in_radians(refused):
    text = HOMING.sub("", embedded_rig_path().read_text(encoding="utf-8"))
    drives = text[text.index("[[drives]]") : text.index("[plc]")]
    three = "".join(
        f'[[drives]]\nname = "{name}"\nnode_id = {node}\nvendor_id = 1\nproduct_code = 1\nmetres_per_increment = 1e-8\n'
        for node, name in enumerate(("a", "b", "c"), start=1)
    )
    line = refused("measure", rig=[('machine = "planar4"', 'machine = "rrr3"'), (drives, three)])
    assert "a is a crank, its coordinate is an angle: give radians_per_increment, not metres_per_increment" in line


def test_a_slider_counts_in_metres(refused):
    line = refused("measure", rig=[("metres_per_increment = 1.0e-8", "radians_per_increment = 1.0e-8")])
    assert "left is a slider, its coordinate is a length: give metres_per_increment, not radians_per_increment" in line


def test_a_drive_has_one_unit(refused):
    both = "metres_per_increment = 1.0e-8\nradians_per_increment = 1.0e-8"
    assert "left: give metres_per_increment" in refused("check", rig=[("metres_per_increment = 1.0e-8", both)])


@pytest.fixture
def refused_for(tmp_path, run):
    """The last line with which `measure` refuses a demo rig with other text, before any device is touched."""

    def line(machine, *changes):
        path, text = tmp_path / "rig.toml", demo_rig_path(machine).read_text(encoding="utf-8")
        for old, new in changes:
            assert old in text
            text = text.replace(old, new, 1)
        path.write_text(text, encoding="utf-8")
        done = run("measure", "--rig", path, "--out", tmp_path / "runs")
        assert done.returncode == 2
        return done.stderr.strip().splitlines()[-1]

    return line


def test_drives_that_must_agree_are_not_moved_by_profiles(refused_for):
    assert "each on its own profile would strain it" in refused_for(
        "gough8", ("[campaign]", '[campaign]\nmotion = "profile"')
    )


@pytest.mark.parametrize("method", [33, 34])
@pytest.mark.parametrize("machine", ["delta8", "gough8", "rrr4"])
def test_drives_that_must_agree_are_not_homed_by_moving(refused_for, machine, method):
    assert f"homing method {method} moves one drive while the others stand" in refused_for(
        machine, ("method = 37", f"method = {method}")
    )


@pytest.mark.parametrize(
    ("machine", "change", "drive"),
    [
        ("delta8", ("position_m = 0.8908431", "position_m = 0.9108431"), "[abcd]"),
        ("gough8", ("position_m = 0.2500005", "position_m = 0.29"), r"leg\d"),
        ("rrr4", ("position_rad = -0.0000004", "position_rad = 0.04"), "[abcd]"),
    ],
)
def test_positions_of_homing_that_do_not_agree(refused_for, machine, change, drive):
    line = refused_for(machine, change)
    assert re.search(f"homing: drive {drive} would stand -?[0-9.]+ mm or mrad from where the others have it", line)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("position_rad = -0.0000012", "position_m = 0.2"), "a crank has position_rad, not position_m"),
        (("method = 37", "method = 37\nspeed_m_per_s = 0.01"), "speed_m_per_s: a crank is homed in rad"),
    ],
)
def test_a_crank_is_homed_in_radians(refused_for, change, said):
    assert said in refused_for("rrr3", change)


def test_a_crank_has_no_profile_in_metres_a_second(refused_for):
    assert "speeds are in m/s: use 'led'" in refused_for("rrr3", ("[campaign]", '[campaign]\nmotion = "profile"'))


def test_tables_fit_two_sliders_only(refused_for):
    line = refused_for("stewart6", ("[campaign]", '[campaign]\ncompensation = "drive-tables"'))
    assert "tables in the drives fit machines with two sliders" in line


OWN_MACHINE = ('machine = "planar4"', 'machine = "machine.toml"')


@pytest.mark.parametrize("command", ["calibrate", "measure", "check"])
def test_a_workspace_beyond_the_travel(refused, command):
    line = refused(command, rig=[OWN_MACHINE], machine=("travel_m = [0.32, 1.70]", "travel_m = [0.32, 1.60]"))
    assert "drive left lacks" in line
    assert "at the workspace's corner x = -0.35 m, y = 0.3 m" in line
    missing_mm = 71.9 if command == "calibrate" else 61.9  # tables need 20 mm beyond, visits their approach of 10 mm
    assert f"lacks {missing_mm} mm" in line


def test_a_workspace_below_the_travel(refused):
    line = refused("measure", rig=[OWN_MACHINE], machine=("travel_m = [0.32, 1.70]", "travel_m = [0.60, 1.70]"))
    missing_mm = re.search(r"drive \w+ lacks ([0-9.]+) mm", line)
    needed_m = re.search(r"it needs ([0-9.]+) m", line)
    assert missing_mm, line
    assert needed_m, line
    assert float(missing_mm[1]) == pytest.approx(1e3 * (0.60 + 0.010 - float(needed_m[1])), abs=0.11)


def test_a_workspace_out_of_reach(refused):
    line = refused("measure", rig=[OWN_MACHINE], machine=("length_m = 1.5", "length_m = 0.7"))
    assert "do not reach the workspace's" in line


@pytest.mark.parametrize(("machine", "possible"), [("planar4", False), ("rrr4", True)])
def test_drives_without_tables_can_be_corrected_by_this_computer_alone(machine, possible, tmp_path):
    source = embedded_rig_path() if machine == "planar4" else demo_rig_path(machine)
    assert can_verify(*load_rig(source), source)
    path, text = tmp_path / "rig.toml", HOMING.sub("", source.read_text(encoding="utf-8"))
    path.write_text(re.sub(r"(\w+_per_increment = \S+)", r'\1\nprofile = "plain-402"', text), encoding="utf-8")
    assert can_verify(*load_rig(path), path) is possible
