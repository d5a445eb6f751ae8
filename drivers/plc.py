"""The PLC on Modbus TCP: interlocks, payload and the climate of the rig."""

from __future__ import annotations

import asyncio
import logging
import math
import threading
import time
from collections.abc import Callable, Coroutine
from contextlib import suppress
from typing import Any, TypeVar

from pymodbus import ModbusException
from pymodbus.client import AsyncModbusTcpClient

from drivers.clock import HostClock, RigClock
from drivers.errors import ConnectionFailed, NoAnswer, PlcError, StaleData
from drivers.plc_registers import PlcState, RegisterMap, decode

logging.getLogger("pymodbus").addHandler(logging.NullHandler())  # failures are raised as our own errors

_Result = TypeVar("_Result")
_REFUSED, _IN_PROGRESS = 1, 2
_REQUEST_PAYLOAD = 1
_CHECK = "check address, unit id and network of the PLC"


class Plc:
    """One PLC.

    `heartbeat_limit_s` and the limit of `request_payload` are rig time, `reply_timeout_s` is host time. A
    connection that was lost is opened anew by the next read; nothing is ever written twice.
    """

    def __init__(
        self,
        host: str,
        port: int = 502,
        unit: int = 1,
        register_map: RegisterMap | None = None,
        clock: RigClock | None = None,
        *,
        name: str = "PLC",
        reply_timeout_s: float = 1.0,
        heartbeat_limit_s: float = 1.0,
        poll_period_s: float = 0.1,
    ) -> None:
        self.name = name
        self.where = f"{host}:{port} unit {unit}"
        self.map = register_map or RegisterMap()
        self._host, self._port, self._unit = host, port, unit
        self._clock = clock or HostClock()
        self._reply_timeout_s = reply_timeout_s
        self._heartbeat_limit_s = heartbeat_limit_s
        self._poll_period_s = poll_period_s
        self._lock = threading.Lock()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None
        self._client: AsyncModbusTcpClient | None = None
        self._heartbeat: int | None = None
        self._changed_s = -math.inf

    def connect(self) -> PlcState:
        """Open the connection and wait until the heartbeat moves; returns the first fresh state.

        Raises ConnectionFailed, NoAnswer, PlcError, StaleData.
        """
        self.close()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name=f"{self.name} I/O", daemon=True)
        self._thread.start()
        self._heartbeat, self._changed_s = None, -math.inf
        try:
            return self._wait_for_heartbeat()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the connection and end its thread. May be called again."""
        loop, self._loop = self._loop, None
        if loop is None or self._thread is None:
            return
        client, self._client = self._client, None
        if client is not None:
            with suppress(TimeoutError):
                asyncio.run_coroutine_threadsafe(_leave(client), loop).result(timeout=5.0)
        loop.call_soon_threadsafe(loop.stop)
        self._thread.join(timeout=5.0)
        loop.close()

    def read(self) -> PlcState:
        """All values in one block read.

        While the heartbeat stands still `heartbeat_fresh` is False and every interlock reads open.
        Raises NoAnswer, ConnectionFailed, and PlcError for a value outside its validity.
        """
        with self._lock:
            begin_s, begin_rig_s = time.monotonic(), self._clock.now_s()
            words = self._read_words(self.map.first, self.map.count)
            t_host_s = 0.5 * (begin_s + time.monotonic())
            now_s = self._clock.now_s()
            heartbeat = words[self.map.heartbeat - self.map.first]
            if self._heartbeat is not None and heartbeat != self._heartbeat:
                self._changed_s = now_s
            self._heartbeat = heartbeat
            fresh = 0.0 <= now_s - self._changed_s <= self._heartbeat_limit_s
            times = (0.5 * (begin_rig_s + now_s), t_host_s)
            return decode(self.map, words, fresh, times, self.name, self.where)

    def request_payload(
        self, number: int, limit_s: float = 600.0, watch: Callable[[], None] = lambda: None
    ) -> PlcState:
        """Ask for a payload and wait until it is on; returns the state with it.

        Written once. `watch` is called between polls and may raise. Raises PlcError if refused or not done
        in `limit_s` of rig time.
        """
        if not 0 <= number < 0xFFFF:
            raise ValueError(f"no such payload: {number}")
        with self._lock:
            taken, _ = self._read_words(self.map.sequence_taken, 2)
            sequence = (taken + 1) & 0xFFFF
            self._write_words(self.map.sequence, [sequence, _REQUEST_PAYLOAD, number])
        end_s = self._clock.now_s() + limit_s
        while not self._done(sequence, number):
            if self._clock.now_s() >= end_s:
                raise self._error(f"payload {number} is not on after {limit_s:g} s", "ask the operator")
            watch()
            self._clock.sleep_s(self._poll_period_s)
        state = self.read()
        if state.payload != number:
            raise self._error(f"payload {state.payload} is on, {number} was requested", "check the payload")
        return state

    def _done(self, sequence: int, number: int) -> bool:
        with self._lock:
            taken, result = self._read_words(self.map.sequence_taken, 2)
        if taken != sequence or result == _IN_PROGRESS:
            return False
        if result == _REFUSED:
            raise self._error(f"payload {number} is refused", "check the list of payloads in the rig file")
        if result != 0:
            raise self._error(f"result {result} has no meaning", "check the register map")
        return True

    def _wait_for_heartbeat(self) -> PlcState:
        end_s = self._clock.now_s() + self._heartbeat_limit_s
        while True:
            state = self.read()
            if state.heartbeat_fresh:
                return state
            if self._clock.now_s() >= end_s:
                raise StaleData(
                    self.name,
                    self.where,
                    f"the heartbeat stands still at {state.heartbeat}",
                    "check that the PLC's program runs",
                )
            self._clock.sleep_s(self._poll_period_s)

    def _read_words(self, address: int, count: int) -> list[int]:
        words = list(self._io(self._read_registers(address, count), address).registers)
        if len(words) != count:
            raise self._error(f"{len(words)} registers answered, {count} asked for", "check the register map")
        return words

    def _write_words(self, address: int, words: list[int]) -> None:
        self._io(self._write_registers(address, words), address)

    async def _read_registers(self, address: int, count: int) -> Any:
        client = await self._connected()
        return await client.read_holding_registers(address, count=count, device_id=self._unit)

    async def _write_registers(self, address: int, words: list[int]) -> Any:
        client = await self._connected()
        return await client.write_registers(address, words, device_id=self._unit)

    async def _connected(self) -> AsyncModbusTcpClient:
        if self._client is None or not self._client.connected:
            if self._client is not None:
                self._client.close()
            self._client = AsyncModbusTcpClient(
                self._host,
                port=self._port,
                retries=0,
                timeout=self._reply_timeout_s,
                reconnect_delay=0,
            )
            if not await self._client.connect():
                raise ConnectionFailed(self.name, self.where, "no connection", _CHECK)
        return self._client

    def _io(self, work: Coroutine[Any, Any, _Result], address: int) -> Any:
        where = f"{self.where}, register {address}"
        if self._loop is None:
            work.close()
            raise RuntimeError(f"{self.name} is not connected: call connect() first")
        try:
            future = asyncio.run_coroutine_threadsafe(work, self._loop)
            reply: Any = future.result(timeout=3.0 * self._reply_timeout_s + 1.0)
        except (ModbusException, OSError, TimeoutError) as error:
            reason = " ".join(str(error).split()) or "time-out"
            raise NoAnswer(self.name, where, f"no answer: {reason}", _CHECK) from error
        if reply.isError():
            raise PlcError(self.name, where, f"the request is refused: {reply}", "check the register map")
        return reply

    def _error(self, what: str, remedy: str) -> PlcError:
        return PlcError(self.name, self.where, what, remedy)


async def _leave(client: AsyncModbusTcpClient) -> None:
    """Close and let the transport's last callbacks run before the loop ends."""
    client.close()
    for _ in range(3):
        await asyncio.sleep(0)
