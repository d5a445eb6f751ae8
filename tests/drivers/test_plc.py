"""The PLC's driver against a real Modbus server in the same process."""

from __future__ import annotations

import asyncio
import math
import socket
import struct
import threading
from collections.abc import Iterator

import pytest
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice
from scripted import CountingClock

from drivers.errors import ConnectionFailed, InterlockOpen, NoAnswer, PlcError, StaleData
from drivers.plc import Plc
from drivers.plc_registers import Register, RegisterMap, decode

VALUES = {4: 20.5, 6: 21.0, 8: 22.0, 10: 19.0, 12: 20.0, 14: 1002.5, 16: 45.0}


class ModbusPlc:
    """The registers of docs/plc.md. The heartbeat counts reads; a payload takes `delay` polls."""

    def __init__(self) -> None:
        with socket.create_server(("127.0.0.1", 0)) as probe:
            self.port: int = probe.getsockname()[1]
        self.words = [0] * 60
        self.words[1] = 0b1111
        for address, value in VALUES.items():
            self.put(address, value)
        self.beating = True
        self.result = 0
        self.delay = 3
        self.writes: list[list[int]] = []
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self._call(self._listen())

    def put(self, address: int, value: float) -> None:
        self.words[address : address + 2] = struct.unpack(">HH", struct.pack(">f", value))

    def close(self) -> None:
        self.hang_up()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(5.0)
        self._loop.close()

    def hang_up(self) -> None:
        self._call(self._server.shutdown())

    def _call(self, work: object) -> None:
        asyncio.run_coroutine_threadsafe(work, self._loop).result(5.0)  # type: ignore[arg-type]

    async def _listen(self) -> None:
        data = SimData(0, count=60, values=0, datatype=DataType.REGISTERS)
        self._server = ModbusTcpServer(SimDevice(1, simdata=[data], action=self._act), address=("127.0.0.1", self.port))
        await self._server.listen()

    async def _act(
        self, _code: int, _block: int, start: int, count: int, registers: list[int], values: list[int] | None
    ) -> None:
        if values:
            self.writes.append(list(values))
            self.words[start : start + count] = values
            self.words[34], self.words[35] = self.words[31], 2
        else:
            self._step()
        registers[start : start + count] = self.words[start : start + count]

    def _step(self) -> None:
        if self.beating:
            self.words[0] = (self.words[0] + 1) & 0xFFFF
        if self.words[35] == 2:
            self.delay -= 1
            if self.delay <= 0:
                self.words[35] = self.result
                self.words[2] = self.words[33] if self.result == 0 else self.words[2]


@pytest.fixture
def server() -> Iterator[ModbusPlc]:
    server = ModbusPlc()
    yield server
    server.close()


@pytest.fixture
def plc(server: ModbusPlc) -> Iterator[Plc]:
    plc = Plc("127.0.0.1", server.port, clock=CountingClock(), reply_timeout_s=0.5)
    yield plc
    plc.close()


def test_read(plc: Plc) -> None:
    state = plc.connect()
    assert state.heartbeat_fresh
    assert state.temperatures_c == pytest.approx(
        {"air": 20.5, "struts": 21.0, "columns": 22.0, "base": 19.0, "platform": 20.0}
    )
    assert (state.pressure_hpa, state.humidity, state.payload) == pytest.approx((1002.5, 0.45, 0))
    assert all(state.interlocks.values())
    state.require_safe()


def test_an_open_interlock_is_named(server: ModbusPlc, plc: Plc) -> None:
    server.words[1] = 0b1010
    with pytest.raises(InterlockOpen, match="guard closed, drive power on"):
        plc.connect().require_safe()


def test_a_heartbeat_that_never_moves(server: ModbusPlc, plc: Plc) -> None:
    server.beating = False
    with pytest.raises(StaleData, match="stands still"):
        plc.connect()


