"""The PLC: a Modbus TCP server whose registers (docs/plc.md) follow the plant at each request.

Not modelled: TLS, RTU, several masters with different rights, and power that goes when the emergency stop opens: the
interlock bits are only shown.
"""

from __future__ import annotations

import asyncio
import logging
import struct
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, cast

from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from mock_devices.plant import Plant

UNIT = 1
REGISTERS = 60
CHANGING = 0xFFFF
GOOD_INTERLOCKS = 0b1111
DONE, REFUSED, IN_PROGRESS = 0, 1, 2

_HEARTBEAT_PERIOD_S = 0.1
_SEQUENCE = 31
_REQUEST_PAYLOAD = 1
_FLOATS_AT = 4
_READ, _WRITE_SINGLE, _WRITE = 3, 6, 16

_log = logging.getLogger(__name__)


class PlcState:
    """What the PLC knows and does, without its line. Safe to use from several threads."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._lock = threading.Lock()
        self._interlocks = GOOD_INTERLOCKS
        self._command = [0, 0, 0]
        self._taken, self._result = 0, DONE
        self._cancel: Callable[[], None] | None = None

    def set_interlock(self, bit: int, good: bool) -> None:
        """Open or close an interlock."""
        with self._lock:
            self._interlocks = self._interlocks | 1 << bit if good else self._interlocks & ~(1 << bit)

    def registers(self) -> list[int]:
        """All registers as they are now."""
        t_s, thermal = self._plant.clock.now_s(), self._plant.thermal
        words = [0] * REGISTERS
        with self._lock:
            words[0] = int(t_s / _HEARTBEAT_PERIOD_S) & 0xFFFF
            words[1] = self._interlocks
            words[2] = self._plant.payload if self._cancel is None else CHANGING
            words[_SEQUENCE : _SEQUENCE + 5] = [*self._command, self._taken, self._result]
        sensors = [thermal.sensor_c(name, t_s) for name in ("air", "struts", "columns", "base", "platform")]
        floats = [*sensors, thermal.pressure_hpa(t_s), 100.0 * thermal.humidity()]
        words[_FLOATS_AT : _FLOATS_AT + 2 * len(floats)] = struct.unpack(
            f">{2 * len(floats)}H", struct.pack(f">{len(floats)}f", *floats)
        )
        return words

    def write(self, address: int, values: list[int]) -> bool:
        """Write registers; only the command's three can be written. False if any other is touched."""
        if address < _SEQUENCE or address + len(values) > _SEQUENCE + 3:
            return False
        with self._lock:
            at = address - _SEQUENCE
            self._command[at : at + len(values)] = values
            sequence, command, argument = self._command
            if sequence != self._taken:
                self._taken = sequence
                self._result = self._take(command, argument)
        return True

    def close(self) -> None:
        """Send the operator home."""
        with self._lock:
            if self._cancel is not None:
                self._cancel()

    def _take(self, command: int, argument: int) -> int:
        known = command == _REQUEST_PAYLOAD and argument < len(self._plant.settings.payloads)
        if not known or self._cancel is not None or self._plant.is_moving():
            return REFUSED
        if argument == self._plant.payload:
            return DONE
        clock, sequence = self._plant.clock, self._taken
        self._cancel = clock.call_at(
            clock.now_s() + self._plant.settings.operator_time_s, lambda: self._payload_is_on(argument, sequence)
        )
        return IN_PROGRESS

    def _payload_is_on(self, payload: int, sequence: int) -> None:
        with self._lock:
            self._plant.put_on(payload)
            self._cancel = None
            if self._taken == sequence:
                self._result = DONE


class PlcServer:
    """Serves a PlcState on Modbus TCP in a thread of its own. Port 0 takes a free one."""

    def __init__(self, plant: Plant, host: str = "127.0.0.1", port: int = 0) -> None:
        self.state = PlcState(plant)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="mock-plc", daemon=True)
        self._thread.start()
        self._server: ModbusTcpServer | None = None
        try:
            self.address = self._run(self._listen(host, port)).result(timeout=10.0)
        except BaseException:
            self.close()
            raise

    def set_interlock(self, bit: int, good: bool) -> None:
        """Open or close an interlock: 0 guard, 1 emergency stop, 2 drive power, 3 air pressure."""
        self.state.set_interlock(bit, good)

    def close(self) -> None:
        """Stop serving. May be called again."""
        if self._loop.is_closed():
            return
        self.state.close()
        self._run(self._shut_down()).result(timeout=10.0)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(timeout=5.0)
        self._loop.close()

    def _run(self, coroutine: Any) -> Future[Any]:
        return asyncio.run_coroutine_threadsafe(coroutine, self._loop)

    async def _listen(self, host: str, port: int) -> tuple[str, int]:
        def block() -> list[SimData]:
            return [SimData(0, count=REGISTERS, values=0, datatype=DataType.REGISTERS)]

        units = [SimDevice(UNIT, simdata=block(), action=self._action)]
        units.append(SimDevice(0, simdata=block(), action=_nobody))  # every other unit id
        server = ModbusTcpServer(units, address=(host, port))
        if not await server.listen():
            raise OSError(f"the mock PLC cannot listen on {host}:{port}")
        self._server = server
        name = cast(asyncio.Server, server.transport).sockets[0].getsockname()
        return str(name[0]), int(name[1])

    async def _shut_down(self) -> None:
        if self._server is not None:
            # A client that is being let in while the listener closes would keep its socket open for ever.
            await asyncio.sleep(0)
            await _end_others(grace_s=1.0)
            await self._server.shutdown()  # type: ignore[no-untyped-call]
        await _end_others(grace_s=0.0)

    async def _action(
        self,
        function: int,
        _start: int,
        address: int,
        _count: int,
        registers: list[int],
        values: list[int] | list[bool] | None,
    ) -> ExcCodes | None:
        if function not in (_READ, _WRITE_SINGLE, _WRITE):
            return ExcCodes.ILLEGAL_FUNCTION
        if values is not None and not self.state.write(address, [int(value) for value in values]):
            return ExcCodes.ILLEGAL_ADDRESS
        registers[:REGISTERS] = self.state.registers()
        return None


async def _nobody(*_args: Any) -> ExcCodes:
    """There is no unit with this id."""
    return ExcCodes.GATEWAY_NO_RESPONSE


async def _end_others(grace_s: float) -> None:
    """Let the loop's other tasks end, and cancel those that do not."""
    await asyncio.sleep(0)
    others = [task for task in asyncio.all_tasks() if task is not asyncio.current_task()]
    if others:
        await asyncio.wait(others, timeout=grace_s)
    for task in others:
        task.cancel()
    await asyncio.gather(*others, return_exceptions=True)
    await asyncio.sleep(0)
