"""What the rig refuses, over the real protocols: interlocks, payload, compensation, limits."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.compensation.tables import CompensationTable
from calibration.model.operating_conditions import OperatingConditions
from drivers.errors import ConnectionFailed, DeviceError, IdentityMismatch, InterlockOpen, SdoRefused, TableError
from pkm_rig.rig.rig_checks import in_plane_u_m
from tests.pkm_rig.conftest import mock_and_rig, short_rig_file

CENTRE = np.array([1.118, 1.118])


def flat_table(payload_kg: float, correction_m: float = 50e-6) -> CompensationTable:
    return CompensationTable(
        start_m=np.array([0.5, 0.5]),
        step_m=np.array([0.05, 0.05]),
        correction_m=np.full((2, 17, 17), correction_m),
        conditions=OperatingConditions(payload_kg, (0.0, 0.0, 0.0), {"struts": 20.0}),
    )


def write(rig, table):
    return rig.compensate(rig.images(table, rig.next_generation()))


def test_compensation_moves_the_encoder_and_not_the_command(short_rig):
    mock, rig = short_rig
    rig.enable()
    write(rig, flat_table(0.0))
    rig.move(CENTRE, 0.2)
    np.testing.assert_allclose(rig.positions_m(), CENTRE, atol=1e-7)
    encoders = [drive.encoder_m(rig.clock.now_s()) for drive in mock.drives]
    np.testing.assert_allclose(encoders, CENTRE + 50e-6, atol=1e-7)


def test_a_table_for_another_payload_is_not_left_on(short_rig):
    mock, rig = short_rig
    rig.enable()
    with pytest.raises(TableError, match="does not fit the payload"):
        write(rig, flat_table(200.0))
    assert [drive.compensation.mode for drive in mock.drives] == [0, 0]


def test_when_the_payload_changes_motion_is_refused_until_its_table_is_active(short_rig):
    _, rig = short_rig
    rig.enable()
    write(rig, flat_table(0.0))
    rig.move(CENTRE, 0.2)
    rig.change_payload(1)
    with pytest.raises(SdoRefused):
        rig.move(CENTRE + 0.01, 0.2)
    np.testing.assert_allclose(rig.positions_m(), CENTRE, atol=1e-7)
    states = write(rig, flat_table(200.0))
    assert all(state.valid for state in states)
    rig.move(CENTRE + 0.01, 0.2)
    np.testing.assert_allclose(rig.positions_m(), CENTRE + 0.01, atol=1e-7)


def test_a_set_point_outside_the_grid_is_refused_and_nothing_moves(short_rig):
    _, rig = short_rig
    rig.enable()
    write(rig, flat_table(0.0))
    rig.move(CENTRE, 0.2)
    with pytest.raises(SdoRefused):
        rig.move(np.array([1.118, 1.32]), 0.2)
    np.testing.assert_allclose(rig.positions_m(), CENTRE, atol=1e-7)


def test_an_open_interlock_stops_both_drives_in_motion(short_rig):
    mock, rig = short_rig
    rig.enable()
    rig.clock.call_at(rig.clock.now_s() + 0.4, lambda: mock.plc.set_interlock(0, False))
    with pytest.raises(DeviceError):
        rig.move(CENTRE + 0.4, 0.1)
    assert isinstance(rig.supervisor.trip, InterlockOpen)
    assert "guard closed" in str(rig.supervisor.trip)
    rig.clock.sleep_s(2.0)
    before = [drive.encoder_m(rig.clock.now_s()) for drive in mock.drives]
    rig.clock.sleep_s(2.0)
    assert before == [drive.encoder_m(rig.clock.now_s()) for drive in mock.drives]
    assert max(before) < 1.118 + 0.2
    with pytest.raises(InterlockOpen):
        rig.move(CENTRE, 0.1)


def test_a_rig_with_an_open_interlock_is_not_even_connected():
    file, machine = short_rig_file()
    with pytest.raises(InterlockOpen, match="air pressure"):
        _connect_with_fault(file, machine)


def _connect_with_fault(file, machine):
    from pkm_rig.rig.config import embedded_rig_path  # noqa: PLC0415
    from pkm_rig.rig.connection import connect_rig  # noqa: PLC0415
    from pkm_rig.virtual.mock_rig import embedded_mock_rig  # noqa: PLC0415

    with embedded_mock_rig(file, embedded_rig_path()) as mock, mock.clock.activity():
        mock.mock.plc.set_interlock(3, False)
        with connect_rig(mock.file, machine, mock.clock, mock.bus_factory):
            pass


def test_a_wrong_node_id_names_the_node(monkeypatch):
    monkeypatch.setattr("pkm_rig.rig.connection.EMBEDDED_GUARD_S", 1.0)
    file, machine = short_rig_file()
    drives = (file.drives[0], file.drives[1].model_copy(update={"node_id": 9}))
    with pytest.raises(ConnectionFailed, match="9"), mock_and_rig(file.model_copy(update={"drives": drives}), machine):
        pass


def test_wrong_units_are_refused():
    file, machine = short_rig_file()
    drives = (file.drives[0], file.drives[1].model_copy(update={"metres_per_increment": 2e-8}))
    with pytest.raises(IdentityMismatch), mock_and_rig(file.model_copy(update={"drives": drives}), machine):
        pass


def test_leaving_a_rig_leaves_the_drives_without_power():
    file, machine = short_rig_file()
    with mock_and_rig(file, machine) as (mock, rig):
        rig.enable()
        powered = [drive.axis.powered for drive in mock.drives]
        drives = mock.drives
    assert powered == [True, True]
    assert [drive.axis.powered for drive in drives] == [False, False]


def test_in_plane_uncertainty_grows_when_the_station_looks_from_the_side():
    file, machine = short_rig_file()
    good = in_plane_u_m(file, machine)
    aside = file.station.model_copy(update={"position_m": (2.9, 0.3, 1.2)})
    assert good < 10e-6
    assert in_plane_u_m(file.model_copy(update={"station": aside}), machine) > 2.0 * good


def test_drives_without_a_table_bank_can_be_moved_but_not_compensated():
    file, machine = short_rig_file()
    drives = tuple(drive.model_copy(update={"profile": "plain-402"}) for drive in file.drives)
    with mock_and_rig(file.model_copy(update={"drives": drives}), machine) as (_, rig):
        rig.enable()
        rig.move(np.array([1.15, 1.10]), 0.2)
        rig.compensate(None)
        with pytest.raises(TableError, match="no table bank"):
            rig.compensate(rig.images(flat_table(0.0, 0.0), rig.next_generation()))