def test_a_heartbeat_that_stops_opens_the_interlocks(server: ModbusPlc, plc: Plc) -> None:
    plc.connect()
    server.beating = False
    clock = plc._clock
    plc.read()
    clock.sleep_s(0.5)
    assert plc.read().heartbeat_fresh
    clock.sleep_s(1.0)
    state = plc.read()
    assert not state.heartbeat_fresh
    assert not any(state.interlocks.values())
    with pytest.raises(StaleData):
        state.require_safe()
    server.beating = True
    assert plc.read().heartbeat_fresh


@pytest.mark.parametrize("value", [math.nan, math.inf, 200.0, -30.0])
def test_a_temperature_that_cannot_be(server: ModbusPlc, plc: Plc, value: float) -> None:
    server.put(6, value)
    with pytest.raises(PlcError, match="struts temperature"):
        plc.connect()


def test_a_payload_is_requested_once(server: ModbusPlc, plc: Plc) -> None:
    plc.connect()
    assert plc.request_payload(2).payload == 2
    assert server.writes == [[1, 1, 2]]
    plc.request_payload(1)
    assert server.writes[1:] == [[2, 1, 1]]


def test_a_refused_payload(server: ModbusPlc, plc: Plc) -> None:
    plc.connect()
    server.result = 1
    with pytest.raises(PlcError, match="payload 7 is refused"):
        plc.request_payload(7)


def test_a_payload_that_never_comes(server: ModbusPlc, plc: Plc) -> None:
    plc.connect()
    server.delay = 1000
    with pytest.raises(PlcError, match="not on after 2 s"):
        plc.request_payload(1, limit_s=2.0)


def test_a_payload_being_changed_is_none(server: ModbusPlc, plc: Plc) -> None:
    server.words[2] = 0xFFFF
    assert plc.connect().payload is None


def test_the_connection_is_lost_and_comes_back(server: ModbusPlc, plc: Plc) -> None:
    plc.connect()
    server.hang_up()
    with pytest.raises((NoAnswer, ConnectionFailed)):
        plc.read()
    server._call(server._listen())
    assert plc.read().pressure_hpa == pytest.approx(1002.5)


def test_nobody_listens() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    with pytest.raises(ConnectionFailed, match="no connection"):
        Plc("127.0.0.1", port, clock=CountingClock(), reply_timeout_s=0.2).connect()


def test_a_peer_that_does_not_answer() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        plc = Plc("127.0.0.1", listener.getsockname()[1], clock=CountingClock(), reply_timeout_s=0.05)
        with pytest.raises(NoAnswer, match="no answer"):
            plc.connect()


def test_a_wrong_unit(server: ModbusPlc) -> None:
    plc = Plc("127.0.0.1", server.port, unit=9, clock=CountingClock(), reply_timeout_s=0.2)
    with pytest.raises((NoAnswer, PlcError)):
        plc.connect()


def test_registers_may_move() -> None:
    moved = RegisterMap(
        heartbeat=100,
        interlocks=101,
        payload=102,
        temperatures_c={"air": Register(110, 0.0, 50.0)},
        pressure_hpa=Register(112, 0.0, 2000.0),
        humidity_percent=Register(114, 0.0, 100.0),
    )
    assert (moved.first, moved.count) == (100, 16)
    words = [5, 1, 3] + [0] * 7 + [0x41A0, 0, 0x447A, 0, 0x4248, 0]
    state = decode(moved, words, True, (0.0, 0.0))
    assert (state.payload, state.temperatures_c["air"], state.pressure_hpa, state.humidity) == (
        3,
        20.0,
        1000.0,
        0.5,
    )
    assert state.open_interlocks() == ["emergency stop released", "drive power on", "air pressure"]
    with pytest.raises(PlcError, match="registers instead of"):
        decode(moved, words[:-1], True, (0.0, 0.0))
    with pytest.raises(ValueError, match="span"):
        RegisterMap(heartbeat=500)
