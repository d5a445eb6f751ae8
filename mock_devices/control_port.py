"""A port on loopback where programs change a running mock rig: the lines of `commands`, after a token.

Only a mock has it: nothing of the drivers or of the application knows it, and no hardware is reached through it.
"""

from __future__ import annotations

import hmac
import socketserver
import threading
from collections.abc import Callable

HOST = "127.0.0.1"
MOST_BYTES = 1000  # of a line
MOST_CONNECTIONS = 8
IDLE_S = 600.0


class ControlPort(socketserver.ThreadingTCPServer):
    """Serves lines of text: first `token TOKEN`, then one answer a line, `ok: ...` or `not done: ...`.

    A first line that is anything else ends the connection: a request of a browser does nothing. `execute` raises
    ValueError in one line for what cannot be done. A port of 0 takes a free one.
    """

    allow_reuse_address = True
    daemon_threads = True

    def __init__(self, port: int, token: str, execute: Callable[[str], str]) -> None:
        if len(token) < 16:
            raise ValueError("the token of the control port has fewer than 16 characters; take a longer one")
        self.token, self.execute = token, execute
        self._free = threading.BoundedSemaphore(MOST_CONNECTIONS)
        super().__init__((HOST, port), _Lines)
        self._thread = threading.Thread(target=self.serve_forever, args=(0.1,), name="mock-control", daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        """The port."""
        return int(self.server_address[1])

    def close(self) -> None:
        """Stop serving."""
        self.shutdown()
        self.server_close()
        self._thread.join(timeout=5.0)

    def handle_error(self, request: object, client_address: object) -> None:
        """A connection that was lost is nobody's error."""

    def carries(self, line: str) -> str:
        """The answer to a line."""
        try:
            return f"ok: {self.execute(line)}"
        except ValueError as error:
            return f"not done: {error}"

    def enter(self) -> bool:
        """Take one of the few connections; False if there is none."""
        return self._free.acquire(blocking=False)

    def leave(self) -> None:
        """Give it back."""
        self._free.release()


class _Lines(socketserver.StreamRequestHandler):
    timeout = IDLE_S
    server: ControlPort

    def handle(self) -> None:
        if not self.server.enter():
            self._say("not done: too many connections")
            return
        try:
            self._serve()
        finally:
            self.server.leave()

    def _serve(self) -> None:
        said = self._line()
        given = "" if said is None else said.removeprefix("token ")
        if said is None or said == given or not hmac.compare_digest(given.encode(), self.server.token.encode()):
            self._say("not done: the first line is `token TOKEN`, as the mock has printed it")
            return
        self._say("ok: connected")
        while (line := self._line()) is not None:
            self._say(self.server.carries(line) if line.strip() else "ok:")

    def _line(self) -> str | None:
        """The next line; None at the end, and for one that is too long or not text."""
        data = self.rfile.readline(MOST_BYTES + 1)
        if not data.endswith(b"\n") or len(data) > MOST_BYTES:
            return None
        try:
            return data.decode("utf-8").rstrip("\r\n")
        except UnicodeDecodeError:
            return None

    def _say(self, line: str) -> None:
        self.wfile.write(" ".join(line.split()).encode("utf-8") + b"\n")
