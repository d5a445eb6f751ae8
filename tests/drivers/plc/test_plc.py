"""The PLC's driver against a real Modbus server in the same process."""

from __future__ import annotations

import asyncio
import math
import socket
import struct
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from drivers.errors import ConnectionFailed, InterlockOpen, NoAnswer, PlcError, StaleData
from drivers.plc.modbus_line import TcpLine
from drivers.plc.plc import Plc, PlcTiming
from drivers.plc.plc_registers import ReadingRegister, Register, RegisterMap, decode
from tests.drivers.scripted import CountingClock, TickingClock
from tests.either import either

VALUES = {4: 20.5, 6: 21.0, 8: 22.0, 10: 19.0, 12: 20.0, 14: 1002.5, 16: 45.0}


class ModbusPlc:
    """The registers of docs/reference/plc.md. The heartbeat counts reads; a payload takes `delay` polls."""

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
        self.beats: list[int] = []
        self.stuck = 0
        self.words[36] = 1
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self._call(self._listen())

    def put(self, address: int, value: float) -> None:
        self.words[address : address + 2] = struct.unpack(">HH", struct.pack(">f", value))

    def close(self) -> None:
        self.hang_up()
        self._call(_end_other_tasks())
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
        if values and start == 30:  # our heartbeat; the block is read in the same request
            self.beats.append(values[0])
            return
        if values:
            self.writes.append(list(values))
            self.words[start : start + count] = values
            self.words[34], self.words[35] = self.words[31], 2
        else:
            self._step()
        self.words[3] = self.words[1] ^ 0xFFFF ^ self.stuck
        registers[start : start + count] = self.words[start : start + count]

    def _step(self) -> None:
        if self.beating:
            self.words[0] = (self.words[0] + 1) & 0xFFFF
        if self.words[35] == 2:
            self.delay -= 1
            if self.delay <= 0:
                self.words[35] = self.result
                self.words[2] = self.words[33] if self.result == 0 else self.words[2]


async def _end_other_tasks() -> None:
    """The library's server leaves its handlers waiting; a task that is destroyed then complains in a later test."""
    tasks = asyncio.all_tasks() - {asyncio.current_task()}
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


@pytest.fixture
def server() -> Iterator[ModbusPlc]:
    server = ModbusPlc()
    yield server
    server.close()


@pytest.fixture
def plc(server: ModbusPlc) -> Iterator[Plc]:
    plc = Plc(TcpLine("127.0.0.1", server.port), clock=CountingClock(), timing=PlcTiming(reply_timeout_s=0.5))
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


def test_a_state_is_dated_within_its_request(server: ModbusPlc) -> None:
    clock = TickingClock()
    plc = Plc(TcpLine("127.0.0.1", server.port), clock=clock)
    plc.connect()
    begin_s, begin_host_s = clock.now_s(), time.monotonic()
    state = plc.read()
    end_s, end_host_s = clock.now_s(), time.monotonic()
    plc.close()
    assert begin_s < state.t_rig_s < end_s
    assert begin_host_s <= state.t_host_s <= end_host_s


@pytest.mark.parametrize(
    ("field", "change", "jumps"),
    [("pressure_hpa", 5.9, False), ("pressure_hpa", -6.1, True), ("humidity", 0.009, False), ("humidity", 0.011, True)],
)
def test_a_value_jumps_by_a_hundredth_of_its_range(plc: Plc, field: str, change: float, jumps: bool) -> None:
    """500 to 1100 hPa, 0 to 100 %."""
    state = plc.connect()
    later = replace(state, **{field: getattr(state, field) + change})
    assert (plc.map.jump(state, later) is not None) is jumps


def test_an_open_interlock_is_named(server: ModbusPlc, plc: Plc) -> None:
    server.words[1] = 0b1010
    with pytest.raises(InterlockOpen, match="guard closed, drive power on"):
        plc.connect().require_safe()


def test_a_heartbeat_that_never_moves(server: ModbusPlc, plc: Plc) -> None:
    server.beating = False
    with pytest.raises(StaleData, match="stands still"):
        plc.connect()


