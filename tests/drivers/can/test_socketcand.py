"""Buses by name, and a daemon that goes away."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Iterator

import can
import pytest

from drivers.can.bus import SocketcandBus, open_bus
from drivers.can.can_line import CanLine
from drivers.errors import ConnectionFailed


class Daemon:
    """The handshake of socketcand for one client after another; frames go in by hand."""

    def __init__(self, greeting: bytes = b"< hi >") -> None:
        self._greeting = greeting
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self.wire: socket.socket | None = None
        self.sent: list[bytes] = []
        self.ready = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        while True:
            try:
                wire, _ = self._listener.accept()
            except OSError:
                return
            wire.sendall(self._greeting)
            if self._handshake(wire):
                self.wire = wire
                self.ready.set()
            else:
                wire.close()

    def _handshake(self, wire: socket.socket) -> bool:
        for expected in (b"< open can0 >", b"< rawmode >"):
            if wire.recv(256) != expected:
                return False
            wire.sendall(b"< ok >")
        return True

    def hang_up(self, *, abruptly: bool = False) -> None:
        """Close the connection; `abruptly`: as a computer that was switched off, without a farewell."""
        assert self.wire is not None
        if abruptly:
            self.wire.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.wire.close()

    def close(self) -> None:
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._thread.join(5.0)
        if self.wire is not None:
            self.wire.close()


@pytest.fixture
def daemon() -> Iterator[Daemon]:
    daemon = Daemon()
    yield daemon
    daemon.close()


def test_frames_pass(daemon: Daemon) -> None:
    bus = open_bus("socketcand", "can0", "127.0.0.1", daemon.port)
    assert isinstance(bus, SocketcandBus)
    assert daemon.ready.wait(5.0)
    assert daemon.wire is not None
    daemon.wire.sendall(b"< frame 181 1.0 0102 >< frame 182 1.0 03 >")
    first, second = bus.recv(5.0), bus.recv(5.0)
    assert first is not None
    assert second is not None
    assert (first.arbitration_id, bytes(first.data)) == (0x181, b"\1\2")
    assert second.arbitration_id == 0x182
    bus.send(can.Message(arbitration_id=0x80, is_extended_id=False))
    assert daemon.wire.recv(256) == b"< send 080 0  >"
    bus.shutdown()


@pytest.mark.parametrize("abruptly", [False, True])
def test_a_daemon_that_goes_away_is_an_error(daemon: Daemon, abruptly: bool) -> None:
    bus = open_bus("socketcand", "can0", "127.0.0.1", daemon.port)
    assert daemon.ready.wait(5.0)
    daemon.hang_up(abruptly=abruptly)
    for _ in range(2):
        with pytest.raises(can.CanOperationError, match="closed the connection"):
            bus.recv(5.0)
    bus.shutdown()


def test_a_bus_that_is_shut_down_receives_no_more(daemon: Daemon) -> None:
    """By another thread: what receives sees an error of the bus."""
    bus = open_bus("socketcand", "can0", "127.0.0.1", daemon.port)
    assert daemon.ready.wait(5.0)
    bus.shutdown()
    with pytest.raises(can.CanOperationError, match="closed the connection"):
        bus.recv(0.0)


def test_the_line_tells_that_it_is_lost(daemon: Daemon) -> None:
    with CanLine(open_bus("socketcand", "can0", "127.0.0.1", daemon.port), "can0") as line:
        assert daemon.ready.wait(5.0)
        daemon.hang_up()
        with line.received:
            assert line.received.wait_for(lambda: line.failed, 5.0)
        with pytest.raises(ConnectionFailed, match="the line is lost"):
            line.send_sync()


def test_nobody_listens() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    with pytest.raises(ConnectionFailed, match="cannot be opened"):
        open_bus("socketcand", "can0", "127.0.0.1", port)


def test_something_else_listens() -> None:
    daemon = Daemon(greeting=b"220 ready\r\n")
    with pytest.raises(ConnectionFailed, match="220 ready"):
        open_bus("socketcand", "can0", "127.0.0.1", daemon.port)
    daemon.close()


def test_a_wrong_channel(daemon: Daemon) -> None:
    with pytest.raises(ConnectionFailed):
        open_bus("socketcand", "can7", "127.0.0.1", daemon.port)


def test_other_interfaces() -> None:
    open_bus("virtual", "a channel").shutdown()
    with pytest.raises(ValueError, match="none of"):
        open_bus("udp_multicast", "x")
    with pytest.raises(ValueError, match="host and port"):
        open_bus("socketcand", "can0")
    with pytest.raises(ConnectionFailed):
        open_bus("socketcan", "no-such-can")
