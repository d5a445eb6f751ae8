"""Opening things for a command: the rig (embedded or real), the store, a recording by id or folder."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

from calibration.base.errors import InputError
from calibration.recording.folder import read_folder
from calibration.recording.recording import Recording
from pkm_rig.rig.clock import ScaledClock
from pkm_rig.rig.config import embedded_rig_path, load_rig
from pkm_rig.rig.connection import connected
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.store import Store
from pkm_rig.virtual.mock_rig import embedded

STORE_NAME = "pkm-rig.sqlite"


@contextmanager
def one_core(choice: int = 0) -> Iterator[None]:
    """Keep this thread, and those it starts, on one core.

    In virtual time one thread acts at a time. Spread over cores, they spend a third of the run waking one
    another; `choice` keeps processes that run side by side apart.
    """
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {sorted(before)[choice % len(before)]})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


@contextmanager
def open_rig(
    rig_path: Path | None, *, real_time: bool = False, seed: int | None = None, homing: bool = False
) -> Iterator[Rig]:
    """A connected, supervised rig; without a path the embedded mock rig over its real protocols.

    `seed` chooses another embedded mock machine. For `homing` drives may have lost their reference.
    """
    path = rig_path or embedded_rig_path()
    file, machine = load_rig(path)
    if file.can.interface == "embedded":
        if seed is not None and file.mock is not None:
            file = file.model_copy(update={"mock": file.mock.model_copy(update={"seed": seed})})
        with (
            nullcontext() if real_time else one_core(os.getpid()),
            embedded(file, path, real_time=real_time) as mock,
            mock.clock.activity(),
            connected(mock.file, machine, mock.clock, mock.bus_factory, rig_path=path, homing=homing) as rig,
        ):
            yield rig
        return
    clock = ScaledClock(file.time_scale or 1.0)
    try:
        with connected(file, machine, clock, rig_path=path, homing=homing) as rig:
            yield rig
    finally:
        clock.close()


@contextmanager
def open_store(out: Path) -> Iterator[Store]:
    """The store in a folder, made if it is not there."""
    store = Store(out / STORE_NAME)
    try:
        yield store
    finally:
        store.close()


def find_recording(what: str, out: Path) -> Recording:
    """A recording by its folder, or by its campaign id in the store; InputError if it is neither."""
    folder = Path(what)
    if folder.is_dir():
        return read_folder(folder)
    if not (out / STORE_NAME).is_file():
        raise InputError(f"'{what}' is no recording folder, and there is no store in {out}; give --out")
    with open_store(out) as store:
        return store.recording(what)
