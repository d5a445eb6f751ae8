"""Every bit of an answer turned over, at every position, for every call that the driver makes.

The real session on the mock station's own answers, without a port between them.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import serial
from geocompy.geo.gcdata import ATR, EDMModeV2, Inclination, Measurement, Position, Prism

from drivers.errors import DeviceError
from drivers.station.geocom import GeoComSession, StationLine
from drivers.station.laser_tracker import LaserTracker, cartesian_to_polar
from drivers.station.single_measurement import read_angles
from mock_devices.plant.plant import Plant
from mock_devices.settings import MockSettings
from mock_devices.station.mock_station import MockStation
from tests.drivers.mock_rig_bench import MACHINE
from tests.drivers.scripted import CountingClock
from tests.drivers.station.memory_port import MemoryPort
from tests.mock_devices.standing import StandingPlant

FLOOR_NEST_M = (-0.80, -1.10, 0.10)
GUARD_S = 0.002  # host time; bytes are there at once, and what a flip made of the line is waited for in vain
LINE = StationLine(reply_timeout_s=GUARD_S, motion_timeout_s=GUARD_S, busy_limit_s=0.0)


def _direction() -> tuple[float, float]:
    dx, dy, dz = (p - s for p, s in zip(FLOOR_NEST_M, MockSettings().station_position_m, strict=True))
    hz, v, _ = cartesian_to_polar(dx, -dz, dy)
    return hz, v


def _asks(get: Callable[[GeoComSession], Callable[[], Any]], **how: bool) -> Callable[[GeoComSession], object]:
    return lambda session: session.ask(get(session), **how)


def _commands(get: Callable[[GeoComSession], Callable[[], Any]]) -> Callable[[GeoComSession], object]:
    return lambda session: session.command(get(session), idempotent=True)


HZ, V = _direction()
CALLS: dict[int, Callable[[GeoComSession], object]] = {
    0: _asks(lambda s: s.geocom.com.nullprocess, values=False),
    107: _asks(lambda s: lambda: s.geocom.com.set_double_precision(15), values=False),
    108: _asks(lambda s: s.geocom.com.get_double_precision),
    110: _asks(lambda s: s.geocom.com.get_geocom_version),
    5003: _asks(lambda s: s.geocom.csv.get_serial_number),
    5004: _asks(lambda s: s.geocom.csv.get_instrument_name),
    5034: _asks(lambda s: s.geocom.csv.get_firmware_version),
    2020: _asks(lambda s: lambda: s.geocom.tmc.set_edm_mode_v2(EDMModeV2.SINGLE_STANDARD), values=False),
    2021: _asks(lambda s: s.geocom.tmc.get_edm_mode_v2),
    2023: _asks(lambda s: s.geocom.tmc.get_prism_correction),
    2024: _asks(lambda s: s.call(2024, 0.0), values=False),
    2026: _asks(lambda s: s.geocom.tmc.get_face),
    2028: _asks(lambda s: s.call(2028, 658e-9, 1013.25, 20.0, 15.0), values=False),
    2029: _asks(lambda s: s.geocom.tmc.get_atmospheric_corrections),
    2151: _asks(lambda s: s.geocom.tmc.get_atmospheric_correction_ppm),
    6021: _asks(lambda s: s.geocom.mot.get_lockon_status, changing=True),
    17008: _asks(lambda s: lambda: s.geocom.bap.set_prism_type(Prism.MINI), values=False),
    17009: _asks(lambda s: s.geocom.bap.get_prism_type),
    18007: _asks(lambda s: lambda: s.geocom.aus.switch_user_lock(True), values=False),
    9013: _commands(lambda s: s.geocom.aut.lock_in),
    9027: _commands(lambda s: s.call(9027, HZ, V, Position.NORMAL.value, ATR.POSITION.value, 0)),
    9028: _commands(lambda s: lambda: s.geocom.aut.change_face(Position.NORMAL, ATR.POSITION)),
    9029: _commands(lambda s: s.call(9029, 0.1, 0.1, 0)),
    9037: _commands(lambda s: s.call(9037, 0.1, 0.1, 0)),
    2008: _commands(lambda s: lambda: s.geocom.tmc.do_measurement(Measurement.DISTANCE, Inclination.AUTO)),
    2107: read_angles,
    2108: lambda s: s.ask_flagged(lambda: s.geocom.tmc.get_simple_measurement(5)),
    2167: lambda s: s.ask_flagged(lambda: s.geocom.tmc.get_complete_measurement(5, Inclination.AUTO)),
}


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> MemoryPort:
    """A station in front of a machine that stands, on whatever port is opened."""
    standing = StandingPlant(Plant(Path(MACHINE), MockSettings(seed=3), CountingClock()))
    port = MemoryPort(MockStation(standing.plant))
    monkeypatch.setattr(serial, "serial_for_url", lambda *_args, **_settings: port)
    return port


@pytest.fixture
def session(port: MemoryPort) -> GeoComSession:
    """A session that has agreed on checksums, the station aimed at a nest, locked to it and measured."""
    session = GeoComSession("station", "memory", CountingClock(), StationLine())
    assert session.agree_on_checksums()
    for rpc in (107, 9027, 9037, 18007, 9013, 2008, 2167):
        CALLS[rpc](session)
    session.close()
    return _again(session, True)


def _again(session: GeoComSession, checksums: bool, line: StationLine = LINE) -> GeoComSession:
    again = GeoComSession("station", "memory", CountingClock(), line, first_transaction=session.next_transaction)
    again.geocom.uses_checksums = checksums
    return again


def _spoilt(session: GeoComSession, port: MemoryPort, rpc: int) -> list[str]:
    """What came of each bit of one answer: only a wrong value or another exception than the driver's is listed."""
    good = CALLS[rpc](_again(session, session.uses_checksums, StationLine()))  # a busy computer gets its time here
    length, wrong = len(port.answers[-1]), []
    for at in range(length):
        for bit in range(8):
            port.flip = (at, bit)
            try:
                value = CALLS[rpc](session)
            except DeviceError:
                continue
            except Exception as error:
                wrong.append(f"{type(error).__name__} at byte {at}, bit {bit}")
            else:
                if value != good:
                    wrong.append(f"{value} for {good} at byte {at}, bit {bit}")
            assert port.flip is None
    return wrong


@pytest.mark.parametrize("rpc", CALLS)
def test_a_bit_of_an_answer_with_checksum_is_never_taken_for_another_value(
    session: GeoComSession, port: MemoryPort, rpc: int
) -> None:
    assert _spoilt(session, port, rpc) == []


@pytest.mark.parametrize("rpc", CALLS)
def test_nor_is_one_without_checksum_as_values_are_read_twice(
    session: GeoComSession, port: MemoryPort, rpc: int
) -> None:
    changing = rpc in (2107, 6021)  # read once: docs/reference/devices.md
    wrong = _spoilt(_again(session, False), port, rpc)
    assert bool(wrong) == changing
    assert not [what for what in wrong if " for " not in what]


def test_these_are_all_calls_that_the_driver_makes(port: MemoryPort) -> None:
    tracker = LaserTracker("memory", CountingClock(), line=StationLine())
    tracker.connect()
    tracker.set_atmosphere(21.0, 990.0, 0.5)
    tracker.require_settings()
    tracker.point_and_aim(HZ, V, 0.1)
    tracker.search(0.1)
    tracker.lock()
    tracker.keep_lock(HZ, V)
    tracker.measure(two_face=True)
    tracker.measure_averaged()
    tracker.read_angles()
    tracker.unlock()
    tracker.stop()
    assert set(port.calls) | {2108} == set(CALLS)
