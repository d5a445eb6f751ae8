"""Bare CiA 402 drives on an in-process bus, for the driver's tests.

One SYNC is one step of motion. Does not model dynamics, the software limits' effect on a running move, PDO
inhibit times or a bus load; the compensation bank only as far as the state of its objects.
"""

from __future__ import annotations

import struct
import threading
import zlib
from collections.abc import Callable

import can

from drivers.can.can_line import CanLine
from drivers.drives.drive_group import DriveGroup, GroupTiming
from drivers.drives.drive_records import DriveTimeouts
from drivers.drives.servo_drive import DriveExpectation, ServoDrive
from pkm_rig.rig.clock import VirtualClock
from pkm_rig.virtual.embedded_bus import EmbeddedBus

VENDOR, PRODUCT = 0x99, 0x402
Object = tuple[int, int]


class ScriptedDrive:
    """One drive's objects and state machine. Flags let a test make it misbehave."""

    def __init__(self, node_id: int, partner: int, send: Callable[[int, bytes], None]) -> None:
        self.node_id = node_id
        self.send = send
        self.status = 0x40
        self.position = self.demand = 0
        self.controlwords: list[int] = []
        self.writes: list[Object] = []
        self.steps_to_go = 0
        self.acknowledge = True
        self.silent_pdo = False
        self.silent = False
        self.stuck = False
        self.refuse: dict[Object, int] = {}
        self._transfer: tuple[Object, bytearray] | None = None
        self._upload = b""
        self.objects: dict[Object, bytes] = {}
        for (index, sub), layout, value in _dictionary(node_id, partner):
            self.objects[index, sub] = struct.pack(layout, value)

    def integer(self, index: int, sub: int = 0) -> int:
        return int.from_bytes(self.objects[index, sub], "little", signed=index in (0x607A,))

    def control(self, word: int) -> None:
        self.controlwords.append(word)
        if self.status & 0x4F == 0x08:
            if word & 0x80:
                self.status = 0x40
        elif word & 0x02 == 0:
            self.status = 0x40
        elif word & 0x06 == 0x02:
            self.status = 0x07 if self.status & 0x6F in (0x27, 0x07) else 0x40
            self.steps_to_go = 0
        elif word & 0x0F == 0x06:
            self.status = 0x21
        elif word & 0x0F == 0x07 and self.status & 0x6F in (0x21, 0x23, 0x27):
            self.status = 0x23
        elif word & 0x0F == 0x0F and self.status & 0x6F in (0x23, 0x27):
            self._operate(word)

    def _operate(self, word: int) -> None:
        acknowledged = self.status & 0x1000
        reached = self.status & 0x0400 or (0x0400 if self.status & 0x6F == 0x23 else 0)
        if word & 0x10 and self.acknowledge and not acknowledged:
            acknowledged, reached, self.steps_to_go = 0x1000, 0, 3
        elif not word & 0x10:
            acknowledged = 0
        self.status = 0x27 | acknowledged | reached

    def sync(self) -> None:
        if self.steps_to_go and not self.stuck:
            self.steps_to_go -= 1
            self.demand = self.position = self.integer(0x607A)
            if self.steps_to_go == 0:
                self.status |= 0x0400
        if not (self.silent_pdo or self.silent):
            self.send(0x180 + self.node_id, struct.pack("<Hih", self.status, self.position, -250))
            self.send(0x280 + self.node_id, struct.pack("<ii", self.demand, 0))

    def sdo(self, data: bytes) -> None:
        command = data[0]
        key: Object = (data[1] | data[2] << 8, data[3])
        if self.silent or command == 0x80:
            return
        if command & 0xE0 == 0x20:
            self._begin_download(key, data)
        elif command & 0xE0 == 0x00:
            self._download_segment(data)
        elif command & 0xE0 == 0x40:
            self._begin_upload(key)
        elif command & 0xE0 == 0x60:
            self._upload_segment(command)
        else:  # no block transfer
            self._reply(struct.pack("<BHBI", 0x80, *key, 0x05040001))

    def _begin_download(self, key: Object, data: bytes) -> None:
        if data[0] & 0x02:
            length = 4 - (data[0] >> 2 & 3)
            self._store(key, bytes(data[4 : 4 + length]))
        else:
            self._transfer = (key, bytearray())
            self._reply(struct.pack("<BHB4x", 0x60, *key))

    def _download_segment(self, data: bytes) -> None:
        assert self._transfer is not None
        key, buffer = self._transfer
        buffer += data[1 : 8 - (data[0] >> 1 & 7)]
        if data[0] & 1:
            self._store(key, bytes(buffer), 0x20 | data[0] & 0x10)
        else:
            self._reply(bytes([0x20 | data[0] & 0x10, 0, 0, 0, 0, 0, 0, 0]))

    def _store(self, key: Object, value: bytes, segment: int | None = None) -> None:
        code = self.refuse.get(key, 0 if key in self.objects else 0x06020000)
        if code:
            self._reply(struct.pack("<BHBI", 0x80, *key, code))
            return
        self.writes.append(key)
        self.objects[key] = value
        self._react(key, value)
        head = struct.pack("<BHB4x", 0x60, *key) if segment is None else bytes([segment]) + bytes(7)
        self._reply(head)

    def _react(self, key: Object, value: bytes) -> None:
        index, sub = key
        if index == 0x6060:
            self.objects[0x6061, 0] = value
        elif index in (0x2101, 0x2102) and sub == 1:
            whole = zlib.crc32(value[:-4]).to_bytes(4, "little") == value[-4:]
            self.objects[index, 2] = value[-4:]
            self.objects[index, 3] = value[8:12]
            self.objects[index, 4] = value[12:16]
            self.objects[index, 5] = bytes([1 if whole else 2])
        elif key == (0x2100, 2):
            bank = value[0]
            self.objects[0x2100, 3] = value
            self.objects[0x2100, 4] = self.objects[0x2100 + bank, 2] if bank else bytes(4)
            self.objects[0x2100, 5] = self.objects[0x2100 + bank, 3] if bank else bytes(4)

    def _begin_upload(self, key: Object) -> None:
        if key == (0x6041, 0):
            self.objects[key] = struct.pack("<H", self.status)
        value = self.objects.get(key)
        if value is None:
            self._reply(struct.pack("<BHBI", 0x80, *key, 0x06020000))
        elif len(value) <= 4:
            head = 0x43 | (4 - len(value)) << 2
            self._reply(struct.pack("<BHB", head, *key) + value.ljust(4, b"\0"))
        else:
            self._upload = value
            self._reply(struct.pack("<BHBI", 0x41, *key, len(value)))

    def _upload_segment(self, command: int) -> None:
        part, self._upload = self._upload[:7], self._upload[7:]
        head = command & 0x10 | (7 - len(part)) << 1 | (0 if self._upload else 1)
        self._reply(bytes([head]) + part.ljust(7, b"\0"))

    def _reply(self, data: bytes) -> None:
        self.send(0x580 + self.node_id, data)


