"""One command at a time on a rig: a lock for each of its devices on this computer, whichever rig file names it.

A serial port is also opened exclusively. Another computer is not kept out: a second master is noticed by its traffic.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from urllib.parse import quote

from pkm_rig.errors import StoreError
from pkm_rig.rig.config import RigFile
from pkm_rig.store.lock import Lock


def lock_folder() -> Path:
    """Where locks of devices are: one place for all users of the computer."""
    return Path(tempfile.gettempdir()) / "pkm-rig-locks"


@contextmanager
def rig_lock(file: RigFile) -> Iterator[None]:
    """Hold all devices of a rig file; StoreError, naming its owner, if another process has one of them."""
    folder = lock_folder()
    try:
        folder.mkdir(exist_ok=True)
        if folder.stat().st_uid == os.getuid():
            folder.chmod(0o1777)
    except OSError as error:
        raise StoreError(f"{folder}: {error.strerror}; locks of devices need this folder") from error
    with ExitStack() as stack:
        for what, address in device_addresses(file):
            lock = Lock(folder / quote(f"{what} {address}", safe=""), f"the {what} at {address}")
            stack.callback(lock.release)
        yield


def device_addresses(file: RigFile) -> list[tuple[str, str]]:
    """What each device is and where on this computer or in its network; links to a port count as the port."""
    can, plc = file.can, file.plc
    found = [("station", _port(file.station.port))]
    if can.interface == "socketcand":
        found.append(("CAN bus", f"{_host(can.host)}:{can.port}/{can.channel}"))
    elif can.interface in ("socketcan", "slcan"):
        found.append(("CAN bus", _port(can.channel)))
    return [*found, ("PLC", _port(plc.serial_port) if plc.serial_port else f"{_host(plc.host)}:{plc.port}")]


def _host(name: str | None) -> str | None:
    """One name for this computer. Others' names are not looked up: that takes time, and may fail."""
    return "127.0.0.1" if name is not None and name.lower() in ("localhost", "::1") else name


def _port(name: str) -> str:
    return os.path.realpath(name) if os.path.exists(name) else name
