"""A small socketcand server: bridges TCP clients to a CAN bus of this process, raw mode only.

Not modelled: beacons, broadcast mode, filters, statistics, error frames, CAN FD, remote frames.
"""

from __future__ import annotations

import contextlib
import logging
import select
import socket
import threading
from collections.abc import Callable

import can

_NOTIFIER_TIMEOUT_S = 0.05
_HANDSHAKE_PAUSE_S = 0.05
_LONGEST_MESSAGE = 200

_log = logging.getLogger(__name__)


class SocketCandServer:
    """Serves `bus_factory`'s bus, one of its own for each client. Port 0 takes a free one.

    While it is `silent` the cable is cut: no frame passes either way, and the connections stay.
    """

    def __init__(self, bus_factory: Callable[[], can.BusABC], host: str = "127.0.0.1", port: int = 0) -> None:
        self.silent = False
        self._bus_factory = bus_factory
        self._listener = socket.create_server((host, port))
        self._clients: dict[socket.socket, _Client] = {}
        self._wake, self._waker = socket.socketpair()
        self._closed = False
        name = self._listener.getsockname()
        self.address: tuple[str, int] = (str(name[0]), int(name[1]))
        self._thread = threading.Thread(target=self._serve, name="mock-socketcand", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop serving and shut the clients' buses down. May be called again."""
        if self._closed:
            return
        self._closed = True
        self._waker.send(b"x")
        self._thread.join(timeout=5.0)
        for client in self._clients.values():
            client.close()
        for line in (self._listener, self._wake, self._waker):
            line.close()

    def _is_silent(self) -> bool:
        return self.silent

    def _serve(self) -> None:
        while not self._closed:
            ready, _, _ = select.select([self._listener, self._wake, *self._clients], [], [])
            for line in ready:
                if line is self._listener:
                    connection, _ = self._listener.accept()
                    self._clients[connection] = _Client(connection, self._bus_factory, self._is_silent)
                elif line in self._clients and not self._clients[line].receive():
                    self._clients.pop(line).close()


class _Client:
    """One connection: handshake first, then frames both ways."""

    def __init__(
        self, connection: socket.socket, bus_factory: Callable[[], can.BusABC], is_silent: Callable[[], bool]
    ) -> None:
        self._is_silent = is_silent
        self._connection = connection
        self._bus_factory = bus_factory
        self._bus: can.BusABC | None = None
        self._notifier: can.Notifier | None = None
        self._pause: threading.Timer | None = None
        self._lock = threading.Lock()
        self._closed = False
        self._text = ""
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._send("< hi >")

    def receive(self) -> bool:
        """Handle what has come; False if the client is gone."""
        try:
            data = self._connection.recv(4096)
        except OSError:
            return False
        if not data:
            return False
        self._text += data.decode("ascii", "replace")
        *messages, rest = self._text.split(">")
        self._text = rest if len(rest) <= _LONGEST_MESSAGE else ""
        try:
            for message in messages:
                self._handle(message.partition("<")[2].split())
        except can.CanError as error:  # the bus is off: there is nothing to serve any more
            _log.info("a socketcand client's bus is lost: %s", error)
            return False
        return True

    def close(self) -> None:
        """Leave the bus and hang up."""
        with self._lock:
            self._closed = True
            if self._pause is not None:
                self._pause.cancel()
            notifier, bus = self._notifier, self._bus
        if notifier is not None:
            notifier.stop()
        if bus is not None:
            bus.shutdown()
        with contextlib.suppress(OSError):
            self._connection.close()

    def _handle(self, words: list[str]) -> None:
        match words:
            case ["open", _] if self._bus is None:
                self._bus = self._bus_factory()
                self._send("< ok >")
            case ["rawmode"] if self._bus is not None and self._pause is None:
                self._send("< ok >")
                # A frame in the same packet as the answer would spoil the client's handshake.
                self._pause = threading.Timer(_HANDSHAKE_PAUSE_S, self._forward)
                self._pause.daemon = True
                self._pause.start()
            case ["send", identifier, length, *data] if self._bus is not None:
                self._send_frame(self._bus, identifier, length, data)
            case ["echo"]:
                self._send("< echo >")
            case _:
                self._send("< error unknown command >")

    def _send_frame(self, bus: can.BusABC, identifier: str, length: str, data: list[str]) -> None:
        try:
            content = bytes(int(byte, 16) for byte in data)
            if len(content) != int(length, 16):
                raise ValueError(length)
            message = can.Message(
                arbitration_id=int(identifier, 16), is_extended_id=len(identifier) > 3, data=content, check=True
            )
        except ValueError:
            self._send("< error malformed frame >")
            return
        if not self._is_silent():
            bus.send(message)

    def _forward(self) -> None:
        with self._lock:
            if not self._closed and self._bus is not None:
                self._notifier = can.Notifier(self._bus, [_Forwarder(self)], timeout=_NOTIFIER_TIMEOUT_S)

    def hang_up(self) -> None:
        """End the connection, so that the client notices that its bus is lost."""
        with contextlib.suppress(OSError):
            self._connection.shutdown(socket.SHUT_RDWR)

    def on_frame(self, frame: can.Message) -> None:
        """A frame on the bus: pass it on."""
        if self._is_silent():
            return
        identifier = f"{frame.arbitration_id:08X}" if frame.is_extended_id else f"{frame.arbitration_id:03X}"
        self._send(f"< frame {identifier} {frame.timestamp:.6f} {bytes(frame.data).hex().upper()} >")

    def _send(self, message: str) -> None:
        try:
            self._connection.sendall(message.encode("ascii"))
        except OSError as error:
            _log.info("a socketcand client is gone: %s", error)


class _Forwarder(can.Listener):
    """Hands frames to a client; a bus that fails ends its connection."""

    def __init__(self, client: _Client) -> None:
        self._client = client

    def on_message_received(self, msg: can.Message) -> None:
        self._client.on_frame(msg)

    def on_error(self, exc: Exception) -> None:
        _log.info("a socketcand client's bus is lost: %s", exc)
        self._client.hang_up()
