"""Every bit of an answer of the PLC turned over, at every position, on TCP and on RTU.

RTU has a checksum. Modbus TCP has none: what its header, the complement of the interlocks, the validity of values and
the second look at whatever jumps leave undetected is in docs/reference/devices.md.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

import pytest

from drivers.errors import DeviceError, NoAnswer
from drivers.plc.modbus_line import ModbusLine, RtuLine, TcpLine
from drivers.plc.plc import Plc, PlcTiming
from drivers.plc.plc_registers import PlcState
from tests.drivers.plc.memory_plc import MemoryPlc
from tests.drivers.scripted import CountingClock

GUARD_S = 0.002  # host time; answers are there at once, and what a flip hid is waited for in vain
LINES: list[ModbusLine] = [TcpLine("memory"), RtuLine("memory", parity="N")]


@pytest.fixture
def memory() -> MemoryPlc:
    return MemoryPlc()


@pytest.fixture(params=LINES, ids=["tcp", "rtu"])
def opened(
    request: pytest.FixtureRequest, memory: MemoryPlc, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[[float], Plc]]:
    monkeypatch.setattr("drivers.plc.modbus_connection.make_client", memory.client)
    made: list[Plc] = []

    def connect(guard_s: float) -> Plc:
        timing = PlcTiming(reply_timeout_s=guard_s, heartbeat_limit_s=1e6, beat_period_s=1e6)
        made.append(Plc(request.param, clock=CountingClock(), timing=timing))
        _patiently(made[-1].connect)
        return made[-1]

    yield connect
    for plc in made:
        plc.close()


def _patiently(read: Callable[[], PlcState]) -> PlcState:
    """What is not spoilt comes at once, but a busy computer may let the short time-out pass."""
    for _ in range(100):
        with contextlib.suppress(NoAnswer):
            return read()
    raise AssertionError("no answer at all")


def _flips(memory: MemoryPlc) -> Iterator[tuple[int, int]]:
    for at in range(len(memory.answers[-1])):
        for bit in range(8):
            yield at, bit


def _unlike(plc: Plc, good: PlcState, state: PlcState) -> str | None:
    if state.interlocks != good.interlocks or state.payload != good.payload or not state.heartbeat_fresh:
        return f"{state}"
    return plc.map.jump(good, state)


def test_a_bit_of_a_block_is_read_again_refused_or_within_a_hundredth_of_the_range(
    memory: MemoryPlc, opened: Callable[[float], Plc]
) -> None:
    plc = opened(GUARD_S)
    memory.words[1], memory.words[3] = 0x000E, 0xFFF1  # the guard is open, and never reads closed
    good, right, wrong = _patiently(plc.read), 0, []
    for at, bit in _flips(memory):
        _patiently(plc.read)
        memory.flip = at, bit
        try:
            state = plc.read()
        except DeviceError:
            state = _patiently(plc.read)
        unlike = _unlike(plc, good, state)
        if unlike is not None:
            wrong.append(f"byte {at}, bit {bit}: {unlike}")
        else:
            right += 1
    assert wrong == []
    assert right > 600


@pytest.mark.parametrize("exchange", range(3))
def test_a_payload_is_requested_once_whichever_bit_is_spoilt(
    memory: MemoryPlc, opened: Callable[[float], Plc], exchange: int
) -> None:
    """The number of the last command, the answer to ours, its result; a block is above."""
    plc = opened(5.0)
    before, wrong = len(memory.answers), []
    plc.request_payload(1)
    length = len(memory.answers[before + exchange])
    plc = opened(GUARD_S)
    for at in range(length):
        for bit in range(8):
            memory.skip, memory.flip, commands = exchange, (at, bit), memory.commands
            number = 3 - memory.words[2]
            try:
                state = plc.request_payload(number, limit_s=0.5)
            except DeviceError:
                memory.flip, memory.skip = None, 0
                _patiently(plc.read)
            else:
                if state.payload != number or memory.words[2] != number:
                    wrong.append(f"byte {at}, bit {bit}: payload {state.payload}")
            if memory.commands > commands + 1:
                wrong.append(f"byte {at}, bit {bit}: {memory.commands - commands} commands")
    assert wrong == []


@pytest.mark.parametrize("deaf", [False, True])
def test_a_write_whose_answer_is_lost_is_done_only_if_it_reads_back(
    memory: MemoryPlc, opened: Callable[[float], Plc], deaf: bool
) -> None:
    plc = opened(0.5)
    memory.flip, memory.deaf = (0, 0), deaf
    with pytest.raises(NoAnswer) if deaf else contextlib.nullcontext():
        plc.write_word(33, 7)
    assert memory.flip is None  # the answer was spoilt
    assert plc.read_word(33) == (0 if deaf else 7)
