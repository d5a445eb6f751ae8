"""The client of block transfers: golden frames, lost frames, any server."""

from __future__ import annotations

import queue

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.can.sdo_block import BlockTransfer, NoResponse, ProtocolBroken, TransferAborted
from tests.either import either
from tests.mock_devices.can.test_sdo_server import Memory, hexed


class Wire:
    """A server's end of the wire that loses the frames with these numbers, counted both ways."""

    def __init__(self, memory: Memory, lost: frozenset[int] = frozenset()) -> None:
        self.memory = memory
        self.lost = lost
        self.count = 0
        self.waiting: list[bytes] = []
        self.sent: list[bytes] = []

    def send(self, data: bytes) -> None:
        self.sent.append(data)
        if self._passes():
            self.waiting += [answer for answer in self.memory.ask(data) if self._passes()]

    def receive(self) -> bytes:
        if not self.waiting:
            raise queue.Empty
        return self.waiting.pop(0)

    def _passes(self) -> bool:
        self.count += 1
        return self.count not in self.lost


CONTENT = bytes(range(256)) * 5


@pytest.mark.parametrize("length", [1, 6, 7, 8, 127 * 7, 127 * 7 + 1, len(CONTENT)])
def test_there_and_back(length: int) -> None:
    memory = Memory()
    transfer = BlockTransfer(Wire(memory))
    transfer.download(0x2000, 1, CONTENT[:length])
    assert transfer.upload(0x2000, 1, 4096) == CONTENT[:length]
    assert memory.writes == 1


def test_golden_frames() -> None:
    wire = Wire(Memory())
    BlockTransfer(wire).download(0x2000, 1, b"ABCDEFGHI")
    assert wire.sent[:3] == hexed("C600200109000000", "0141424344454647", "8248490000000000")
    assert wire.sent[3][0] == 0xD5


BROKEN = (NoResponse, ProtocolBroken, TransferAborted)


@pytest.mark.parametrize("lost", range(4, 7))
def test_a_gap_in_a_block_is_seen_and_filled(lost: int) -> None:
    """Request, answer and start are frames 1 to 3; then three with the content."""
    wire = Wire(Memory(CONTENT[:20]), frozenset([lost]))
    assert BlockTransfer(wire).upload(0x2000, 1, 4096) == CONTENT[:20]
    assert [frame[1] for frame in wire.sent if frame[0] == 0xA2] == [lost - 4, 7 - lost]  # confirmed


@pytest.mark.parametrize("times", [1, 8, 9])
def test_a_frame_that_is_lost_again_and_again_is_asked_for_eight_times(times: int) -> None:
    """Request, answer and start are frames 1 to 3; then the content's only frame and what was received, in turn."""
    wire = Wire(Memory(CONTENT[:5]), frozenset(range(4, 4 + 2 * times, 2)))
    if times <= 8:
        assert BlockTransfer(wire).upload(0x2000, 1, 4096) == CONTENT[:5]
    else:
        with pytest.raises(ProtocolBroken, match="lost repeatedly"):
            BlockTransfer(wire).upload(0x2000, 1, 4096)


@given(st.frozensets(st.integers(1, 420), max_size=3), st.integers(1, len(CONTENT)))
def test_lost_frames_never_store_or_give_anything_wrong(lost: frozenset[int], length: int) -> None:
    memory = Memory(b"before")
    transfer = BlockTransfer(Wire(memory, lost))
    try:
        transfer.download(0x2000, 1, CONTENT[:length])
    except BROKEN:
        assert lost
        assert memory.content in (b"before", CONTENT[:length])
    else:
        assert memory.content == CONTENT[:length]
    assert memory.writes <= 1
    stored = memory.content
    try:
        content = BlockTransfer(Wire(memory, lost)).upload(0x2000, 1, 4096)
    except BROKEN:
        assert lost
    else:
        assert content == stored


class Babbler:
    """Answers with whatever a test gives it."""

    def __init__(self, frames: list[bytes]) -> None:
        self.frames = list(frames)

    def send(self, data: bytes) -> None: ...

    def receive(self) -> bytes:
        if not self.frames:
            raise queue.Empty
        return self.frames.pop(0)


_FRAMES = st.lists(
    st.one_of(
        st.binary(min_size=8, max_size=8),
        st.sampled_from(hexed("A40020017F000000", "C600200109000000", "A2027F0000000000", "A100000000000000")),
    ),
    max_size=12,
)


@given(_FRAMES, st.booleans())
def test_any_server_ends_in_a_declared_error_or_a_result(frames: list[bytes], download: bool) -> None:
    transfer = BlockTransfer(Babbler(frames))
    if download:
        _, complaint = either(lambda: transfer.download(0x2000, 1, b"ABCDEFGHI"), *BROKEN)
        content = b""
    else:
        content, complaint = either(lambda: transfer.upload(0x2000, 1, 100), *BROKEN)
    if complaint is None:
        assert frames
        assert len(content or b"") <= 107
    else:
        assert content in (None, b"")
