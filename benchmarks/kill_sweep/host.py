"""Runs one command of `pkm-rig` and kills its own process at a chosen operation: a store commit or a CAN write.

    python -m benchmarks.kill_sweep.host WINDOW:KIND:N LOG ARGUMENTS OF PKM-RIG ...

WINDOW is `start` (operations count from the beginning) or `tables` (from the first word of a table on). KIND is
`commit`, `can` (any frame) or `sdo` (frames of SDO transfers). Odd N kill before the operation, even N after it. With
`none` nothing is killed. LOG gets one JSON line: what struck, or how many operations there were in each window.
Nothing of the product knows of this: two functions of the libraries below it are wrapped.
"""

from __future__ import annotations

import json
import os
import signal
import struct
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import canopen
from sqlalchemy.engine.default import DefaultDialect

TABLE_OBJECTS = (0x2101, 0x2102)
_DOWNLOADS = (0x20, 0xC0)  # client command specifiers: an SDO download, expedited, by segments or by blocks


class Killer:
    """Counts operations and ends this process, without any farewell, at the chosen one."""

    def __init__(self, choice: str, log: Path) -> None:
        self.window, self.kind, number = ("", "", "0") if choice == "none" else choice.split(":")
        self.number, self.log = int(number), log
        self.counts: dict[str, int] = {}
        self._tables = False
        self._lock = threading.Lock()

    def around(self, kinds: tuple[str, ...], work: Callable[[], Any], *, begins_tables: bool = False) -> Any:
        """Do one operation, and die before or after it if it is the one."""
        with self._lock:
            self._tables = self._tables or begins_tables
            due = any(self._count(kind) for kind in kinds)
        if due and self.number % 2:
            self._die()
        result = work()
        if due:
            self._die()
        return result

    def _count(self, kind: str) -> bool:
        due = False
        for window in ("start", "tables") if self._tables else ("start",):
            name = f"{window}:{kind}"
            self.counts[name] = self.counts.get(name, 0) + 1
            due = due or (name == f"{self.window}:{self.kind}" and self.counts[name] == self.number)
        return due

    def write(self, **found: object) -> None:
        """Add a line to the log."""
        with self.log.open("a", encoding="utf-8") as file:
            file.write(json.dumps({**found, "tables": self._tables, "counts": self.counts}) + "\n")

    def _die(self) -> None:
        self.write(struck=f"{self.window}:{self.kind}:{self.number}")
        os.kill(os.getpid(), signal.SIGKILL)


def is_table_word(cob_id: int, data: bytes) -> bool:
    """Whether a frame begins to write a table into a bank."""
    if not 0x600 < cob_id < 0x680 or len(data) != 8 or data[0] & 0xE0 not in _DOWNLOADS:
        return False
    index, sub = struct.unpack_from("<HB", data, 1)
    return index in TABLE_OBJECTS and sub == 1


def install(killer: Killer) -> None:
    """Wrap the commit of databases and the sending of CAN frames."""
    commit, send = DefaultDialect.do_commit, canopen.Network.send_message

    def do_commit(self: Any, connection: Any) -> None:
        killer.around(("commit",), lambda: commit(self, connection))

    def send_message(self: Any, can_id: int, data: Any, remote: bool = False) -> None:
        kinds = ("can", "sdo") if 0x600 < can_id < 0x680 else ("can",)
        killer.around(
            kinds,
            lambda: send(self, can_id, data, remote),
            begins_tables=is_table_word(can_id, bytes(data)),
        )

    DefaultDialect.do_commit = do_commit  # type: ignore[method-assign]
    canopen.Network.send_message = send_message


def main() -> None:
    """Run the command; what it would exit with stays."""
    killer = Killer(sys.argv[1], Path(sys.argv[2]))
    install(killer)
    sys.argv = ["pkm-rig", *sys.argv[3:]]
    from pkm_rig.cli import main as run  # noqa: PLC0415  # what is wrapped must be wrapped before

    try:
        run()
    finally:
        killer.write(struck=None)


if __name__ == "__main__":
    main()
