"""CAN buses by name: a real adapter, a socketcand server or a bus within one process."""

from __future__ import annotations

import errno
import select
import socket
import threading
from typing import Any

import can
import serial
from can.interfaces.slcan import slcanBus
from can.interfaces.socketcand import SocketCanDaemonBus

from drivers.errors import ConnectionFailed

INTERFACES = ("virtual", "socketcan", "slcan", "socketcand")
_CHECK = "start the server or check interface, channel and adapter in the rig file"


class SocketcandBus(SocketCanDaemonBus):
    """python-can's socketcand client that detects when its peer is gone.

    The library's client then reads empty answers for ever and keeps a core busy. Here receiving raises
    can.CanOperationError, again and again but at a slow pace.
    """

    def __init__(self, channel: str, host: str, port: int, **kwargs: Any) -> None:
        self._gone = threading.Event()
        self._pace = threading.Event()
        try:
            super().__init__(channel, host, port, **kwargs)  # type: ignore[no-untyped-call]
        except BaseException:
            self._is_shutdown = True  # nothing to shut down but the socket
            self._wire().close()
            raise

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if self._gone.is_set():
            self._pace.wait(0.1)
            raise can.CanOperationError(f"{self.channel_info}: the server has closed the connection")
        if self._peer_closed(timeout):
            self._gone.set()
            raise can.CanOperationError(f"{self.channel_info}: the server has closed the connection")
        message: can.Message | None
        message, filtered = super()._recv_internal(0.0)  # type: ignore[no-untyped-call]
        return message, bool(filtered)

    def _peer_closed(self, timeout: float | None) -> bool:
        """Wait for data; True if it is the end of the connection."""
        if self._has_buffered_frame():
            return False
        wire = self._wire()
        try:
            ready, _, _ = select.select([wire], [], [], timeout)
            return bool(ready) and wire.recv(1, socket.MSG_PEEK) == b""
        except (OSError, ValueError):
            return True

    def _wire(self) -> socket.socket:
        wire: socket.socket = vars(self)["_SocketCanDaemonBus__socket"]
        return wire

    def _has_buffered_frame(self) -> bool:
        return len(vars(self)["_SocketCanDaemonBus__message_buffer"]) > 0

    def shutdown(self) -> None:
        """Close the connection."""
        self._pace.set()
        super().shutdown()  # type: ignore[no-untyped-call]


def open_bus(
    interface: str,
    channel: str,
    host: str | None = None,
    port: int | None = None,
    bitrate: int | None = None,
) -> can.BusABC:
    """Open a CAN bus: 'virtual', 'socketcan', 'slcan' or 'socketcand' (needs host and port).

    Raises ConnectionFailed, and ValueError for another interface.
    """
    if interface not in INTERFACES:
        raise ValueError(f"CAN interface {interface!r} is none of {', '.join(INTERFACES)}")
    where = f"{interface} {channel}" + (f" at {host}:{port}" if host else "")
    try:
        if interface == "socketcand":
            if host is None or port is None:
                raise ValueError("socketcand needs host and port")
            _probe_server(host, port)
            return SocketcandBus(channel, host, port, tcp_tune=hasattr(socket, "TCP_QUICKACK"))
        settings: dict[str, Any] = {} if bitrate is None else {"bitrate": bitrate}
        if interface == "slcan":
            return _open_slcan(channel, settings)
        return can.Bus(interface=interface, channel=channel, **settings)
    except (can.CanError, OSError, ImportError) as error:
        if getattr(error, "errno", None) in (errno.EAGAIN, errno.EBUSY):
            raise ConnectionFailed("CAN line", where, "another program has the port", "end that program") from error
        reason = " ".join(str(error).split())
        raise ConnectionFailed("CAN line", where, f"cannot be opened: {reason}", _CHECK) from error


def _open_slcan(channel: str, settings: dict[str, Any]) -> can.BusABC:
    """An adapter whose serial port nobody else may open: the library's client lets others in.

    Asked for before a word is sent, since opening the channel anew would interrupt whoever has it; the kernel frees the
    port however its owner ends.
    """
    serial.serial_for_url(channel.split("@", maxsplit=1)[0], exclusive=True).close()
    bus = slcanBus(channel, **settings)
    bus.serialPortOrig.exclusive = True
    return bus


def _probe_server(host: str, port: int) -> None:
    """Fail early if no server answers: the library's client retries for ten seconds, then waits for ever."""
    with socket.create_connection((host, port), timeout=2.0) as wire:
        greeting = wire.recv(64)
    if not greeting.startswith(b"< hi >"):
        raise ConnectionError(f"not a socketcand server; its greeting is {greeting!r}")
