"""Another client on the same PLC, and values that jump: what only we write is compared, jumps are read twice."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from pymodbus.client import ModbusTcpClient

from drivers.errors import OtherMaster, PlcError
from drivers.plc.modbus_line import TcpLine
from drivers.plc.own_words import OwnWords
from drivers.plc.plc import Plc, PlcTiming
from drivers.plc.plc_registers import RegisterMap
from tests.drivers.mock_rig_bench import Bench, mock_rigs

TIMING = PlcTiming(reply_timeout_s=5.0)


@pytest.fixture
def bench() -> Iterator[Bench]:
    yield from mock_rigs("one process")


@pytest.fixture
def plc(bench: Bench) -> Iterator[Plc]:
    plc = Plc(TcpLine(*bench.mock.plc_address), clock=bench.clock, timing=TIMING)
    plc.connect()
    yield plc
    plc.close()


def _polls(bench: Bench, plc: Plc, seconds: float = 1.0) -> None:
    for _ in range(round(seconds / 0.05)):
        bench.clock.sleep_s(0.05)
        plc.read()


@pytest.fixture
def other(bench: Bench) -> Iterator[ModbusTcpClient]:
    host, port = bench.mock.plc_address
    client = ModbusTcpClient(host, port=port)
    assert client.connect()
    yield client
    client.close()


def test_another_heartbeat_in_place_of_ours_is_noticed(bench: Bench, plc: Plc, other: ModbusTcpClient) -> None:
    _polls(bench, plc)
    other.write_registers(30, [40_000])
    with pytest.raises(OtherMaster, match="register 30 holds 40000"):
        _polls(bench, plc)


def test_a_command_that_is_not_ours_is_noticed(bench: Bench, plc: Plc, other: ModbusTcpClient) -> None:
    _polls(bench, plc)
    plc.request_payload(1)
    _polls(bench, plc)
    other.write_registers(31, [700, 9, 0])
    with pytest.raises(OtherMaster, match="command 700 was accepted"):
        _polls(bench, plc)


def test_who_only_reads_is_none_of_our_business(bench: Bench, plc: Plc, other: ModbusTcpClient) -> None:
    for _ in range(10):
        other.read_holding_registers(0, count=37)
        _polls(bench, plc, 0.2)


def _block(beat: int, taken: int) -> list[int]:
    words = [0] * 37
    words[30], words[34] = beat, taken
    return words


def test_a_plc_that_does_not_read_back_what_it_is_told_is_believed() -> None:
    own = OwnWords(RegisterMap())
    own.beat(1)
    assert own.foreign(_block(0, 5)) is None
    own.beat(2)
    assert own.foreign(_block(7, 5)) is None
    assert own.foreign(_block(2, 5)) is None
    own.beat(3)
    assert own.foreign(_block(2, 5)) is None  # the one before: the PLC's program has not run yet
    assert own.foreign(_block(1, 5)) is not None


def test_the_accepted_command_is_the_last_one_or_ours() -> None:
    own = OwnWords(RegisterMap())
    assert own.foreign(_block(0, 5)) is None
    own.command(5, 6)
    assert own.foreign(_block(0, 5)) is None
    assert own.foreign(_block(0, 6)) is None
    assert "command 5" in str(own.foreign(_block(0, 5)))


def test_values_that_jump_are_read_again_and_an_interlock_that_was_open_once_is_open(
    bench: Bench, plc: Plc, monkeypatch: pytest.MonkeyPatch
) -> None:
    registers = bench.mock.plc.state.registers
    before = plc.read()
    answers: list[dict[int, int]] = []

    def spoilt() -> list[int]:
        words = registers()
        for address, word in (answers.pop(0) if answers else {}).items():
            words[address] = word
        return words

    monkeypatch.setattr(bench.mock.plc.state, "registers", spoilt)
    answers[:] = [{2: 1}]
    assert plc.read().payload == before.payload
    answers[:] = [{4: 0x4140, 5: 0}]  # 12 degC of air
    assert plc.read().temperatures_c["air"] == pytest.approx(before.temperatures_c["air"], abs=0.1)
    answers[:] = [{2: 1, 1: 0x000E, 3: 0xFFF1}]
    assert plc.read().open_interlocks() == ["guard closed"]
    assert plc.read().open_interlocks() == []
    answers[:] = [{2: 1}, {2: 2}]
    with pytest.raises(PlcError, match="payload 1 and 2"):
        plc.read()
    answers[:] = [{2: 1}, {2: 1}]
    assert plc.read().payload == 1