def test_a_heartbeat_that_moved_in_a_former_connection_does_not_count(server: ModbusPlc, plc: Plc) -> None:
    plc.connect()
    plc.close()
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
        Plc(TcpLine("127.0.0.1", port), clock=CountingClock(), timing=PlcTiming(reply_timeout_s=0.2)).connect()


def test_a_peer_that_does_not_answer() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        plc = Plc(
            TcpLine("127.0.0.1", listener.getsockname()[1]),
            clock=CountingClock(),
            timing=PlcTiming(reply_timeout_s=0.5),
        )
        with pytest.raises(NoAnswer, match="no answer"):
            plc.connect()


def test_leaving_during_a_request_waits_for_its_end() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:  # answers nothing
        port = listener.getsockname()[1]
        plc = Plc(TcpLine("127.0.0.1", port), clock=CountingClock(), timing=PlcTiming(reply_timeout_s=0.5))
        failures: list[Exception] = []

        def connect() -> None:
            try:
                plc.connect()
            except Exception as error:
                failures.append(error)

        connecting = threading.Thread(target=connect)
        connecting.start()
        while not plc._lock.locked() and connecting.is_alive():
            pass
        plc.close()
        connecting.join()
    assert [type(error) for error in failures] == [NoAnswer]


def test_a_wrong_unit(server: ModbusPlc) -> None:
    plc = Plc(TcpLine("127.0.0.1", server.port), unit=9, clock=CountingClock(), timing=PlcTiming(reply_timeout_s=0.2))
    with pytest.raises((NoAnswer, PlcError)):
        plc.connect()


def test_registers_may_move() -> None:
    moved = RegisterMap(
        interlocks_inverted=None,
        master_heartbeat=None,
        master_seen=None,
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


def test_a_stuck_bit_is_noticed(server: ModbusPlc, plc: Plc) -> None:
    plc.connect()
    server.stuck = 0b0001
    with pytest.raises(PlcError, match="a bit is stuck"):
        plc.read()


def test_our_heartbeat_goes_with_the_reads_and_a_plc_that_does_not_see_it_is_not_safe(
    server: ModbusPlc, plc: Plc
) -> None:
    plc.connect()
    for _ in range(4):
        plc._clock.sleep_s(0.3)
        plc.read().require_safe()
    assert server.beats == sorted(set(server.beats))
    assert len(server.beats) >= 5
    server.words[36] = 0
    with pytest.raises(StaleData, match="does not see our heartbeat"):
        plc.read().require_safe()


def test_a_sensor_that_stands_still_is_old(server: ModbusPlc) -> None:
    air = Register(4, -20.0, 60.0, stale_s=10.0)
    registers = RegisterMap(temperatures_c={"air": air})
    plc = Plc(
        TcpLine("127.0.0.1", server.port),
        register_map=registers,
        clock=CountingClock(),
        timing=PlcTiming(reply_timeout_s=0.5),
    )
    plc.connect()
    for celsius in (20.6, 20.7, 20.8):
        plc._clock.sleep_s(8.0)
        server.put(4, celsius)
        plc.read()
    plc._clock.sleep_s(8.0)
    plc.read()
    plc._clock.sleep_s(8.0)
    with pytest.raises(StaleData, match="air temperature has not changed for 16 s"):
        plc.read()
    plc.close()


FLOW = ReadingRegister(40, low=2.0, high=20.0, type="u16", scale=0.01, offset=-4.0, unit="l/min")


def test_a_further_reading_has_its_own_unit_range_and_age(server: ModbusPlc) -> None:
    registers = RegisterMap(readings={"coolant flow": replace(FLOW, stale_s=10.0)})
    plc = Plc(
        TcpLine("127.0.0.1", server.port),
        register_map=registers,
        clock=CountingClock(),
        timing=PlcTiming(reply_timeout_s=0.5),
    )
    server.words[40] = 1250
    assert plc.connect().readings == {"coolant flow": pytest.approx(8.5)}
    server.words[40] = 599
    with pytest.raises(PlcError, match=r"register 40\): coolant flow of 1.99 is outside 2 to 20"):
        plc.read()
    server.words[40] = 1251
    plc.read()
    plc._clock.sleep_s(12.0)
    with pytest.raises(StaleData, match=r"register 40\): coolant flow has not changed for 12 s"):
        plc.read()
    plc.close()


def test_a_register_that_the_plc_does_not_have_is_refused_in_one_line(server: ModbusPlc) -> None:
    registers = RegisterMap(readings={"coolant flow": replace(FLOW, address=60)})
    plc = Plc(
        TcpLine("127.0.0.1", server.port),
        register_map=registers,
        clock=CountingClock(),
        timing=PlcTiming(reply_timeout_s=0.5),
    )
    with pytest.raises(PlcError, match=r"registers 0 to 60.*refused.*check the register map") as caught:
        plc.connect()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["", "humidity", "air temperature"])
