"""Supervision over the real protocols: any doubt stops all drives, and no old value is used."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from drivers.can.can_line import CanLine
from drivers.errors import DeviceError, InterlockOpen, OtherMaster, PlcError, StaleData
from pkm_rig.rig.config import embedded_rig_path
from pkm_rig.rig.connection import connect_rig
from pkm_rig.virtual.mock_rig import embedded_mock_rig
from tests.pkm_rig.conftest import mock_and_rig, short_rig_file

CENTRE = np.array([1.118, 1.118])


def test_an_unexpected_failure_of_a_poll_stops_the_drives_too(short_rig, monkeypatch):
    mock, rig = short_rig
    rig.enable()

    def broken():
        raise IndexError("a short reply")

    monkeypatch.setattr(rig.plc, "read", broken)
    rig.clock.sleep_s(2.0)
    assert "IndexError" in str(rig.supervisor.trip)
    assert rig.drives.stop_reason is not None
    with pytest.raises(DeviceError, match="IndexError"):
        rig.move(CENTRE, 0.1)
    assert not any(drive.is_moving(rig.clock.now_s()) for drive in mock.drives)


def test_old_values_are_refused(short_rig):
    _, rig = short_rig
    assert rig.supervisor.state().payload == 0
    rig.supervisor.stop()
    rig.clock.sleep_s(10.0)
    with pytest.raises(StaleData):
        rig.supervisor.state()


def test_nothing_moves_while_the_payload_is_being_changed(short_rig):
    _, rig = short_rig
    rig.enable()
    with pytest.raises(InterlockOpen, match="being changed"):
        rig.plc.request_payload(1, watch=lambda: rig.move(CENTRE, 0.1))


def test_a_payload_is_changed_without_power_and_the_guard_may_be_open_meanwhile(short_rig):
    mock, rig = short_rig
    rig.enable()
    powered = []
    start_s = rig.clock.now_s()
    rig.clock.call_at(start_s + 10.0, lambda: mock.plc.set_interlock(0, False))
    rig.clock.call_at(start_s + 20.0, lambda: powered.append([drive.axis.powered for drive in mock.drives]))
    rig.clock.call_at(start_s + 90.0, lambda: mock.plc.set_interlock(0, True))
    rig.change_payload(1)
    assert powered == [[False, False]]
    assert rig.clock.now_s() - start_s >= 90.0
    assert rig.supervisor.trip is None
    assert [drive.axis.powered for drive in mock.drives] == [True, True]
    rig.move(CENTRE, 0.1)


def test_heartbeats_of_drives_are_watched(monkeypatch):
    monkeypatch.setattr("pkm_rig.rig.connection.EMBEDDED_GUARD_S", 1.0)  # the closed drive is asked on leaving
    file, machine = short_rig_file()
    with mock_and_rig(file, machine) as (mock, rig):
        rig.enable()
        mock.drives[1].close()
        rig.clock.sleep_s(10.0)
        assert isinstance(rig.supervisor.trip, StaleData)
        assert "right" in str(rig.supervisor.trip)
        mock.drives[0].axis.refresh()
        assert not mock.drives[0].is_moving(rig.clock.now_s())


def test_compensation_goes_off_on_the_drive_that_can_still_be_reached(monkeypatch):
    monkeypatch.setattr("pkm_rig.rig.connection.EMBEDDED_GUARD_S", 0.2)
    file, machine = short_rig_file()
    from tests.pkm_rig.rig.test_rig import flat_table, write  # noqa: PLC0415

    with mock_and_rig(file, machine) as (mock, rig):
        rig.enable()
        write(rig, flat_table(0.0))
        mock.drives[0].close()
        with pytest.raises(DeviceError):
            rig.switch_compensation(None)
        assert mock.drives[1].compensation.mode == 0


def test_a_drive_that_another_master_moves_is_stopped_and_the_master_is_named():
    file, machine = short_rig_file()
    with (
        embedded_mock_rig(file, embedded_rig_path()) as mock,
        mock.clock.activity(),
        connect_rig(mock.file, machine, mock.clock, mock.bus_factory) as rig,
        CanLine(mock.bus_factory(), "foreign") as foreign,
    ):
        rig.enable()
        foreign.send(0x601, struct.pack("<BHBi", 0x23, 0x607A, 0, 120_000_000))  # far from where it is
        for controlword in (0x0F, 0x1F):
            foreign.send(0x201, struct.pack("<H", controlword))
        rig.clock.sleep_s(2.0)
        assert isinstance(rig.supervisor.trip, OtherMaster)
        assert "node 1" in str(rig.supervisor.trip)
        assert rig.drives.stop_reason is not None
        assert not any(drive.is_moving(rig.clock.now_s()) for drive in mock.mock.drives)
        assert abs(mock.mock.drives[0].encoder_m(rig.clock.now_s()) - 1.118) < 1e-4  # before the next poll
        with pytest.raises(OtherMaster):
            rig.move(CENTRE, 0.1)


def test_a_payload_that_changes_during_a_motion_stops_the_drives(short_rig):
    mock, rig = short_rig
    rig.enable()
    rig.clock.call_at(rig.clock.now_s() + 0.5, lambda: mock.plant.put_on(1))
    with pytest.raises(DeviceError):
        rig.move(CENTRE + 0.3, 0.1)
    assert isinstance(rig.supervisor.trip, PlcError)
    assert "changed during a motion" in str(rig.supervisor.trip)
    rig.clock.sleep_s(1.0)
    assert not any(drive.is_moving(rig.clock.now_s()) for drive in mock.drives)
