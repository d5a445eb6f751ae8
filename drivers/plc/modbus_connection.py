"""A connection to one PLC: requests and answers on a loop of its own, opened anew after any failure."""

from __future__ import annotations

import asyncio
import logging
import ssl
import threading
from collections.abc import Callable, Coroutine, Sequence
from contextlib import suppress
from typing import Any

from pymodbus import ModbusException
from pymodbus.client.base import ModbusBaseClient

from drivers.errors import ConnectionFailed, NoAnswer, PlcError
from drivers.plc.modbus_line import ModbusLine, TlsLine, make_client

logging.getLogger("pymodbus").addHandler(logging.NullHandler())  # failures are raised as our own errors

_CHECK = "check address, unit id and network of the PLC"


class ModbusConnection:
    """Registers of one unit, one request at a time; the caller sees to that no two threads ask at once.

    A failed request leaves no connection behind, so that a late answer is not taken for a new one. A read is repeated
    once, a write never. All methods but `open` and `close` raise NoAnswer, ConnectionFailed and PlcError.
    """

    def __init__(self, line: ModbusLine, unit: int, *, name: str, reply_timeout_s: float) -> None:
        self.name = name
        self.where = f"{line} unit {unit}"
        self._line, self._unit = line, unit
        self._reply_timeout_s = reply_timeout_s
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None
        self._client: ModbusBaseClient | None = None
        self._has_answered = False

    def open(self) -> None:
        """Start the loop; the line itself is connected by the first request."""
        self._loop = asyncio.new_event_loop()
        self._loop.set_exception_handler(lambda _loop, _context: None)  # a spoilt frame: its request gets no answer
        self._thread = threading.Thread(target=self._loop.run_forever, name=f"{self.name} I/O", daemon=True)
        self._has_answered = False
        self._thread.start()

    def close(self) -> None:
        """Close the line and end the loop. May be called again."""
        loop, self._loop = self._loop, None
        if loop is None or self._thread is None:
            return
        client, self._client = self._client, None
        with suppress(TimeoutError):
            asyncio.run_coroutine_threadsafe(_shut_down(client), loop).result(timeout=5.0)
        loop.call_soon_threadsafe(loop.stop)
        self._thread.join(timeout=5.0)
        loop.close()

    def read(self, address: int, count: int, write: tuple[int, int] | None = None) -> list[int]:
        """`count` holding registers from `address` on; `write`, an address and its value, goes along (function 23)."""
        try:
            reply = self._ask(lambda: self._read(address, count, write), address, count)
        except (NoAnswer, ConnectionFailed):
            reply = self._ask(lambda: self._read(address, count, write), address, count)
        words = list(reply.registers)
        if len(words) != count:
            what = f"{len(words)} registers answered, {count} asked for"
            raise PlcError(self.name, self.where, what, "check the register map")
        return words

    def write(self, address: int, words: Sequence[int]) -> None:
        """Write holding registers. Where the answer is lost they are read back, and NoAnswer says that they differ."""
        try:
            self._ask(lambda: self._write(address, words), address, len(words))
        except NoAnswer:
            if self.read(address, len(words)) != list(words):
                raise

    async def _read(self, address: int, count: int, write: tuple[int, int] | None) -> Any:
        client = await self._connected()
        if write is None:
            return await client.read_holding_registers(address, count=count, device_id=self._unit)
        return await client.readwrite_registers(
            read_address=address,
            read_count=count,
            write_address=write[0],
            values=[write[1]],
            device_id=self._unit,
        )

    async def _write(self, address: int, words: Sequence[int]) -> Any:
        client = await self._connected()
        return await client.write_registers(address, list(words), device_id=self._unit)

    async def _connected(self) -> ModbusBaseClient:
        if self._client is None or not self._client.connected:
            if self._client is not None:
                self._client.close()
            self._client = make_client(self._line, self._reply_timeout_s)
            if not await self._client.connect():
                if isinstance(self._line, TlsLine):
                    await self._line.try_handshake(self._reply_timeout_s)  # the library does not say why
                raise ConnectionFailed(self.name, self.where, "no connection", _CHECK)
        return self._client

    async def _hang_up(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            await _leave(client)

    def _ask(self, request: Callable[[], Coroutine[Any, Any, Any]], address: int, count: int) -> Any:
        where = f"{self.where}, registers {address} to {address + count - 1}"
        if self._loop is None:
            raise RuntimeError(f"{self.name} is not connected: call connect() first")
        try:
            future = asyncio.run_coroutine_threadsafe(request(), self._loop)
            try:
                reply = future.result(timeout=3.0 * self._reply_timeout_s + 1.0)
            finally:
                future.cancel()
        except ssl.SSLError as error:
            raise self._tls_refused(where, error) from error
        except (ModbusException, OSError, TimeoutError) as error:
            with suppress(TimeoutError, OSError):
                asyncio.run_coroutine_threadsafe(self._hang_up(), self._loop).result(timeout=5.0)
            self._raise_if_refused(where)
            reason = " ".join(str(error).split()) or "time-out"
            raise NoAnswer(self.name, where, f"no answer: {reason}", _CHECK) from error
        self._has_answered = True
        if reply.isError():
            raise PlcError(self.name, where, f"the request is refused: {reply}", "check the register map")
        return reply

    def _raise_if_refused(self, where: str) -> None:
        """Where a PLC on TLS has not answered yet: whether it refuses our certificate, which looks like silence."""
        if not isinstance(self._line, TlsLine) or self._has_answered or self._loop is None:
            return
        trial = self._line.try_handshake(self._reply_timeout_s)
        try:
            with suppress(TimeoutError):
                asyncio.run_coroutine_threadsafe(trial, self._loop).result(timeout=3.0 * self._reply_timeout_s)
        except ssl.SSLError as error:
            raise self._tls_refused(where, error) from error
        except OSError:
            return  # no line at all: what was reported

    def _tls_refused(self, where: str, error: ssl.SSLError) -> ConnectionFailed:
        reason = str(getattr(error, "reason", None) or error.args[0])  # one of our own has no reason
        if isinstance(error, ssl.SSLCertVerificationError):
            reason = f"the PLC's certificate is refused: {error.verify_message}"
        elif "ALERT" in reason:
            reason = f"the PLC refuses our certificate: {reason.lower().replace('_', ' ')}"
        return ConnectionFailed(self.name, where, f"TLS: {reason}", "check the certificate files in the rig file")


async def _leave(client: ModbusBaseClient) -> None:
    """Close and let the transport's last callbacks run before the loop ends; TLS would wait for the peer's farewell."""
    transport = client.ctx.transport
    client.close()
    if isinstance(transport, asyncio.WriteTransport):
        transport.abort()
    for _ in range(5):
        await asyncio.sleep(0)


async def _shut_down(client: ModbusBaseClient | None) -> None:
    """Leave the loop without tasks: one that is destroyed while it waits would say so on stderr."""
    if client is not None:
        await _leave(client)
    others = asyncio.all_tasks() - {asyncio.current_task()}
    for task in others:
        task.cancel()
    await asyncio.gather(*others, return_exceptions=True)
