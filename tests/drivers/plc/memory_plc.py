"""A PLC in memory behind pymodbus's own client: framing, decoding and matching are real, only the wire is not."""

from __future__ import annotations

import asyncio
import struct

from pymodbus.client.base import ModbusBaseClient
from pymodbus.framer.rtu import FramerRTU

from drivers.plc.modbus_line import ModbusLine, RtuLine, make_client

COUNT = 37
_TEMPERATURES_C = (20.5, 21.0, 22.0, 19.0, 20.0)


class MemoryPlc:
    """Registers of docs/reference/plc.md; `flip` is the byte and the bit of the answer after `skip` more answers."""

    def __init__(self) -> None:
        self.words = [0] * COUNT
        self.words[1], self.words[3], self.words[36] = 0x000F, 0xFFF0, 1
        self.words[4:18] = struct.unpack(">14H", struct.pack(">7f", *_TEMPERATURES_C, 1002.5, 45.0))
        self.flip: tuple[int, int] | None = None
        self.skip = 0
        self.deaf = False  # what is written is answered and not kept
        self.answers: list[bytes] = []
        self.commands = 0

    def client(self, line: ModbusLine, reply_timeout_s: float) -> ModbusBaseClient:
        """What `make_client` makes, plugged in here."""
        client = make_client(line, reply_timeout_s)

        async def connect() -> bool:
            client.ctx.connection_made(_Wire(self, client, isinstance(line, RtuLine)))
            return True

        client.ctx.connect = connect
        return client

    def answer(self, request: bytes) -> bytes:
        """The answer to a request, both without what frames them."""
        self.words[0] = (self.words[0] + 1) & 0xFFFF
        function, address, count = struct.unpack_from(">BHH", request)
        if function == 16:
            self._write(address, struct.unpack_from(f">{count}H", request, 6))
            return request[:5]
        if function == 23:
            self._write(struct.unpack_from(">H", request, 5)[0], struct.unpack_from(">H", request, 10))
        return struct.pack(f">BB{count}H", function, 2 * count, *self.words[address : address + count])

    def _write(self, address: int, words: tuple[int, ...]) -> None:
        if self.deaf:
            return
        self.words[address : address + len(words)] = words
        if address == 31 and self.words[34] != words[0]:
            self.words[34], self.words[2] = words[0], words[2]
            self.commands += 1

    def spoil(self, answer: bytes) -> bytes:
        """The answer on its way."""
        self.answers.append(answer)
        if self.flip is None or self.skip:
            self.skip = max(0, self.skip - 1)
            return answer
        (at, bit), self.flip = self.flip, None
        return answer[:at] + bytes([answer[at] ^ 1 << bit]) + answer[at + 1 :]


class _Wire(asyncio.Transport):
    def __init__(self, plc: MemoryPlc, client: ModbusBaseClient, rtu: bool) -> None:
        super().__init__()
        self._plc, self._client, self._rtu = plc, client, rtu

    def write(self, data: bytes | bytearray | memoryview) -> None:
        request = bytes(data)
        if self._rtu:
            answer = request[:1] + self._plc.answer(request[1:-2])
            answer += FramerRTU.compute_CRC(answer).to_bytes(2, "big")
        else:
            body = self._plc.answer(request[7:])
            answer = request[:4] + struct.pack(">HB", len(body) + 1, request[6]) + body
        asyncio.get_running_loop().call_soon(self._client.ctx.data_received, self._plc.spoil(answer))

    def close(self) -> None:
        """There is nothing to close."""

    def abort(self) -> None:
        """There is nothing to close."""

    def is_closing(self) -> bool:
        return False
