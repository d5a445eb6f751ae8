"""Ways to a PLC: Modbus TCP, Modbus TCP inside TLS, and RTU on a serial line. One client for each, never retrying."""

from __future__ import annotations

import asyncio
import ssl
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pymodbus import FramerType
from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient
from pymodbus.client.base import ModbusBaseClient
from pymodbus.transport import CommParams, CommType


@dataclass(frozen=True)
class TcpLine:
    """Modbus TCP."""

    host: str
    port: int = 502

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


@dataclass(frozen=True)
class TlsLine:
    """Modbus TCP inside TLS. The PLC's certificate must be signed by `ca_file` and name `host`.

    `certificate_file` and `key_file` are ours, where the PLC asks for one.
    """

    host: str
    ca_file: Path
    port: int = 802
    certificate_file: Path | None = None
    key_file: Path | None = None

    def __str__(self) -> str:
        return f"{self.host}:{self.port} (TLS)"

    async def try_handshake(self, timeout_s: float) -> None:
        """Connect, listen and leave again. Raises OSError, of which ssl.SSLError says why a handshake failed.

        In TLS 1.3 a client takes the handshake for done before the PLC has looked at its certificate: that this was
        refused is only heard afterwards.
        """
        opening = asyncio.open_connection(self.host, self.port, ssl=self.context(), server_hostname=self.host)
        try:
            reader, writer = await asyncio.wait_for(opening, timeout_s)
            try:
                heard = await asyncio.wait_for(reader.read(1), timeout_s)
            except TimeoutError:
                return  # it waits for a request
            finally:
                writer.transport.abort()
        except ConnectionResetError:
            heard = b""
        if not heard:
            raise ssl.SSLError("the PLC hangs up after the handshake: it may refuse our certificate, or ask for one")

    def context(self) -> ssl.SSLContext:
        """Certificates required, host names checked, TLS 1.2 or newer. Raises OSError (ssl.SSLError included)."""
        context = ssl.create_default_context(ssl.Purpose.SERVER_AUTH, cafile=str(self.ca_file))
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        if self.certificate_file is not None:
            context.load_cert_chain(self.certificate_file, self.key_file)
        return context


@dataclass(frozen=True)
class RtuLine:
    """Modbus RTU on a serial port."""

    port: str
    baudrate: int = 115_200
    parity: Literal["N", "E", "O"] = "E"
    stop_bits: Literal[1, 2] = 1

    def __str__(self) -> str:
        return f"{self.port} (RTU, {self.baudrate} Bd, 8{self.parity}{self.stop_bits})"


ModbusLine = TcpLine | TlsLine | RtuLine


class _TlsClient(AsyncModbusTcpClient):
    """TLS around the frames of Modbus TCP, as Modbus security has it; the library's own leaves their header out."""

    def __init__(self, line: TlsLine, reply_timeout_s: float) -> None:
        self.comm_params = CommParams(
            comm_type=CommType.TLS,
            comm_name="comm",
            host=line.host,
            port=line.port,
            sslctx=line.context(),
            reconnect_delay=0,
            reconnect_delay_max=0,
            timeout_connect=reply_timeout_s,
        )
        super().__init__("", framer=FramerType.SOCKET, retries=0, timeout=reply_timeout_s)


def make_client(line: ModbusLine, reply_timeout_s: float) -> ModbusBaseClient:
    """A client that is not connected yet; `reply_timeout_s` is host time. Raises OSError for bad certificates."""
    if isinstance(line, TlsLine):
        return _TlsClient(line, reply_timeout_s)
    if isinstance(line, RtuLine):
        return AsyncModbusSerialClient(
            line.port,
            baudrate=line.baudrate,
            parity=line.parity,
            stopbits=line.stop_bits,
            retries=0,
            timeout=reply_timeout_s,
            reconnect_delay=0,
        )
    return AsyncModbusTcpClient(line.host, port=line.port, retries=0, timeout=reply_timeout_s, reconnect_delay=0)