def _dictionary(node: int, partner: int) -> list[tuple[Object, str, int]]:
    entries: list[tuple[Object, str, int]] = [
        ((0x1000, 0), "<I", 0x00020192),
        ((0x1016, 1), "<I", 0),
        ((0x1017, 0), "<H", 0),
        ((0x6007, 0), "<h", 1),
        ((0x1018, 1), "<I", VENDOR),
        ((0x1018, 2), "<I", PRODUCT),
        ((0x1018, 3), "<I", 1),
        ((0x1018, 4), "<I", 7),
        ((0x6060, 0), "<b", 0),
        ((0x6061, 0), "<b", 0),
        ((0x6064, 0), "<i", 0),
        ((0x6076, 0), "<I", 2000),
        ((0x607A, 0), "<i", 0),
        ((0x607D, 1), "<i", -100_000_000),
        ((0x607D, 2), "<i", 100_000_000),
        ((0x608F, 1), "<I", 1_000_000),
        ((0x608F, 2), "<I", 1),
        ((0x6091, 1), "<I", 1),
        ((0x6091, 2), "<I", 1),
        ((0x6092, 1), "<I", 10_000),
        ((0x6092, 2), "<I", 1),
        ((0x2100, 7), "<I", 0xFFFFFFFF),
        *(((index, 0), "<I", 0) for index in (0x6081, 0x6083, 0x6084)),
        ((0x2103, 1), "<B", 1),
        *(((0x2100, sub), "<B", 0) for sub in (1, 2, 3, 6)),
        *(((0x2100, sub), "<I", 0) for sub in (4, 5)),
        *(((bank, sub), "<I", 0) for bank in (0x2101, 0x2102) for sub in (1, 2, 3, 4)),
        *(((bank, 5), "<B", 0) for bank in (0x2101, 0x2102)),
    ]
    pdos = {
        (0x1400, 0x1600): (0x200 + node, 255, [0x60400010]),
        (0x1401, 0x1601): (0x280 + partner, 255, [0x21000820, 0x21000B20]),
        (0x1800, 0x1A00): (0x180 + node, 1, [0x60410010, 0x60640020, 0x60770010]),
        (0x1801, 0x1A01): (0x280 + node, 1, [0x60620020, 0x606C0020]),
    }
    for (communication, mapping), (cob_id, kind, mapped) in pdos.items():
        entries += [((communication, 1), "<I", cob_id), ((communication, 2), "<B", kind)]
        entries += [((mapping, 0), "<B", len(mapped))]
        entries += [((mapping, i), "<I", value) for i, value in enumerate(mapped, start=1)]
    return entries


