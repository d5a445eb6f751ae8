"""SDO block transfer of CiA 301, the client's side: long objects in blocks of up to 127 frames, with CRC.

Lost frames are repeated within their block. Any other failure ends the transfer with an abort; the server stores
nothing before the end of a download is confirmed.
"""

from __future__ import annotations

import binascii
import queue
import struct
from typing import Protocol

MOST_FRAMES = 127
_FRAME = 7
_MOST_REPEATS = 8

_UPLOAD, _DOWNLOAD = 0xA0, 0xC0  # what the client sends
_DOWNLOAD_ANSWER, _UPLOAD_ANSWER = 0xA0, 0xC0  # what the server answers
_ABORT = 0x80
_CRC, _SIZE = 0x04, 0x02
_BLOCK_ANSWER, _END, _START = 2, 1, 3

ABORT_TIMED_OUT = 0x05040000
ABORT_COMMAND = 0x05040001
ABORT_SEQUENCE = 0x05040003
ABORT_CRC = 0x05040004
ABORT_MEMORY = 0x05040005


class TransferAborted(Exception):
    """The server has ended the transfer with this abort code."""

    def __init__(self, code: int) -> None:
        super().__init__("the drive has ended the transfer")
        self.code = code


class ProtocolBroken(Exception):
    """The transfer cannot continue; an abort was sent to the server."""


class NoResponse(Exception):
    """The server has not answered in time; an abort was sent to it."""


class SdoWire(Protocol):
    """Carrier of the frames of one SDO channel."""

    def send(self, data: bytes) -> None:
        """Send eight bytes to the server."""
        ...

    def receive(self) -> bytes:
        """The next eight bytes from the server. Raises queue.Empty after the time-out."""
        ...


class BlockTransfer:
    """One block transfer on one channel at a time. Raises TransferAborted, ProtocolBroken and NoResponse."""

    def __init__(self, wire: SdoWire) -> None:
        self._wire = wire
        self._object = b"\0\0\0"

    def download(self, index: int, sub: int, data: bytes) -> None:
        """Write an object of one byte or more."""
        self._object = struct.pack("<HB", index, sub)
        answer = self._request(struct.pack("<B3sI", _DOWNLOAD | _CRC | _SIZE, self._object, len(data)))
        self._expect(answer, _DOWNLOAD_ANSWER, 0, self._object)
        checked, frames = bool(answer[0] & _CRC), self._block_size(answer[4])
        at, repeats = 0, 0
        while at < len(data):
            sent = self._send_block(data, at, frames)
            answer = self._receive()
            self._expect(answer, _DOWNLOAD_ANSWER, _BLOCK_ANSWER)
            confirmed, frames = answer[1], self._block_size(answer[2])
            if confirmed > sent:
                raise self._break(ABORT_SEQUENCE, f"{confirmed} frames are confirmed, {sent} were sent")
            repeats = 0 if confirmed else repeats + 1
            if repeats > _MOST_REPEATS:
                raise self._break(ABORT_TIMED_OUT, "frames are lost repeatedly")
            at += confirmed * _FRAME
        unused = -len(data) % _FRAME
        crc = binascii.crc_hqx(data, 0) if checked else 0
        answer = self._request(struct.pack("<BH5x", _DOWNLOAD | unused << 2 | _END, crc))
        self._expect(answer, _DOWNLOAD_ANSWER, _END)

    def upload(self, index: int, sub: int, most: int) -> bytes:
        """Read an object of at most `most` bytes; a short one may arrive without blocks, as CiA 301 allows."""
        self._object = struct.pack("<HB", index, sub)
        answer = self._request(struct.pack("<B3sBB2x", _UPLOAD | _CRC, self._object, MOST_FRAMES, 0))
        self._expect(answer, _UPLOAD_ANSWER, 0, self._object)
        checked = bool(answer[0] & _CRC)
        size: int | None = struct.unpack_from("<I", answer, 4)[0] if answer[0] & _SIZE else None
        if size is not None and size > most:
            raise self._break(ABORT_MEMORY, f"{size} bytes announced, at most {most} expected")
        self._wire.send(bytes([_UPLOAD | _START]) + bytes(7))
        data = bytearray()
        last, repeats = False, 0
        while not last:
            received, last = self._receive_block(data)
            repeats = 0 if received else repeats + 1
            if repeats > _MOST_REPEATS or len(data) > most + _FRAME:
                raise self._break(ABORT_SEQUENCE, "frames are lost repeatedly, or the object has no end")
            self._wire.send(bytes([_UPLOAD | _BLOCK_ANSWER, received, MOST_FRAMES]) + bytes(5))
        end = self._receive()
        self._expect(end, _UPLOAD_ANSWER, _END)
        del data[len(data) - (end[0] >> 2 & 7) :]
        if size is not None and len(data) != size:
            raise self._break(ABORT_SEQUENCE, f"{len(data)} bytes received, {size} were announced")
        if checked and struct.unpack_from("<H", end, 1)[0] != binascii.crc_hqx(data, 0):
            raise self._break(ABORT_CRC, "the CRC does not match")
        self._wire.send(bytes([_UPLOAD | _END]) + bytes(7))
        return bytes(data)

    def _send_block(self, data: bytes, at: int, frames: int) -> int:
        sent = 0
        while sent < frames and at < len(data):
            sent += 1
            part, at = data[at : at + _FRAME], at + _FRAME
            last = 0x80 if at >= len(data) else 0
            self._wire.send(bytes([last | sent]) + part.ljust(_FRAME, b"\0"))
        return sent

    def _receive_block(self, data: bytearray) -> tuple[int, bool]:
        """Append the frames of one block in order; returns their number and whether that ends the object."""
        received = 0
        while received < MOST_FRAMES:
            try:
                frame = self._wire.receive()
            except queue.Empty:
                break  # the frames received are confirmed, the others will be repeated
            if frame[0] == _ABORT:
                raise TransferAborted(struct.unpack_from("<I", frame, 4)[0])
            number = frame[0] & 0x7F
            if number == received + 1:
                received = number
                data += frame[1:]
                if frame[0] & 0x80:
                    return received, True
            elif frame[0] & 0x80 or number == MOST_FRAMES:
                break  # the end of a block of which some frames were lost
        return received, False

    def _request(self, frame: bytes) -> bytes:
        self._wire.send(frame)
        return self._receive()

    def _receive(self) -> bytes:
        try:
            frame = self._wire.receive()
        except queue.Empty as error:
            self._abort(ABORT_TIMED_OUT)
            raise NoResponse("no answer") from error
        if frame[0] == _ABORT:
            raise TransferAborted(struct.unpack_from("<I", frame, 4)[0])
        return frame

    def _expect(self, frame: bytes, command: int, kind: int, what: bytes | None = None) -> None:
        mask = 0x01 if kind == 0 else 0x03
        if frame[0] & 0xE0 != command or frame[0] & mask != kind & mask or what not in (None, frame[1:4]):
            raise self._break(ABORT_COMMAND, f"unexpected answer {frame.hex()}")

    def _block_size(self, frames: int) -> int:
        if not 1 <= frames <= MOST_FRAMES:
            raise self._break(ABORT_SEQUENCE, f"a block of {frames} frames")
        return frames

    def _break(self, code: int, why: str) -> ProtocolBroken:
        self._abort(code)
        return ProtocolBroken(why)

    def _abort(self, code: int) -> None:
        self._wire.send(struct.pack("<B3sI", _ABORT, self._object, code))
