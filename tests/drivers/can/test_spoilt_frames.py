"""Every bit of every frame of a drive's SDO answers turned over: expedited, by segments, by blocks.

On the wire the CAN frame's own CRC covers all of it; behind an adapter or a gateway nothing does. What the protocol
leaves undetected, the content of short transfers, is in docs/reference/devices.md.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from typing import Any

import pytest
from canopen import LocalNode
from canopen.objectdictionary import DOMAIN, UNSIGNED32, ObjectDictionary, ODRecord, ODVariable

from drivers.can.drive_object import DriveObject
from drivers.can.sdo import SdoAccess
from drivers.errors import DeviceError
from mock_devices.can.sdo_server import SdoServer
from mock_devices.faults import NO_FAULTS

SPEED = DriveObject(0x6081, 0, "<I", "speed")
IMAGE = DriveObject(0x2000, 0, "", "image")
_BODY = bytes(range(100, 116))
CONTENT = _BODY + zlib.crc32(_BODY).to_bytes(4, "little")
GUARD_S = 0.001  # answers are there at once, and what a flip hid is waited for in vain


class MemoryLine:
    """The node's server called directly in place of a line. `flip` is frame, byte and bit of the answers to come."""

    name = "memory"

    def __init__(self, *, blocks: bool) -> None:
        dictionary = ObjectDictionary()
        identity = ODRecord("identity", 0x1018)
        dictionary.add_object(identity)
        for index, sub, kind in (
            (0x1000, 0, UNSIGNED32),
            (0x1018, 1, UNSIGNED32),
            (0x1018, 2, UNSIGNED32),
            (0x1018, 4, UNSIGNED32),
            (SPEED.index, 0, UNSIGNED32),
            (IMAGE.index, 0, DOMAIN),
        ):
            variable = ODVariable(f"{index:X}:{sub}", index, sub)
            variable.data_type, variable.access_type = kind, "rw"
            (identity.add_member if sub else dictionary.add_object)(variable)
        self.node = LocalNode(1, dictionary)
        self.node.sdo.network = self
        for index, sub in ((0x1000, 0), (0x1018, 1), (0x1018, 2), (0x1018, 4)):
            self.node.set_data(index, sub, bytes(4))
        self.node.set_data(SPEED.index, 0, (4711).to_bytes(4, "little"))
        self.node.set_data(IMAGE.index, 0, CONTENT)
        self.server = SdoServer(
            self.node, self._answer, self.node.sdo.on_request, NO_FAULTS, lambda: None, blocks=blocks
        )
        self.network = self
        self.flip: tuple[int, int, int] | None = None
        self.frames = 0

    def check(self) -> None:
        """The line is never lost."""

    def subscribe(self, _cob_id: int, callback: Callable[[int, bytearray, float], None]) -> None:
        self._hear = callback

    def send_message(self, cob_id: int, data: bytes, _remote: bool = False) -> None:
        if cob_id == 0x601:
            self.server.on_request(cob_id, bytearray(data), 0.0)
        else:
            self._answer(bytes(data))

    def _answer(self, frame: bytes) -> None:
        spoilt = bytearray(frame)
        if self.flip is not None and self.flip[0] == self.frames:
            spoilt[self.flip[1]] ^= 1 << self.flip[2]
        self.frames += 1
        self._hear(0x581, spoilt, 0.0)


def _access(blocks: bool) -> tuple[MemoryLine, SdoAccess]:
    line: Any = MemoryLine(blocks=blocks)
    access = SdoAccess(line, 1, "drive", GUARD_S)
    access.read(SPEED)
    if not blocks:
        access.read_bytes(IMAGE)  # finds that there are none
    return line, access


def _wrong(blocks: bool, transfer: Callable[[SdoAccess, MemoryLine], object], good: object) -> set[int]:
    """Bytes of answers in which a bit passed for another value; any exception but the driver's own fails the test."""
    line, access = _access(blocks)
    line.frames = 0
    assert transfer(access, line) == good
    frames, wrong = line.frames, set()
    for number in range(frames):
        for at in range(8):
            for bit in range(8):
                line, access = _access(blocks)
                line.frames, line.flip = 0, (number, at, bit)
                try:
                    if transfer(access, line) != good:
                        wrong.add(at)
                except DeviceError:
                    continue
    return wrong


def _written(access: SdoAccess, line: MemoryLine, entry: DriveObject, data: bytes) -> bytes:
    access.write_bytes(entry, data)
    return bytes(line.node.get_data(entry.index, 0))


def test_a_short_value_is_protected_but_for_its_content() -> None:
    assert _wrong(True, lambda access, _: access.read(SPEED), 4711) == {4, 5, 6, 7}


def test_and_altogether_where_it_is_read_twice() -> None:
    assert _wrong(True, lambda access, _: access.read_twice(SPEED), 4711) == set()


def test_a_table_by_segments_is_protected_by_its_own_checksum() -> None:
    def read(access: SdoAccess, _line: MemoryLine) -> bytes | None:
        data = access.read_bytes(IMAGE)
        return data if zlib.crc32(data[:-4]) == int.from_bytes(data[-4:], "little") else CONTENT  # refused

    assert _wrong(False, lambda access, _: access.read_bytes(IMAGE), CONTENT) == set(range(8))
    assert _wrong(False, read, CONTENT) == set()


@pytest.mark.parametrize("blocks", [True, False])
@pytest.mark.parametrize(("entry", "data"), [(SPEED, b"\1\2\3\4"), (IMAGE, CONTENT[::-1])])
def test_what_counts_as_written_is_written(blocks: bool, entry: DriveObject, data: bytes) -> None:
    assert _wrong(blocks, lambda access, line: _written(access, line, entry, data), data) == set()


def test_blocks_are_protected_altogether() -> None:
    assert _wrong(True, lambda access, _: access.read_bytes(IMAGE), CONTENT) == set()
