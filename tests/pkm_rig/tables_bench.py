"""An embedded mock rig whose host can die at any write: on the bus, or in the store."""

from __future__ import annotations

import contextlib
import shutil
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import can
import numpy as np

from calibration.compensation.tables import CompensationTable
from calibration.model.operating_conditions import OperatingConditions
from drivers.drives.table_image import encode_table
from pkm_rig.rig.config import embedded_rig_path, load_rig
from pkm_rig.rig.connection import connect_rig
from pkm_rig.rig.rig import Rig
from pkm_rig.store.store import Store
from pkm_rig.virtual.embedded_bus import EmbeddedBus
from pkm_rig.virtual.mock_rig import Embedded, embedded_mock_rig
from tests.pkm_rig.conftest import short_rig_file

FORMER, CAMPAIGN = 3, "campaign-1"
_UPLOADS = (0x40, 0x60, 0xA0)  # requests that only read, by their command bits
_SDO, _RPDO1 = range(0x601, 0x680), range(0x201, 0x280)


class Killed(BaseException):
    """SIGKILL: nothing that the host does after it reaches a drive or the store."""


class Life:
    """Counts the writes of a host; it dies before the one with number `last` (0: never)."""

    def __init__(self, last: int = 0, seen: Callable[[], None] = lambda: None) -> None:
        self.last, self.writes, self.dead, self._seen = last, 0, False, seen

    def write(self) -> None:
        """About to write."""
        self._seen()
        self.writes += 1
        self.dead = self.dead or self.writes == self.last
        self.live()

    def live(self) -> None:
        """Raise Killed if dead."""
        if self.dead:
            raise Killed


class MortalBus(EmbeddedBus):
    """The host's bus. What other threads of a dead host send is lost."""

    life = Life()
    unheard, lost = 0, 0  # a node that hears nothing of what is sent, and how many frames it missed

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if threading.current_thread() is not threading.main_thread():
            if self.life.dead:
                return
        elif msg.arbitration_id in _RPDO1 or (msg.arbitration_id in _SDO and msg.data[0] & 0xE0 not in _UPLOADS):
            self.life.write()
        else:
            self.life.live()
        if msg.arbitration_id & 0x7F != self.unheard or not self.unheard:
            super().send(msg, timeout)
        else:
            self.lost += 1


class MortalStore(Store):
    """The host's store."""

    life = Life()

    @contextmanager
    def writing(self):
        self.life.write()
        with super().writing() as connection:
            yield connection


def table(correction_m: float = 20e-6, payload_kg: float = 0.0) -> CompensationTable:
    """The same correction everywhere."""
    return CompensationTable(
        start_m=np.array([0.5, 0.5]),
        step_m=np.array([0.4, 0.4]),
        correction_m=np.full((2, 3, 3), correction_m),
        conditions=OperatingConditions(payload_kg, (0.0, 0.0, 0.0), {"struts": 20.0}),
    )


def images(rig: Rig, generation: int) -> list[bytes]:
    """One image a drive."""
    return [encode_table(image) for image in rig.images(table(generation * 1e-6), generation)]


DriveContents = tuple[tuple[int, int, bytes, bytes], ...]


@dataclass(frozen=True)
class World:
    """What outlives a host: the drives, and the store's file as it was."""

    drives: DriveContents
    store: Path


class TablesBench:
    """A mock rig that goes on while hosts come and go."""

    def __init__(self, mock: Embedded, folder: Path) -> None:
        self.mock, self.path = mock, folder / "store.sqlite"
        self.file = mock.file
        _, self.machine = load_rig(embedded_rig_path())
        self.said: list[str] = []
        probe = mock.bus_factory()
        self._channel = probe.channel_id
        probe.shutdown()

    @contextmanager
    def host(
        self, last: int = 0, seen: Callable[[], None] = lambda: None, guard_s: float | None = None
    ) -> Iterator[tuple[Rig, Store, Life]]:
        """A program that is connected, until it ends or dies before its write number `last` after connecting.

        `seen` is called before each write; `guard_s` is the host time in which an answer has to come.
        """
        life = Life(0, seen)

        def bus() -> MortalBus:
            made = MortalBus(self._channel, self.mock.clock)
            made.life = life
            return made

        store = MortalStore(self.path)
        store.life = life
        try:
            with (
                contextlib.suppress(Killed),
                connect_rig(self.file, self.machine, self.mock.clock, bus, guard_s=guard_s) as rig,
            ):
                life.writes, life.last = 0, last
                yield rig, store, life
                life.last = 0
        finally:
            store.close()

    @property
    def compensations(self):
        """What the drives really hold."""
        return [drive.compensation for drive in self.mock.mock.drives]

    def reset(self, former: list[bytes] | None) -> None:
        """The drives as before any of it: `former` kept in bank 1, or nothing."""
        for number, comp in enumerate(self.compensations):
            comp.mode, comp.active_bank = 0, 0
            for bank in comp.banks.values():
                bank.write(b"")
            if former is not None:
                comp.banks[1].write(former[number])
                comp.mode, comp.active_bank = 1, 1

    def world(self, copies: Path) -> World:
        """Drives and store as a host that dies now leaves them; the store's files are copied into a folder."""
        copies.mkdir(parents=True)
        for file in self.path.parent.glob(f"{self.path.name}*"):
            shutil.copy(file, copies / file.name)
        return World(self.drives(), copies / self.path.name)

    def drives(self) -> DriveContents:
        """Mode, active bank and both images of every drive."""
        return tuple((c.mode, c.active_bank, c.banks[1].image, c.banks[2].image) for c in self.compensations)

    def restore(self, world: World) -> None:
        """Have the drives, and the store of the next host, be those of a world."""
        self.path = world.store
        for comp, (mode, active, *contents) in zip(self.compensations, world.drives, strict=True):
            for number, image in enumerate(contents, start=1):
                comp.banks[number].write(image)
            comp.mode, comp.active_bank = mode, active

    def used(self) -> list[int]:
        """The generation that each drive uses; 0 is none."""
        return [0 if c.table_in_use is None else c.table_in_use.generation for c in self.compensations]

    def modes(self) -> list[int]:
        """The mode words: 0 off, 1 kept, 2 on trial."""
        return [c.mode for c in self.compensations]


@contextmanager
def tables_bench(folder: Path) -> Iterator[TablesBench]:
    """Start the mock rig."""
    file, _ = short_rig_file()
    with embedded_mock_rig(file, embedded_rig_path()) as mock, mock.clock.activity():
        yield TablesBench(mock, folder)


__all__ = ["CAMPAIGN", "FORMER", "Killed", "Life", "TablesBench", "World", "images", "table", "tables_bench"]
