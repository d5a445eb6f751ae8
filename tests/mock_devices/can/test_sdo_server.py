"""Block transfer against canopen's own client, and any frames whatsoever."""

from __future__ import annotations

import binascii
import struct

import pytest
from canopen.sdo.exceptions import SdoAbortedError
from hypothesis import given
from hypothesis import strategies as st

from mock_devices.can.sdo_server import SdoServer
from mock_devices.faults import NO_FAULTS, Fault, FaultPlan


class Memory:
    """One object, 0x2000:01, and a client's end of the wire."""

    def __init__(self, content: bytes = b"", faults: FaultPlan = NO_FAULTS) -> None:
        self.content = content
        self.writes = 0
        self.restarts = 0
        self.sent: list[bytes] = []
        self.passed_on: list[bytes] = []
        self.server = SdoServer(
            self, self.sent.append, lambda _id, data, _t: self.passed_on.append(bytes(data)), faults, self._restart
        )

    def _restart(self) -> None:
        self.restarts += 1

    def get_data(self, index: int, subindex: int, check_readable: bool = False) -> bytes:
        if (index, subindex) != (0x2000, 1):
            raise KeyError(index)
        return self.content

    def set_data(self, index: int, subindex: int, data: bytes, check_writable: bool = False) -> None:
        if (index, subindex) != (0x2000, 1):
            raise SdoAbortedError(0x06020000)
        self.content, self.writes = data, self.writes + 1

    def ask(self, *frames: bytes) -> list[bytes]:
        self.sent.clear()
        for frame in frames:
            self.server.on_request(0x601, bytearray(frame), 0.0)
        return list(self.sent)


def hexed(*texts: str) -> list[bytes]:
    return [bytes.fromhex(text) for text in texts]


def test_golden_download() -> None:
    memory = Memory()
    crc = binascii.crc_hqx(b"ABCDEFGHI", 0).to_bytes(2, "little").hex()
    assert memory.ask(*hexed("C600200109000000")) == hexed("A40020017F000000")
    assert memory.ask(*hexed("0141424344454647", "8248490000000000")) == hexed("A2027F0000000000")
    assert memory.ask(*hexed(f"D5{crc}0000000000")) == hexed("A100000000000000")
    assert (memory.content, memory.writes) == (b"ABCDEFGHI", 1)


def test_golden_upload() -> None:
    memory = Memory(b"ABCDEFGHI")
    crc = binascii.crc_hqx(b"ABCDEFGHI", 0).to_bytes(2, "little").hex()
    assert memory.ask(*hexed("A40020017F000000")) == hexed("C600200109000000")
    assert memory.ask(*hexed("A300000000000000")) == hexed("0141424344454647", "8248490000000000")
    assert memory.ask(*hexed("A2027F0000000000")) == hexed(f"D5{crc}0000000000")
    assert memory.ask(*hexed("A100000000000000")) == []


def test_a_lost_frame_is_asked_for_and_a_wrong_crc_stores_nothing() -> None:
    memory = Memory()
    memory.ask(*hexed("C600200109000000"))
    assert memory.ask(*hexed("8248490000000000")) == hexed("A2007F0000000000")
    assert memory.ask(*hexed("0141424344454647", "8248490000000000")) == hexed("A2027F0000000000")
    (answer,) = memory.ask(*hexed("D5FFFF0000000000"))
    assert struct.unpack_from("<I", answer, 4)[0] == 0x05040004
    assert memory.writes == 0


def test_unknown_objects_are_refused() -> None:
    memory = Memory(b"x")
    assert memory.ask(*hexed("A40030017F000000")) == hexed("8000300100000206")
    memory.ask(*hexed("C600300101000000"))
    memory.ask(*hexed("8141000000000000"))
    crc = binascii.crc_hqx(b"A", 0).to_bytes(2, "little").hex()
    assert memory.ask(*hexed(f"D9{crc}0000000000")) == hexed("8000300100000206")


@pytest.mark.parametrize("name", ["sdo-abort", "drive-reboot"])
def test_faults_strike_once(name: str) -> None:
    memory = Memory(b"", FaultPlan([Fault(name, 2)]))
    memory.ask(*hexed("C600200101000000"))
    answer = memory.ask(*hexed("8141000000000000"))
    assert answer == (hexed("8000200100000606") if name == "sdo-abort" else [])
    assert memory.restarts == (name == "drive-reboot")
    assert memory.writes == 0
    assert len(memory.ask(*hexed("C600200101000000"))) == 1


@given(st.lists(st.binary(min_size=8, max_size=8), max_size=30))
def test_any_frames_leave_a_server_that_works(frames: list[bytes]) -> None:
    memory = Memory(b"content")
    memory.ask(*frames)
    memory.ask(*hexed("8000000000000008"))  # an abort ends whatever was begun
    assert memory.ask(*hexed("A40020017F000000"))[0][0] & 0xE0 == 0xC0
