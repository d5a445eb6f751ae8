"""A serial cable between two pseudo terminals. Not modelled: baud rate, parity, handshake."""

from __future__ import annotations

import os
import select
import termios
import threading
import tty


class PtyLink:
    """Two ends that each open like a serial port; what goes in at one comes out at the other."""

    def __init__(self) -> None:
        self._masters: list[int] = []
        self._slaves: list[int] = []  # kept open, so that the line stays up between clients
        for _ in range(2):
            master, slave = os.openpty()
            tty.setraw(slave, termios.TCSANOW)
            self._masters.append(master)
            self._slaves.append(slave)
        self.near, self.far = (os.ttyname(slave) for slave in self._slaves)
        self._wake, self._waker = os.pipe()
        self._closed = False
        self._thread = threading.Thread(target=self._carry, name="mock-cable", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Pull the cable. May be called again."""
        if self._closed:
            return
        self._closed = True
        os.write(self._waker, b"x")
        self._thread.join(timeout=5.0)
        for end in (*self._masters, *self._slaves, self._wake, self._waker):
            os.close(end)

    def _carry(self) -> None:
        others = dict(zip(self._masters, reversed(self._masters), strict=True))
        while not self._closed:
            ready, _, _ = select.select([*others, self._wake], [], [])
            for end in ready:
                if end in others:
                    try:
                        os.write(others[end], os.read(end, 4096))
                    except OSError:
                        return