def test_a_further_reading_needs_a_name_of_its_own(name: str) -> None:
    with pytest.raises(ValueError, match="cannot be called"):
        RegisterMap(readings={name: FLOW})


def test_further_readings_count_towards_the_length_of_the_block() -> None:
    with pytest.raises(ValueError, match="span 126 registers"):
        RegisterMap(readings={"coolant flow": replace(FLOW, address=125)})


@pytest.mark.parametrize(
    ("register", "words", "value"),
    [
        (Register(0, -1e9, 1e9), [0x41A4, 0x0000], 20.5),
        (Register(0, -1e9, 1e9, order="CDAB"), [0x0000, 0x41A4], 20.5),
        (Register(0, -1e9, 1e9, order="BADC"), [0xA441, 0x0000], 20.5),
        (Register(0, -1e9, 1e9, order="DCBA"), [0x0000, 0xA441], 20.5),
        (Register(0, -1e9, 1e9, type="i16", scale=0.1), [0xFF38], -20.0),
        (Register(0, -1e9, 1e9, type="u16", scale=0.01, unit="K"), [29365], 20.5),
        (Register(0, -1e9, 1e9, type="u16", order="BADC"), [0x0100], 1.0),
        (Register(0, -1e9, 1e9, type="u32", unit="Pa"), [1, 0x8BCD], 1013.25),
        (Register(0, -1e9, 1e9, type="i32", scale=0.001, order="CDAB"), [0xB1E0, 0xFFFF], -20.0),
        (Register(0, -1e9, 1e9, unit="1"), [0x3EE6, 0x6666], 45.0),
    ],
)
def test_types_orders_scales_and_units(register: Register, words: list[int], value: float) -> None:
    assert register.value(words) == pytest.approx(value)


@pytest.mark.parametrize(
    "wrong", [{"unit": "F"}, {"scale": 0.0}, {"low": 1.0, "high": 0.0}, {"address": 70000}, {"offset": math.nan}]
)
def test_registers_that_cannot_be(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="is invalid"):
        Register(**{"address": 0, "low": 0.0, "high": 1.0, **wrong})


@given(st.lists(st.integers(0, 0xFFFF), max_size=40), st.booleans())
def test_any_words_are_a_state_or_a_plc_error(words: list[int], fresh: bool) -> None:
    registers = RegisterMap()
    state, complaint = either(lambda: decode(registers, words, fresh, (0.0, 0.0)), PlcError)
    if state is not None:
        assert fresh or not any(state.interlocks.values())
        assert all(-20.0 <= value <= 60.0 for value in state.temperatures_c.values())
    else:
        assert complaint is not None
        assert complaint.startswith("PLC")


def test_a_value_ages_by_its_own_register_wherever_the_block_begins() -> None:
    clock = CountingClock()
    places = {"air": Register(104, -20.0, 60.0, stale_s=10.0), "base": Register(106, -20.0, 60.0)}
    registers = RegisterMap(
        heartbeat=100, interlocks=101, payload=102, interlocks_inverted=None, temperatures_c=places,
        pressure_hpa=Register(108, 500.0, 1100.0), humidity_percent=Register(110, 0.0, 100.0), master_heartbeat=None,
        master_seen=None, sequence=131, sequence_taken=134,
    )  # fmt: skip
    plc = Plc(TcpLine("127.0.0.1", 1), clock=clock, register_map=registers)
    words = [7] * 12
    for number in range(4):  # it changes every 8 s, all others never
        words[5] = number
        plc._refuse_old_values(list(words), clock.now_s())
        clock.sleep_s(8.0)
    with pytest.raises(StaleData, match="air temperature has not changed for 11 s"):
        plc._refuse_old_values(list(words), clock.now_s() + 3.0)
