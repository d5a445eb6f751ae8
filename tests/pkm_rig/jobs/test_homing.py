"""Drives that have lost their reference: refused by every command, homed on request, interlocked like any motion."""

from __future__ import annotations

from contextlib import contextmanager

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.machine.description import shipped_machines
from drivers.drives.homing import HomingParameters
from drivers.errors import DeviceError, InterlockOpen, NotReferenced
from pkm_rig.jobs import homing
from pkm_rig.jobs.added_visits import is_same_rig
from pkm_rig.rig.config import MockSection, demo_rig_path, embedded_rig_path, load_rig
from pkm_rig.rig.connection import connect_rig
from pkm_rig.rig.device_sections import HomingEntry
from pkm_rig.virtual.mock_rig import embedded_mock_rig
from tests.pkm_rig.conftest import short_rig_file

INDEX_M = 1.12  # the next one above where the mock machine is parked


@contextmanager
def lost(*, told=True, for_homing=True):
    """A mock rig whose drives wake up without a reference; `told`: its rig file says how to home them."""
    file, machine = short_rig_file()
    how = HomingEntry(method=34, position_m=INDEX_M, speed_m_per_s=0.001) if told else None
    drives = tuple(drive.model_copy(update={"homing": how}) for drive in file.drives)
    mock_section = file.mock.model_copy(update={"encoders": "incremental"})
    file = file.model_copy(update={"drives": drives, "mock": mock_section})
    with (
        embedded_mock_rig(file, embedded_rig_path()) as mock,
        mock.clock.activity(),
        connect_rig(mock.file, machine, mock.clock, mock.bus_factory, homing=for_homing) as rig,
    ):
        yield mock.mock, rig


def test_other_commands_refuse_such_drives():
    with pytest.raises(NotReferenced, match="left"), lost(for_homing=False):
        pass
    with lost() as (_, rig), pytest.raises(NotReferenced):
        rig.enable()


def test_they_are_homed_and_then_stand_where_the_rig_file_says():
    with lost() as (mock, rig):
        homed = homing.home_drives(rig)
        assert homed["compensation_switched_off"]
        for name in ("left", "right"):
            assert homed["drives"][name]["homed"]
            assert homed["drives"][name]["position_m"] == pytest.approx(INDEX_M, abs=1e-7)
        now_s = rig.clock.now_s()
        np.testing.assert_allclose([drive.encoder_m(now_s) for drive in mock.drives], INDEX_M, atol=1e-7)
        assert not any(drive.axis.powered for drive in mock.drives)
        assert not any(drive["homed"] for drive in homing.home_drives(rig)["drives"].values())
        rig.enable()
        rig.move(np.array([1.115, 1.115]), 0.1)
        np.testing.assert_allclose(rig.positions_m(), 1.115, atol=1e-7)


def test_a_rig_file_that_does_not_say_how_moves_nothing():
    with lost(told=False) as (mock, rig):
        before = [drive.encoder_m(rig.clock.now_s()) for drive in mock.drives]
        with pytest.raises(InputError, match=r"left must be homed but has no \[drives.homing\]"):
            homing.home_drives(rig)
        assert [drive.encoder_m(rig.clock.now_s()) for drive in mock.drives] == before


def test_a_rig_file_whose_homing_cannot_be_is_refused(tmp_path):
    text = embedded_rig_path().read_text()

    def with_homing(position, profile="pkm-mock"):
        path = tmp_path / "rig.toml"
        assert "position_m = 1.12\n" in text
        own = text.replace("position_m = 1.12\n", f"position_m = {position}\n", 1)
        path.write_text(own.replace("node_id", f'profile = "{profile}"\nnode_id'))
        return path

    assert load_rig(with_homing(INDEX_M))[0].drives[0].homing == HomingEntry(method=34, position_m=INDEX_M)
    with pytest.raises(InputError, match=r"left: homing.position_m = 1120 is outside the machine's travel of"):
        load_rig(with_homing(1120))
    with pytest.raises(InputError, match=r"left: \[drives.homing\] needs a profile with \[referenced\]"):
        load_rig(with_homing(INDEX_M, "plain-402"))


def test_the_defaults_are_those_of_the_driver():
    entry = HomingEntry(method=34, position_m=INDEX_M)
    assert entry.parameters == HomingParameters(34, INDEX_M)


