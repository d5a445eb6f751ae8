"""The PLC on Modbus (TCP, TLS or RTU): interlocks, payload and the climate of the rig."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from drivers.clock import HostClock, RigClock
from drivers.errors import OtherMaster, PlcError, StaleData
from drivers.plc.modbus_connection import ModbusConnection
from drivers.plc.modbus_line import ModbusLine
from drivers.plc.own_words import OwnWords
from drivers.plc.plc_registers import PlcState, RegisterMap, decode

_REFUSED, _IN_PROGRESS = 1, 2
_REQUEST_PAYLOAD = 1


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

    A read whose answer is lost is repeated once; a command is never written twice. Our heartbeat goes with a read.
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
        self._connection = ModbusConnection(line, unit, name=name, reply_timeout_s=timing.reply_timeout_s)
        self.name, self.where = name, self._connection.where
        self.map = register_map or RegisterMap()
        self._clock = clock or HostClock()
        self._heartbeat_limit_s = timing.heartbeat_limit_s
        self._poll_period_s = timing.poll_period_s
        self._lock = threading.Lock()
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
        self._connection.open()
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
            self._connection.close()

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
                state, foreign = self._decoded(lambda: self._connection.read(self.map.first, self.map.count))
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
        now_s, register = self._clock.now_s(), self.map.master_heartbeat
        if register is None or 0.0 <= now_s - self._beaten_s < self._beat_period_s:
            return self._connection.read(self.map.first, self.map.count)
        self._beaten_s = now_s
        self._beat = (self._beat + 1) & 0xFFFF
        self._own_words.beat(self._beat)
        return self._connection.read(self.map.first, self.map.count, write=(register, self._beat))

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
            return self._connection.read(address, 1)[0]

    def write_word(self, address: int, value: int) -> None:
        """Write one register that is ours. Where the answer is lost, it is read back. Raises as `read_word`."""
        if not 0 <= value <= 0xFFFF:
            raise ValueError(f"{value} is no register's value")
        with self._lock:
            self._connection.write(address, [value])

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
            taken, _ = self._connection.read(self.map.sequence_taken, 2)
            sequence = (taken + 1) & 0xFFFF
            self._own_words.command(taken, sequence)
            self._connection.write(self.map.sequence, [sequence, _REQUEST_PAYLOAD, number])
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
            taken, result = self._connection.read(self.map.sequence_taken, 2)
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

    def _error(self, what: str, remedy: str) -> PlcError:
        return PlcError(self.name, self.where, what, remedy)
