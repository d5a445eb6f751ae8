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

from mock_devices.faults import NO_FAULTS, FaultPlan
from mock_devices.seeds import generator
from mock_devices.station.mock_station import MockStation

_LONGEST_LINE = 4096

_SPLIT_S = 0.005  # host time: two pieces of one answer must not come in one read

Tamper = Callable[[bytes], bytes | None]


class LineGone(Exception):
    """The line has to be closed."""


class LineBuffer:
    """Splits received bytes into lines. CR LF ends a request; a lone LF discards a partial one."""

    def __init__(self) -> None:
        self._partial = b""

    def feed(self, data: bytes) -> list[bytes]:
        """The lines that are now complete, without their ends."""
        *ended, self._partial = (self._partial + data).split(b"\n")
        if len(self._partial) > _LONGEST_LINE:
            self._partial = b""
        return [line[:-1] for line in ended if line.endswith(b"\r") and len(line) > 1]


class StationServer:
    """Common part of both lines. `tamper` may change or drop (None) each answer, to simulate a bad line.

    While it is `silent` the station neither acts nor answers.

    So do the faults named serial-...; the affected byte and bit are drawn from `seed` and the number of the answer.
    """

    def __init__(self, station: MockStation, faults: FaultPlan = NO_FAULTS, seed: int = 1) -> None:
        self._station = station
        self.tamper: Tamper | None = None
        self.silent = False
        self._faults = faults
        self._seed = seed
        self._count = 0
        self._held = b""
        self._previous = b""
        self._pause = threading.Event()
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
        self._pause.set()
        os.write(self._wake_writer, b"x")
        self._thread.join(timeout=5.0)
        self._close_line()
        os.close(self._wake_reader)
        os.close(self._wake_writer)

    def _serve(self) -> None:
        raise NotImplementedError

    def _close_line(self) -> None:
        raise NotImplementedError

    def _answers(self, lines: list[bytes]) -> list[bytes]:
        """The bytes to send for some requests, in pieces that are sent separately."""
        pieces: list[bytes] = []
        for line in lines:
            if self.silent:
                continue
            answer = self._station.respond(line)
            if answer is not None and self.tamper is not None:
                answer = self.tamper(answer)
            if answer:
                pieces += self._corrupt_answer(answer)
        return pieces

    def _corrupt_answer(self, answer: bytes) -> list[bytes]:
        strikes, self._count = self._faults.strikes, self._count + 1
        held_answer, self._held = self._held, b""
        previous, self._previous = self._previous, answer
        if strikes("serial-gone"):
            raise LineGone
        if strikes("serial-lost"):
            return [held_answer] if held_answer else []
        if strikes("serial-late"):
            self._held = answer
            return [held_answer] if held_answer else []
        if strikes("serial-previous") and previous:
            answer = previous
        random = generator(self._seed, "serial", self._count)
        at, bit = int(random.integers(len(answer))), int(random.integers(8))
        if strikes("serial-dropped-byte"):
            answer = answer[:at] + answer[at + 1 :]
        if strikes("serial-doubled-byte"):
            answer = answer[: at + 1] + answer[at:]
        if strikes("serial-garbled-byte"):
            answer = answer[:at] + bytes([answer[at] ^ 1 << bit]) + answer[at + 1 :]
        if strikes("serial-split"):
            return [held_answer, answer[:at], answer[at:]]
        return [held_answer, answer]


class PtyStationServer(StationServer):
    """The station on a pseudo terminal. A line that went away comes back, under another name, with `plug_in`."""

    def __init__(self, station: MockStation, faults: FaultPlan = NO_FAULTS, seed: int = 1) -> None:
        super().__init__(station, faults, seed)
        self._old_slaves: list[int] = []
        self._open()
        self._thread.start()

    def _open(self) -> None:
        self._gone = False
        self._master, self._slave = os.openpty()  # the open slave keeps the line up between clients
        tty.setraw(self._slave, termios.TCSANOW)
        self._path = os.ttyname(self._slave)

    def plug_in(self) -> None:
        """Restore the line after it has gone."""
        if self._gone:
            self._open()
            os.write(self._wake_writer, b"x")

    @property
    def url(self) -> str:
        """Path of the terminal's other end."""
        return self._path

    def _serve(self) -> None:
        buffer = LineBuffer()
        while not self._closed:
            lines = [self._wake_reader] if self._gone else [self._master, self._wake_reader]
            ready, _, _ = select.select(lines, [], [])
            if self._wake_reader in ready:
                os.read(self._wake_reader, 1)
                continue
            try:
                for piece in self._answers(buffer.feed(os.read(self._master, 4096))):
                    self._write(piece)
            except LineGone:
                buffer = LineBuffer()
                self._gone = True
                self._hang_up()
            except OSError:
                return

    def _write(self, piece: bytes) -> None:
        while piece and not self._closed:
            piece = piece[os.write(self._master, piece) :]
            if "serial-split" in self._faults.struck:
                self._pause.wait(_SPLIT_S)

    def _hang_up(self) -> None:
        """Close the master side; the slave stays open, so that no other process gets a terminal of this name."""
        os.close(self._master)
        self._old_slaves.append(self._slave)

    def _close_line(self) -> None:
        if not self._gone:
            self._hang_up()
        for slave in self._old_slaves:
            os.close(slave)


class TcpStationServer(StationServer):
    """The station behind a serial device server, without RFC 2217."""

    def __init__(
        self,
        station: MockStation,
        host: str = "127.0.0.1",
        port: int = 0,
        *,
        faults: FaultPlan = NO_FAULTS,
        seed: int = 1,
    ) -> None:
        super().__init__(station, faults, seed)
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
                for piece in self._answers(self._clients[client].feed(data)):
                    client.sendall(piece)
                return
        except (OSError, LineGone):
            pass
        del self._clients[client]
        client.close()

    def _close_line(self) -> None:
        for client in self._clients:
            with contextlib.suppress(OSError):
                client.close()
        self._listener.close()