def test_a_drive_that_stands_where_the_machine_cannot_is_refused_and_homed_on_request():
    with lost() as (mock, rig):
        drive = rig.drives.drives[0]
        mock.drives[0].axis.homing.referenced = True  # counting from zero, outside the travel
        with pytest.raises(NotReferenced, match=r"left .*is at 0.000000 m, outside its travel"):
            drive.connect()
        assert homing.home_drives(rig)["drives"]["left"]["homed"]
        drive.connect()


def test_an_open_interlock_stops_it_and_one_that_is_open_forbids_it():
    with lost() as (mock, rig):
        rig.clock.call_at(rig.clock.now_s() + 0.5, lambda: mock.plc.set_interlock(0, False))
        with pytest.raises(DeviceError):
            homing.home_drives(rig)
        assert isinstance(rig.supervisor.trip, InterlockOpen)
        assert not rig.drives.drives[0].reference.is_valid
        assert not any(drive.is_moving(rig.clock.now_s() + 0.1) for drive in mock.drives)
        with pytest.raises(InterlockOpen) as caught:
            homing.home_drives(rig)
        assert caught.value.__notes__ == ["tables: off on all drives"]


def test_how_drives_are_homed_does_not_make_a_campaign_another_one():
    then = {
        "machine": "m",
        "station": {},
        "campaign": {},
        "drives": [{"name": "a"}],
        "payloads": [],
        "nest_length": None,
    }
    assert is_same_rig(then, {**then, "drives": [{"name": "a", "homing": {"method": 37}}]}, adds=False)
    assert not is_same_rig(then, {**then, "drives": [{"name": "b", "homing": None}]}, adds=False)


@contextmanager
def demo_without_reference(name, *, incremental=True, **homing):
    """The demo rig of a machine whose drives wake up without a reference; `homing` changes all entries."""
    path = demo_rig_path(name)
    file, machine = load_rig(path)
    drives = tuple(drive.model_copy(update={"homing": drive.homing.model_copy(update=homing)}) for drive in file.drives)
    mock_section = file.mock or MockSection()
    mock_section = mock_section.model_copy(update={"encoders": "incremental" if incremental else "absolute"})
    file = file.model_copy(update={"drives": drives, "mock": mock_section})
    with (
        embedded_mock_rig(file, path) as mock,
        mock.clock.activity(),
        connect_rig(mock.file, machine, mock.clock, mock.bus_factory, rig_path=path, homing=True) as rig,
    ):
        yield rig, mock.mock


@pytest.mark.parametrize("name", shipped_machines())
def test_the_demo_rig_of_every_machine_is_homed(name):
    with demo_without_reference(name) as (rig, mock):
        before = [drive.encoder_m(rig.clock.now_s()) for drive in mock.drives]
        homed = homing.home_drives(rig)["drives"]
        unit = "rad" if rig.machine.rotary_drives else "m"
        said = [homed[drive.name][f"position_{unit}"] for drive in rig.drives.drives]
        true = np.array([drive.encoder_m(rig.clock.now_s()) for drive in mock.drives])
        np.testing.assert_allclose(true, said, atol=2e-7)  # the entries have seven places
        assert all(drive.reference.is_valid for drive in rig.drives.drives)
        if rig.machine.redundantly_actuated:
            np.testing.assert_array_equal(true, before)


def test_a_machine_that_is_not_where_its_drives_are_homed_is_not_homed():
    with demo_without_reference("gough8", incremental=False) as (rig, mock):
        rig.enable()
        rig.lead(np.array([0.06, 0.0, 1.14, 0.0, 0.0, 0.0]), 0.1)
        rig.drives.disable()
        rig.drives.drives[4].reference.distrust("one was exchanged")
        counts = [drive.encoder_m(rig.clock.now_s()) for drive in mock.drives]
        with pytest.raises(InputError, match=r"homing: drive leg\d would stand .* from where the others have it"):
            homing.home_drives(rig)
        assert [drive.encoder_m(rig.clock.now_s()) for drive in mock.drives] == counts


def test_a_crank_is_searched_in_radians():
    entry = HomingEntry(method=33, position_rad=0.1, speed_rad_per_s=0.01, tolerance_rad=0.002)
    assert entry.parameters == HomingParameters(33, 0.1, speed_m_per_s=0.01, tolerance_m=0.002)
    assert entry.keys_in_other_unit == []
    assert HomingEntry(method=33, position_rad=0.1, speed_m_per_s=0.01).keys_in_other_unit == ["speed_m_per_s"]
    assert HomingEntry(method=33, position_m=0.1, tolerance_rad=0.01).keys_in_other_unit == ["tolerance_rad"]
