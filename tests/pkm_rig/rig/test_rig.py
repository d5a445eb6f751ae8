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


def test_a_table_by_direction_moves_the_encoder_by_the_side_it_comes_from(short_rig):
    mock, rig = short_rig
    rig.enable()
    table = flat_table(0.0).with_reversals(rig.machine, np.array([30e-6, 0.0]))
    write(rig, table)
    for bank, up_m in zip(rig.banks, (15e-6, 0.0), strict=True):
        assert bank.read_image(bank.state().active).up_m == pytest.approx(up_m)
    for from_m, added_m in ((-0.02, 65e-6), (0.02, 35e-6)):
        rig.move(CENTRE + from_m, 0.2)
        rig.move(CENTRE, 0.2)
        np.testing.assert_allclose(rig.positions_m(), CENTRE, atol=1e-7)
        encoders = [drive.encoder_m(rig.clock.now_s()) for drive in mock.drives]
        np.testing.assert_allclose(encoders, CENTRE + np.array([added_m, 50e-6]), atol=1e-7)


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


def reflectors_m(mock, rig):
    """Where the plant has the platform's reflectors (n, 3), without noise, in the station's frame."""
    seen = [s.polar for s in mock.plant.sightings(rig.clock.now_s()) if s.name.startswith("P")]
    across = [p.distance_m * np.sin(p.v_rad) for p in seen]
    return np.array(
        [
            (a * np.sin(p.hz_rad), a * np.cos(p.hz_rad), p.distance_m * np.cos(p.v_rad))
            for a, p in zip(across, seen, strict=True)
        ]
    )


def test_a_table_by_direction_takes_the_plants_backlash_away():
    file, machine = short_rig_file()
    backlash = ("backlash=3e-5,place=left", "backlash=2e-5,place=right")
    file = file.model_copy(update={"mock": file.mock.model_copy(update={"effects": backlash})})
    apart_m = {}
    with mock_and_rig(file, machine) as (mock, rig):
        rig.enable()
        for kind, table in (
            ("single", flat_table(0.0)),
            ("by direction", flat_table(0.0).with_reversals(machine, np.array([3e-5, 2e-5]))),
        ):
            write(rig, table)
            seen = []
            for from_m in (-0.01, 0.01):
                rig.move(CENTRE + from_m, 0.2)
                rig.move(CENTRE, 0.2)
                seen.append(reflectors_m(mock, rig))
            apart_m[kind] = np.linalg.norm(seen[1] - seen[0], axis=1).max()
    assert apart_m["single"] > 2e-5
    assert apart_m["by direction"] < 1e-6  # what the station has drifted meanwhile