class Rig:
    """Two scripted drives, the line to them and their drivers, in virtual time."""

    def __init__(self, channel: str) -> None:
        self.clock = VirtualClock()
        self.far = EmbeddedBus(channel, self.clock)
        self.drives = {node: ScriptedDrive(node, 3 - node, self._send) for node in (1, 2)}
        self._closing = False
        self._states = dict.fromkeys(self.drives, 0)
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()
        self.line = CanLine(EmbeddedBus(channel, self.clock), "bus")
        self.servos = [self.servo(1), self.servo(2)]
        self.group = DriveGroup(self.servos, self.clock, timing=GroupTiming(pdo_timeout_s=0.2))

    def servo(self, node: int, **expected: float) -> ServoDrive:
        wanted = {"vendor": VENDOR, "product": PRODUCT, "metres_per_increment": 1e-8, **expected}
        return ServoDrive(
            self.line,
            node,
            f"drive {node}",
            self.clock,
            DriveExpectation(**wanted),
            partner_node_id=3 - node,
            timeouts=DriveTimeouts(sdo_s=0.1),
        )

    def connect(self) -> None:
        for servo in self.servos:
            servo.connect()

    def close(self) -> None:
        self.line.close()
        self._closing = True
        self._thread.join(5.0)
        self.far.shutdown()
        self.clock.close()

    def heartbeat(self, node: int, state: int) -> None:
        self._send(0x700 + node, bytes([state]))

    def emergency(self, node: int, code: int) -> None:
        self._send(0x080 + node, struct.pack("<HB5x", code, 1))

    def _send(self, cob_id: int, data: bytes) -> None:
        self.far.send(can.Message(arbitration_id=cob_id, data=data, is_extended_id=False))

    def _beat(self, node: int) -> None:
        if not self._closing and not self.drives[node].silent:
            self.heartbeat(node, self._states[node])
            self.clock.call_at(self.clock.now_s() + 0.5, lambda: self._beat(node))

    def _serve(self) -> None:
        while not self._closing:
            message = self.far.recv(0.02)
            if message is not None:
                self._take(message.arbitration_id, bytes(message.data))

    def _take(self, cob_id: int, data: bytes) -> None:
        for node, drive in self.drives.items():
            if cob_id == 0x80:
                drive.sync()
            elif cob_id == 0x200 + node:
                drive.control(struct.unpack("<H", data)[0])
            elif cob_id == 0x600 + node:
                drive.sdo(data)
            elif cob_id == 0 and data[1] in (0, node):
                self._states[node] = {1: 5, 128: 127}[data[0]]
                self._beat(node)
