"""Who has what on this computer: files that belong to one running mock, and ports that are taken."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from calibration.base.errors import InputError
from pkm_rig.errors import StoreError
from pkm_rig.store.lock import Lock

HOST = "127.0.0.1"
_OTHERS = "or serve another rig on free ports with `pkm-rig mock --new-rig FILE`"


@contextmanager
def owned(path: Path, what: str) -> Iterator[None]:
    """Have a path for this process alone; the kernel gives it back however the process ends.

    InputError naming the owner if another process has it.
    """
    try:
        lock = Lock(path.with_name(f"{path.name}.lock"), f"{what} {path}")
    except StoreError as error:
        raise InputError(f"{error}; {_OTHERS}") from error
    try:
        yield
    finally:
        lock.release()


def require_free_port(what: str, port: int) -> None:
    """Raise InputError, naming port and owner, if a port on loopback is taken."""
    try:
        socket.create_server((HOST, port)).close()
    except OSError as error:
        raise InputError(f"{what} {port}: {error.strerror}{_owner_of(port)}; end it, {_OTHERS}") from error


def free_ports(count: int) -> list[int]:
    """Ports on loopback that nobody has now."""
    listeners = [socket.create_server((HOST, 0)) for _ in range(count)]
    numbers = [int(listener.getsockname()[1]) for listener in listeners]
    for listener in listeners:
        listener.close()
    return numbers


def _owner_of(port: int) -> str:
    """Process and command that listen on a port, as far as Linux tells us; else nothing."""
    with suppress(OSError, ValueError):
        lines = Path("/proc/net/tcp").read_text(encoding="ascii").splitlines()[1:]
        listening = [line.split() for line in lines]
        inodes = {words[9] for words in listening if words[3] == "0A" and int(words[1].split(":")[1], 16) == port}
        sockets = {f"socket:[{inode}]" for inode in inodes}
        for link in Path("/proc").glob("[0-9]*/fd/*"):
            with suppress(OSError):
                if os.readlink(link) in sockets:
                    process = link.parents[1]
                    command = (process / "cmdline").read_bytes().replace(b"\0", b" ").decode("utf-8", "replace")
                    return f" by process {process.name} ({command.strip()[:60]})"
    return ""
