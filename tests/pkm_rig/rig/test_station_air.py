"""The station's air follows the PLC's over the real protocols, between points and from good values only."""

from __future__ import annotations

import pytest

from drivers.errors import SettingsChanged, StaleData
from drivers.station.atmosphere import atmospheric_ppm
from mock_devices.faults import Fault, FaultPlan
from pkm_rig.rig.config import embedded_rig_path
from pkm_rig.rig.connection import connect_rig
from pkm_rig.rig.devices import ReadingTags, StationDevice
from pkm_rig.rig.worker import Worker
from pkm_rig.virtual.mock_rig import embedded_mock_rig
from tests.pkm_rig.conftest import mock_and_rig, short_rig_file

WARMER = ((0.0, 0.0), (600.0, 0.0), (601.0, 3.0), (90000.0, 3.0))


def rig_file(programme=(), **limits):
    file, machine = short_rig_file()
    mock = file.mock.model_copy(update={"temperature_programme": programme})
    return file.model_copy(update={"mock": mock, "limits": file.limits.model_copy(update=limits)}), machine


def held(mock):
    """Pressure and dry temperature that the station corrects for."""
    air = mock.station_server._station.telescope.air
    return air.pressure_hpa, air.dry_c


def counted(mock):
    """A list that grows with each time that the station is given its air."""
    station, given = mock.station_server._station, []
    kinds, set_air = station._calls[2028]
    station._calls[2028] = (kinds, lambda *air: (given.append(air), set_air(*air))[1])
    return given


def test_what_is_old_is_set_anew_and_what_is_not_is_left_alone():
    with mock_and_rig(*rig_file(atmosphere_ppm=1000.0)) as (mock, rig):
        rig.refresh_atmosphere_if_stale()
        state = rig.supervisor.state()
        assert held(mock) == pytest.approx((state.pressure_hpa, state.temperatures_c["air"]), abs=1e-3)
        given = counted(mock)
        rig.clock.sleep_s(250.0)
        rig.refresh_atmosphere_if_stale()
        assert given == []
        rig.clock.sleep_s(60.0)
        rig.refresh_atmosphere_if_stale()
        assert len(given) == 1
        assert held(mock)[1] == pytest.approx(rig.supervisor.state().temperatures_c["air"], abs=1e-3)


def test_air_that_has_become_another_is_set_before_its_age_asks_for_it():
    with mock_and_rig(*rig_file(WARMER, atmosphere_age_s=1e6)) as (mock, rig):
        rig.refresh_atmosphere_if_stale()
        before_ppm, before_c = rig.station.ppm, held(mock)[1]
        rig.clock.sleep_s(1500.0)
        rig.refresh_atmosphere_if_stale()
        assert held(mock)[1] - before_c > 2.0
        state = rig.supervisor.state()
        wanted_ppm = atmospheric_ppm(state.temperatures_c["air"], state.pressure_hpa, state.humidity)
        assert rig.station.ppm == pytest.approx(wanted_ppm, abs=0.01)
        assert rig.station.ppm - before_ppm > 2.0


def test_a_stale_plc_gives_no_air():
    file, machine = rig_file()
    plan = FaultPlan()
    path = embedded_rig_path()
    with (
        embedded_mock_rig(file, path, faults=plan) as mock,
        mock.clock.activity(),
        connect_rig(mock.file, machine, mock.clock, mock.bus_factory) as rig,
    ):
        rig.refresh_atmosphere_if_stale()
        given = counted(mock.mock)
        plan.arm([Fault("modbus-stale-heartbeat", 1)])
        rig.clock.sleep_s(400.0)
        with pytest.raises(StaleData):
            rig.refresh_atmosphere_if_stale()
        assert given == []


def test_after_a_failure_the_next_point_sets_it_again():
    with mock_and_rig(*rig_file()) as (mock, rig):
        rig.refresh_atmosphere_if_stale()
        station = mock.station_server._station
        station.respond(b"%R1Q,17008,0:2")
        with pytest.raises(SettingsChanged, match="prism_type"):
            rig.refresh_atmosphere()
        station.respond(b"%R1Q,17008,0:1")
        station.respond(b"%R1Q,2024,0:0.0")
        given = counted(mock)
        rig.refresh_atmosphere_if_stale()
        assert len(given) == 1


def test_air_that_somebody_sets_at_the_station_is_noticed():
    with mock_and_rig(*rig_file()) as (mock, rig):
        rig.refresh_atmosphere_if_stale()
        mock.station_server._station.telescope.air.dry_c = -30.0
        with pytest.raises(SettingsChanged, match="air"):
            rig.refresh_atmosphere()


def test_a_campaign_keeps_it_between_its_points():
    with mock_and_rig(*rig_file(WARMER)) as (_, rig):
        worker = Worker()
        station = StationDevice(rig, worker, ReadingTags())
        told = []
        for _ in range(2):
            for job in (station.set("N1"), station.trigger()):
                assert job.exception(60.0) is None
            told.append(station.read()["ppm"]["value"])
            rig.clock.sleep_s(1500.0)
        worker.close()
        assert told[1] - told[0] > 2.0
        assert rig.supervisor.trip is None
