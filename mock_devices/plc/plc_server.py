"""The PLC: a Modbus server (TCP, TLS or RTU) whose registers (docs/reference/plc.md) follow the plant at each request.

Not modelled: several masters with different rights, and power that goes when the emergency stop opens or our
heartbeat stays away: bits are only shown. The heartbeat word's limit is one for all masters.
"""

from __future__ import annotations

import asyncio
import ssl
import threading
from concurrent.futures import Future
from typing import Any, Literal, cast

from pymodbus import FramerType
from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusSerialServer, ModbusTcpServer, ModbusTlsServer
from pymodbus.simulator import DataType, SimData, SimDevice

from mock_devices.faults import NO_FAULTS, FaultPlan
from mock_devices.plant.base_plant import BasePlant
from mock_devices.plc.plc_registers import CHANGING, GOOD_INTERLOCKS, REGISTERS, PlcState
from mock_devices.pty_link import PtyLink

__all__ = ["CHANGING", "GOOD_INTERLOCKS", "PlcServer", "PlcState"]

UNIT = 1
_READ, _WRITE_SINGLE, _WRITE, _READ_WRITE = 3, 6, 16, 23
_HEADER = 7


class PlcServer:
    """Serves a PlcState in a thread of its own.

    `transport` is "tcp", "tls" (with `tls` as its context) or "rtu", which serves one end of a cable between
    pseudo terminals; `serial_port` is the other end. Port 0 takes a free one. While it is `silent` nothing is answered.
    """

    def __init__(
        self,
        plant: BasePlant,
        host: str = "127.0.0.1",
        port: int = 0,
        *,
        transport: Literal["tcp", "tls", "rtu"] = "tcp",
        tls: ssl.SSLContext | None = None,
        faults: FaultPlan = NO_FAULTS,
        master_limit_s: float = 2.0,
    ) -> None:
        self.state = PlcState(plant, faults, master_limit_s)
        self.silent = False
        self._faults = faults
        self._transport = transport
        self._tls = tls
        self._cable = PtyLink() if transport == "rtu" else None
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="mock-plc", daemon=True)
        self._thread.start()
        self._server: ModbusTcpServer | ModbusSerialServer | None = None
        try:
            self.address = self._run(self._listen(host, port)).result(timeout=10.0)
        except BaseException:
            self.close()
            raise

    @property
    def serial_port(self) -> str:
        """Where the master plugs in. Raises ValueError unless the transport is RTU."""
        if self._cable is None:
            raise ValueError("this PLC has no serial port")
        return self._cable.near

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
        if self._cable is not None:
            self._cable.close()

    def _run(self, coroutine: Any) -> Future[Any]:
        return asyncio.run_coroutine_threadsafe(coroutine, self._loop)

    async def _listen(self, host: str, port: int) -> tuple[str, int]:
        def block() -> list[SimData]:
            return [SimData(0, count=REGISTERS, values=0, datatype=DataType.REGISTERS)]

        units = [SimDevice(UNIT, simdata=block(), action=self._action)]
        units.append(SimDevice(0, simdata=block(), action=_nobody))  # every other unit id
        server = self._make_server(units, host, port)
        if not await server.listen():
            raise OSError(f"the mock PLC cannot listen on {host}:{port}")
        self._server = server
        if self._cable is not None:
            return self._cable.near, 0
        name = cast(asyncio.Server, server.transport).sockets[0].getsockname()
        return str(name[0]), int(name[1])

    def _make_server(self, units: list[SimDevice], host: str, port: int) -> ModbusTcpServer | ModbusSerialServer:
        if self._cable is not None:
            return ModbusSerialServer(units, port=self._cable.far, baudrate=115_200, trace_packet=self._tamper)
        if self._transport == "tls":
            return ModbusTlsServer(
                units, framer=FramerType.SOCKET, address=(host, port), sslctx=self._tls, trace_packet=self._tamper
            )
        return ModbusTcpServer(units, address=(host, port), trace_packet=self._tamper)

    def _tamper(self, sending: bool, data: bytes) -> bytes:
        """Spoil an answer where a fault strikes."""
        if not sending:
            return data
        if self.silent:
            return b""
        if self._faults.strikes("modbus-transaction"):
            data = self._other_transaction(data)
        if self._faults.strikes("modbus-short"):
            data = data[: len(data) // 2]
        if self._faults.strikes("modbus-reset"):
            self._reset_connections()
        return data

    def _other_transaction(self, data: bytes) -> bytes:
        if self._cable is not None or len(data) <= _HEADER:  # RTU frames carry none
            return data
        return bytes([data[0], data[1] ^ 0x5A]) + data[2:]

    def _reset_connections(self) -> None:
        if self._server is not None:
            for connection in list(self._server.active_connections.values()):
                if isinstance(connection.transport, asyncio.WriteTransport):
                    connection.transport.abort()

    async def _shut_down(self) -> None:
        if self._server is not None:
            # A client that is being let in while the listener closes would keep its socket open for ever.
            await asyncio.sleep(0)
            await _end_others(grace_s=1.0)
            if self._transport == "tls":  # a farewell in TLS would wait for the client's
                self._reset_connections()
                for _ in range(5):
                    await asyncio.sleep(0)
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
        if function not in (_READ, _WRITE_SINGLE, _WRITE, _READ_WRITE):
            return ExcCodes.ILLEGAL_FUNCTION
        reading = values is None or function != _READ_WRITE  # function 23 comes here twice, first to write
        if reading and self._faults.strikes("modbus-exception"):
            return ExcCodes.DEVICE_FAILURE
        if values is not None and not self.state.write(address, [int(value) for value in values]):
            return ExcCodes.ILLEGAL_ADDRESS
        if reading:
            registers[:REGISTERS] = self.state.answer()
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
