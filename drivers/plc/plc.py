"""The PLC on Modbus (TCP, TLS or RTU): interlocks, payload and the climate of the rig."""

from __future__ import annotations

import asyncio
import logging
import math
import ssl
import threading
import time
from collections.abc import Callable, Coroutine
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from pymodbus import ModbusException
from pymodbus.client.base import ModbusBaseClient

from drivers.clock import HostClock, RigClock
from drivers.errors import ConnectionFailed, NoAnswer, OtherMaster, PlcError, StaleData
from drivers.plc.modbus_line import ModbusLine, TlsLine, make_client
from drivers.plc.own_words import OwnWords
from drivers.plc.plc_registers import PlcState, RegisterMap, decode

logging.getLogger("pymodbus").addHandler(logging.NullHandler())  # failures are raised as our own errors

_Result = TypeVar("_Result")
_REFUSED, _IN_PROGRESS = 1, 2
_REQUEST_PAYLOAD = 1
_CHECK = "check address, unit id and network of the PLC"


@dataclass(frozen=True)
class PlcTiming:
    """`reply_timeout_s` is host time, the others are rig time.

    The PLC's heartbeat must change within `heartbeat_limit_s`; ours is sent with a read every `beat_period_s`;
    `poll_period_s` is between two looks while something is waited for.
    """

    reply_timeout_s: float = 1.0
    heartbeat_limit_s: float = 1.0
    poll_period_s: float = 0.1
    beat_period_s: float = 0.25


