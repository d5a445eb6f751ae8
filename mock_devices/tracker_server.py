"""The station's lines: a pseudo terminal or serial over TCP, each served by one thread.

Not modelled: baud rate (bytes take no time), parity errors, hardware handshake.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import termios
import threading
import tty
from collections.abc import Callable

from mock_devices.station import Station

_LONGEST_LINE = 4096

Tamper = Callable[[bytes], bytes | None]


class LineBuffer:
    """Cuts received bytes into lines. CR LF ends a request; a lone LF clears what was begun."""

    def __init__(self) -> None:
        self._begun = b""

    def feed(self, data: bytes) -> list[bytes]:
        """The lines that are complete now, without their ends."""
        *ended, self._begun = (self._begun + data).split(b"\n")
        if len(self._begun) > _LONGEST_LINE:
            self._begun = b""
        return [line[:-1] for line in ended if line.endswith(b"\r") and len(line) > 1]


class TrackerServer:
    """Common part of both lines. `tamper` may change or swallow (None) each answer, to play a bad line."""

    def __init__(self, station: Station) -> None:
        self._station = station
        self.tamper: Tamper | None = None
        self._wake_reader, self._wake_writer = os.pipe()
        self._closed = False
        self._thread = threading.Thread(target=self._serve, name="mock-station", daemon=True)

    @property
    def url(self) -> str:
        """What pyserial's `serial_for_url` opens."""
        raise NotImplementedError

    def close(self) -> None:
        """Stop serving. May be called again."""
        if self._closed:
            return
        self._closed = True
        os.write(self._wake_writer, b"x")
        self._thread.join(timeout=5.0)
        self._close_line()
        os.close(self._wake_reader)
        os.close(self._wake_writer)

    def _serve(self) -> None:
        raise NotImplementedError

    def _close_line(self) -> None:
        raise NotImplementedError

    def _answers(self, lines: list[bytes]) -> bytes:
        answers = b""
        for line in lines:
            answer = self._station.respond(line)
            if answer is not None and self.tamper is not None:
                answer = self.tamper(answer)
            answers += answer or b""
        return answers


class PtyTrackerServer(TrackerServer):
    """The station on a pseudo terminal."""

    def __init__(self, station: Station) -> None:
        super().__init__(station)
        self._master, self._slave = os.openpty()  # the open slave keeps the line up between clients
        tty.setraw(self._slave, termios.TCSANOW)
        self._path = os.ttyname(self._slave)
        self._thread.start()

    @property
    def url(self) -> str:
        """Path of the terminal's other end."""
        return self._path

    def _serve(self) -> None:
        buffer = LineBuffer()
        while not self._closed:
            ready, _, _ = select.select([self._master, self._wake_reader], [], [])
            if self._master not in ready:
                continue
            try:
                answers = self._answers(buffer.feed(os.read(self._master, 4096)))
                while answers and not self._closed:
                    answers = answers[os.write(self._master, answers) :]
            except OSError:
                return

    def _close_line(self) -> None:
        os.close(self._master)
        os.close(self._slave)


class TcpTrackerServer(TrackerServer):
    """The station behind a serial device server, without RFC 2217."""

    def __init__(self, station: Station, host: str = "127.0.0.1", port: int = 0) -> None:
        super().__init__(station)
        self._listener = socket.create_server((host, port))
        self._clients: dict[socket.socket, LineBuffer] = {}
        self._thread.start()

    @property
    def url(self) -> str:
        """`socket://host:port`."""
        host, port = self._listener.getsockname()[:2]
        return f"socket://{host}:{port}"

    def _serve(self) -> None:
        while not self._closed:
            lines: list[socket.socket | int] = [self._listener, self._wake_reader, *self._clients]
            ready, _, _ = select.select(lines, [], [])
            for line in ready:
                if line is self._listener:
                    self._accept()
                elif isinstance(line, socket.socket):
                    self._exchange(line)

    def _accept(self) -> None:
        client, _ = self._listener.accept()
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._clients[client] = LineBuffer()

    def _exchange(self, client: socket.socket) -> None:
        try:
            data = client.recv(4096)
            if data:
                client.sendall(self._answers(self._clients[client].feed(data)))
                return
        except OSError:
            pass
        del self._clients[client]
        client.close()

    def _close_line(self) -> None:
        for client in self._clients:
            with contextlib.suppress(OSError):
                client.close()
        self._listener.close()
