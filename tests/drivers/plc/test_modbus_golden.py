"""The PLC's driver by the byte: what it sends and what it makes of the answers, on TCP and on RTU."""

from __future__ import annotations

import os
import socket
import struct
import threading
import tty
from collections.abc import Callable, Iterator

import pytest
from pymodbus.framer.rtu import FramerRTU

from drivers.plc.modbus_line import ModbusLine, RtuLine, TcpLine
from drivers.plc.plc import Plc, PlcTiming
from drivers.plc.plc_registers import ReadingRegister, RegisterMap
from tests.drivers.scripted import CountingClock

TEMPERATURES_C = (20.5, 21.0, 22.0, 19.0, 20.0)
VALUES = struct.pack(">7f", *TEMPERATURES_C, 1002.5, 45.0)


def block(heartbeat: int, payload: int = 0, taken: int = 0, result: int = 0) -> bytes:
    """Registers 0 to 36 as they stand in an answer."""
    words = [0] * 37
    words[0], words[1], words[2], words[3] = heartbeat, 0x000F, payload, 0xFFF0
    words[34], words[35], words[36] = taken, result, 1
    data = bytearray(struct.pack(">37H", *words))
    data[8 : 8 + len(VALUES)] = VALUES
    return bytes(data)


# Requests and answers without what frames them: our heartbeat goes in front of the block, the command once.
SCRIPT = [
    ("17 0000 0025 001E 0001 02 0001", b"\x17\x4a" + block(7, taken=5)),
    ("03 0000 0025", b"\x03\x4a" + block(8, taken=5)),
    ("03 0022 0002", bytes.fromhex("03 04 0005 0000")),
    ("10 001F 0003 06 0006 0001 0002", bytes.fromhex("10 001F 0003")),
    ("03 0022 0002", bytes.fromhex("03 04 0005 0000")),  # still the result of the command before
    ("03 0022 0002", bytes.fromhex("03 04 0006 0002")),
    ("03 0022 0002", bytes.fromhex("03 04 0006 0000")),
    ("03 0000 0025", b"\x03\x4a" + block(9, payload=2, taken=6)),
    ("03 0000 0025", b"\x03\x4a" + block(9, payload=2, taken=6)),  # another payload must be read twice
]


# The same with a coolant temperature in register 40: 23.5 degC in tenths.
WITH_COOLANT = [
    ("17 0000 0029 001E 0001 02 0001", b"\x17\x52" + block(7) + bytes.fromhex("0000 0000 0000 00EB")),
    ("03 0000 0029", b"\x03\x52" + block(8) + bytes.fromhex("0000 0000 0000 00EB")),
]
COOLANT = ReadingRegister(40, low=5.0, high=50.0, type="i16", scale=0.1, unit="degC")

Script = list[tuple[str, bytes]]


def crc(data: bytes) -> bytes:
    return FramerRTU.compute_CRC(data).to_bytes(2, "big")


class ScriptedPlc:
    """Plays the script; `errors` holds what did not go by it."""

    def __init__(
        self, script: Script, receive: Callable[[int], bytes], send: Callable[[bytes], None], tcp: bool
    ) -> None:
        self.errors: list[str] = []
        self.script, self.left = tuple(script), list(script)
        self._receive, self._send, self._tcp = receive, send, tcp
        self.thread = threading.Thread(target=self._play, daemon=True)

    def _play(self) -> None:
        for request, answer in self.script:
            wanted = bytes.fromhex(request)
            framed = 7 + len(wanted) if self._tcp else 1 + len(wanted) + 2
            got = b""
            while len(got) < framed:
                part = self._receive(framed - len(got))
                if not part:
                    return
                got += part
            head = got[:7] if self._tcp else got[:1]
            body = got[7:] if self._tcp else got[1:-2]
            frame = got[2:6] == struct.pack(">HH", 0, len(wanted) + 1) if self._tcp else got[-2:] == crc(got[:-2])
            if body != wanted or not frame or head[-1] != 1:
                self.errors.append(f"wanted {request}, got {got.hex(' ')}")
            self.left.pop(0)  # before the answer: whoever has that may look at once
            if self._tcp:
                self._send(got[:2] + struct.pack(">HHB", 0, len(answer) + 1, 1) + answer)
            else:
                self._send(b"\x01" + answer + crc(b"\x01" + answer))


@pytest.fixture
def script() -> Script:
    return SCRIPT


@pytest.fixture(params=["tcp", "rtu"])
def line(request: pytest.FixtureRequest, script: Script) -> Iterator[tuple[ModbusLine, list[ScriptedPlc]]]:
    played: list[ScriptedPlc] = []
    if request.param == "tcp":
        with socket.create_server(("127.0.0.1", 0)) as listener:

            def serve() -> None:
                wire, _ = listener.accept()
                played.append(ScriptedPlc(script, wire.recv, wire.sendall, True))
                played[0].thread.start()  # known to the test before the first answer can reach it
                played[0].thread.join(10.0)
                wire.close()

            server = threading.Thread(target=serve, daemon=True)
            server.start()
            yield TcpLine("127.0.0.1", listener.getsockname()[1]), played
            server.join(10.0)
        return
    master, slave = os.openpty()
    tty.setraw(slave)
    played.append(
        ScriptedPlc(script, lambda size: os.read(master, size), lambda data: (os.write(master, data), None)[1], False)
    )
    played[0].thread.start()
    yield RtuLine(os.ttyname(slave), parity="N"), played
    played[0].thread.join(10.0)
    os.close(slave)
    os.close(master)


def test_connecting_and_a_payload_by_the_byte(line: tuple[ModbusLine, list[ScriptedPlc]]) -> None:
    where, played = line
    plc = Plc(where, clock=CountingClock(), timing=PlcTiming(reply_timeout_s=2.0, poll_period_s=0.05))
    state = plc.connect()
    assert (state.heartbeat, state.pressure_hpa, state.humidity) == (8, 1002.5, 0.45)
    assert plc.request_payload(2).payload == 2
    plc.close()
    assert played[0].errors == []
    assert played[0].left == []


@pytest.mark.parametrize("script", [WITH_COOLANT])
def test_a_further_register_comes_with_the_same_read(line: tuple[ModbusLine, list[ScriptedPlc]]) -> None:
    where, played = line
    registers = RegisterMap(readings={"coolant": COOLANT})
    plc = Plc(
        where, register_map=registers, clock=CountingClock(), timing=PlcTiming(reply_timeout_s=2.0, poll_period_s=0.05)
    )
    state = plc.connect()
    plc.close()
    assert state.readings == {"coolant": pytest.approx(23.5)}
    assert (state.pressure_hpa, state.humidity) == (1002.5, 0.45)
    assert played[0].errors == []
    assert played[0].left == []