class Plc:
    """One PLC.

    After any failure the connection is opened anew, so that no late answer is taken for a new one, and a read is
    repeated once; a command is never written twice. Our heartbeat is sent together with a read (function 23).
    """

    def __init__(
        self,
        line: ModbusLine,
        unit: int = 1,
        register_map: RegisterMap | None = None,
        clock: RigClock | None = None,
        *,
        name: str = "PLC",
        timing: PlcTiming | None = None,
    ) -> None:
        timing = timing or PlcTiming()
        self.name = name
        self.where = f"{line} unit {unit}"
        self.map = register_map or RegisterMap()
        self._modbus_line, self._unit = line, unit
        self._clock = clock or HostClock()
        self._reply_timeout_s = timing.reply_timeout_s
        self._heartbeat_limit_s = timing.heartbeat_limit_s
        self._poll_period_s = timing.poll_period_s
        self._lock = threading.Lock()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None
        self._client: ModbusBaseClient | None = None
        self._beat_period_s = timing.beat_period_s
        self._beat, self._beaten_s = 0, -math.inf
        self._connected_s = -math.inf
        self._heartbeat: int | None = None
        self._changed_s = -math.inf
        self._last_words: dict[str, tuple[tuple[int, ...], float]] = {}
        self._believed: PlcState | None = None
        self._own_words = OwnWords(self.map)

    def connect(self) -> PlcState:
        """Open the connection and wait until the heartbeat moves; returns the first fresh state.

        Raises ConnectionFailed, NoAnswer, PlcError, StaleData.
        """
        self.close()
        self._loop = asyncio.new_event_loop()
        self._loop.set_exception_handler(lambda _loop, _context: None)  # a spoilt frame: its request gets no answer
        self._thread = threading.Thread(target=self._loop.run_forever, name=f"{self.name} I/O", daemon=True)
        self._thread.start()
        self._heartbeat, self._changed_s = None, -math.inf
        self._beaten_s, self._connected_s = -math.inf, self._clock.now_s()
        self._last_words = {}
        self._believed, self._own_words = None, OwnWords(self.map)
        try:
            return self._wait_for_heartbeat()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the connection and end its thread, after the request in hand. May be called again."""
        with self._lock:
            loop, self._loop = self._loop, None
            if loop is None or self._thread is None:
                return
            client, self._client = self._client, None
            with suppress(TimeoutError):
                asyncio.run_coroutine_threadsafe(_shut_down(client), loop).result(timeout=5.0)
            loop.call_soon_threadsafe(loop.stop)
            self._thread.join(timeout=5.0)
            loop.close()

    def read(self) -> PlcState:
        """All values in one block read.

        While the heartbeat stands still `heartbeat_fresh` is False and every interlock reads open. Where the payload is
        another one than before, or a value has jumped, the block is read again at once and must say either; an
        interlock counts as open if it was in one of the two. Raises NoAnswer, ConnectionFailed, PlcError for a value
        outside its validity or read differently, OtherMaster, and StaleData for a value that is old.
        """
        with self._lock:
            before = self._believed
            state, foreign = self._decoded(self._read_block)
            jump = None if before is None else self.map.jump(before, state)
            alive = before is not None and state.heartbeat != before.heartbeat  # else it may still show an old beat
            if jump is not None or (foreign is not None and alive):
                first = state
                state, foreign = self._decoded(lambda: self._read_words(self.map.first, self.map.count))
                if foreign is not None:
                    raise OtherMaster(self.name, self.where, foreign, "disconnect it, then connect again")
                jump = self.map.jump(first, state)
                if jump is not None and (before is None or self.map.jump(before, state) is not None):
                    raise self._error(f"two reads at once differ: {jump}", "check the line to the PLC")
                both = {name: good and first.interlocks[name] for name, good in state.interlocks.items()}
                state = replace(state, interlocks=both)
            self._believed = state
            return state

    def _decoded(self, read: Callable[[], list[int]]) -> tuple[PlcState, str | None]:
        """One block as a state, and what in it another client has written."""
        begin_s, begin_rig_s = time.monotonic(), self._clock.now_s()
        words = read()
        t_host_s = 0.5 * (begin_s + time.monotonic())
        now_s = self._clock.now_s()
        heartbeat = words[self.map.heartbeat - self.map.first]
        if self._heartbeat is not None and heartbeat != self._heartbeat:
            self._changed_s = now_s
        self._heartbeat = heartbeat
        fresh = 0.0 <= now_s - self._changed_s <= self._heartbeat_limit_s
        times = (0.5 * (begin_rig_s + now_s), t_host_s)
        state = decode(self.map, words, fresh, times, self.name, self.where)
        self._refuse_old_values(words, now_s)
        if now_s - self._connected_s <= self._heartbeat_limit_s:  # it has had no time to see us yet
            state = replace(state, master_seen=True)
        return state, self._own_words.foreign(words)

    def _read_block(self) -> list[int]:
        now_s, beats = self._clock.now_s(), self.map.master_heartbeat is not None
        if not beats or 0.0 <= now_s - self._beaten_s < self._beat_period_s:
            return self._read_words(self.map.first, self.map.count)
        self._beaten_s = now_s
        self._beat = (self._beat + 1) & 0xFFFF
        self._own_words.beat(self._beat)
        return self._read_words(self.map.first, self.map.count, beat=self._beat)

    def _refuse_old_values(self, words: list[int], now_s: float) -> None:
        for name, register in self.map.values.items():
            if register.stale_s is None:
                continue
            at = register.address - self.map.first
            held = tuple(words[at : at + register.words])
            before, since_s = self._last_words.get(name, ((), now_s))
            if held != before:
                self._last_words[name] = (held, now_s)
            elif not 0.0 <= now_s - since_s <= register.stale_s:
                raise StaleData(
                    self.name,
                    f"{self.where}, register {register.address}",
                    f"{name} has not changed for {now_s - since_s:.0f} s",
                    "check the sensor and the PLC's program",
                )

    def read_word(self, address: int) -> int:
        """One register, whatever it means. Raises NoAnswer, ConnectionFailed and PlcError."""
        with self._lock:
            return self._read_words(address, 1)[0]

    def write_word(self, address: int, value: int) -> None:
        """Write one register that is ours. Where the answer is lost, it is read back. Raises as `read_word`."""
        if not 0 <= value <= 0xFFFF:
            raise ValueError(f"{value} is no register's value")
        with self._lock:
            try:
                self._io(lambda: self._write_registers(address, [value]), address, 1)
            except NoAnswer:
                if self._read_words(address, 1) != [value]:
                    raise

    def request_payload(
        self, number: int, limit_s: float = 600.0, watch: Callable[[], None] = lambda: None
    ) -> PlcState:
        """Ask for a payload and wait until it is on; returns the state with it.

        Written once; where the answer is lost, the sequence word in the PLC tells whether it has come. `watch` is
        called between polls and may raise. Raises PlcError if refused or not done in `limit_s` of rig time.
        """
        if not 0 <= number < 0xFFFF:
            raise ValueError(f"no such payload: {number}")
        with self._lock:
            taken, _ = self._read_words(self.map.sequence_taken, 2)
            sequence = (taken + 1) & 0xFFFF
            self._own_words.command(taken, sequence)
            self._write_command([sequence, _REQUEST_PAYLOAD, number])
        end_s = self._clock.now_s() + limit_s
        while not self._is_done(sequence, number):
            if self._clock.now_s() >= end_s:
                raise self._error(f"payload {number} is not on after {limit_s:g} s", "ask the operator")
            watch()
            self._clock.sleep_s(self._poll_period_s)
        state = self.read()
        if state.payload != number:
            raise self._error(f"payload {state.payload} is on, {number} was requested", "check the payload")
        return state

    def _is_done(self, sequence: int, number: int) -> bool:
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

    def _read_words(self, address: int, count: int, beat: int | None = None) -> list[int]:
        try:
            reply = self._io(lambda: self._read_registers(address, count, beat), address, count)
        except (NoAnswer, ConnectionFailed):
            reply = self._io(lambda: self._read_registers(address, count, beat), address, count)
        words = list(reply.registers)
        if len(words) != count:
            raise self._error(f"{len(words)} registers answered, {count} asked for", "check the register map")
        return words

    def _write_command(self, words: list[int]) -> None:
        address = self.map.sequence
        try:
            self._io(lambda: self._write_registers(address, words), address, len(words))
        except NoAnswer:
            if self._read_words(address, len(words)) != words:
                raise

    async def _read_registers(self, address: int, count: int, beat: int | None) -> Any:
        client = await self._connected()
        if beat is None or self.map.master_heartbeat is None:
            return await client.read_holding_registers(address, count=count, device_id=self._unit)
        return await client.readwrite_registers(
            read_address=address,
            read_count=count,
            write_address=self.map.master_heartbeat,
            values=[beat],
            device_id=self._unit,
        )

    async def _write_registers(self, address: int, words: list[int]) -> Any:
        client = await self._connected()
        return await client.write_registers(address, words, device_id=self._unit)

    async def _connected(self) -> ModbusBaseClient:
        if self._client is None or not self._client.connected:
            if self._client is not None:
                self._client.close()
            self._client = make_client(self._modbus_line, self._reply_timeout_s)
            if not await self._client.connect():
                if isinstance(self._modbus_line, TlsLine):
                    await self._modbus_line.try_handshake(self._reply_timeout_s)  # the library does not say why
                raise ConnectionFailed(self.name, self.where, "no connection", _CHECK)
        return self._client

    async def _hang_up(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            await _leave(client)

    def _io(self, work: Callable[[], Coroutine[Any, Any, _Result]], address: int, count: int) -> Any:
        where = f"{self.where}, registers {address} to {address + count - 1}"
        if self._loop is None:
            raise RuntimeError(f"{self.name} is not connected: call connect() first")
        try:
            future = asyncio.run_coroutine_threadsafe(work(), self._loop)
            try:
                reply: Any = future.result(timeout=3.0 * self._reply_timeout_s + 1.0)
            finally:
                future.cancel()
        except ssl.SSLError as error:
            raise _refused(self.name, where, error) from error
        except (ModbusException, OSError, TimeoutError) as error:
            with suppress(TimeoutError, OSError):
                asyncio.run_coroutine_threadsafe(self._hang_up(), self._loop).result(timeout=5.0)
            self._raise_if_refused(where)
            reason = " ".join(str(error).split()) or "time-out"
            raise NoAnswer(self.name, where, f"no answer: {reason}", _CHECK) from error
        if reply.isError():
            raise PlcError(self.name, where, f"the request is refused: {reply}", "check the register map")
        return reply

    def _raise_if_refused(self, where: str) -> None:
        """Where a PLC on TLS has not answered yet: whether it refuses our certificate, which looks like silence."""
        if not isinstance(self._modbus_line, TlsLine) or self._believed is not None or self._loop is None:
            return
        trial = self._modbus_line.try_handshake(self._reply_timeout_s)
        try:
            with suppress(TimeoutError):
                asyncio.run_coroutine_threadsafe(trial, self._loop).result(timeout=3.0 * self._reply_timeout_s)
        except ssl.SSLError as error:
            raise _refused(self.name, where, error) from error
        except OSError:
            return  # no line at all: what was reported

    def _error(self, what: str, remedy: str) -> PlcError:
        return PlcError(self.name, self.where, what, remedy)


def _refused(name: str, where: str, error: ssl.SSLError) -> ConnectionFailed:
    reason = str(getattr(error, "reason", None) or error.args[0])  # one of our own has no reason
    if isinstance(error, ssl.SSLCertVerificationError):
        reason = f"the PLC's certificate is refused: {error.verify_message}"
    elif "ALERT" in reason:
        reason = f"the PLC refuses our certificate: {reason.lower().replace('_', ' ')}"
    return ConnectionFailed(name, where, f"TLS: {reason}", "check the certificate files in the rig file")


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
