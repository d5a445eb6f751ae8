"""Connect the rig of a rig file, real or embedded, for as long as a job runs."""

from __future__ import annotations

import gc
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

from calibration.base.errors import InputError
from pkm_rig.rig.capabilities import Need, require_capabilities
from pkm_rig.rig.clock import ScaledClock
from pkm_rig.rig.config import load_rig
from pkm_rig.rig.connection import connect_rig, connect_watched_rig
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.rig_lock import rig_lock
from pkm_rig.store.place import has_store
from pkm_rig.store.sessions import Moment
from pkm_rig.store.store import Store, open_store
from pkm_rig.virtual.mock_rig import embedded_mock_rig


@contextmanager
def pin_to_one_core(choice: int = 0) -> Iterator[None]:
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
    path: Path,
    *,
    needs: Need = Need.NOTHING,
    real_time: bool = False,
    seed: int | None = None,
    homing: bool = False,
    after: Moment | None = None,
    moved_by_control: bool = False,
) -> Iterator[Rig]:
    """The connected, supervised rig of a rig file; one on the `embedded` bus is a mock rig over its real protocols.

    StoreError, naming it, if another process has one of its devices; what is embedded is nobody else's.
    InputError, before any device is touched, if its file shows that it cannot do what it `needs` to.
    `seed` chooses another embedded mock machine. For `homing` drives may have lost their reference. Rig time begins
    where the campaign that goes on ended (`after`), later by the time that has passed meanwhile; on the embedded rig,
    whose time is not the computer's, none has. A machine that is `moved_by_control` has station and PLC connected only.
    """
    file, machine = load_rig(path)
    require_capabilities(file, machine, path, needs)
    if moved_by_control and file.can.interface == "embedded":
        raise InputError(
            f"{path.name}: no control moves the embedded mock machine; serve one in another process with "
            "`pkm-rig mock --program FILE`"
        )
    if file.can.interface == "embedded":
        if seed is not None and file.mock is not None:
            file = file.model_copy(update={"mock": file.mock.model_copy(update={"seed": seed})})
        with (
            nullcontext() if real_time else pin_to_one_core(os.getpid()),
            embedded_mock_rig(file, path, real_time=real_time, start_s=after.t_rig_s if after else 0.0) as mock,
            mock.clock.activity(),
            connect_rig(mock.file, machine, mock.clock, mock.bus_factory, rig_path=path, homing=homing) as rig,
        ):
            rig.path = path
            yield rig
        return
    scale = file.time_scale or 1.0
    clock = ScaledClock(scale, 0.0 if after is None else after.t_rig_s + after.gap_s(time.time()) * scale)
    try:
        connected = (
            connect_watched_rig(file, machine, clock, rig_path=path)
            if moved_by_control
            else connect_rig(file, machine, clock, rig_path=path, homing=homing)
        )
        with rig_lock(file), connected as rig:
            rig.path = path
            gc.freeze()  # a collection of all that was loaded takes some 80 ms: drives led by SYNC would stop
            yield rig
    finally:
        clock.close()


@contextmanager
def store_if_there(out: Path) -> Iterator[Store | None]:
    """The store in a folder; None, and nothing created, if there is none."""
    if not has_store(out):
        yield None
        return
    with open_store(out) as store:
        yield store
