"""SDO server of a mock node: canopen's, and the block transfer that it lacks.

Not modelled: protocol switch from block to segmented upload, several clients at a time, a time-out of its own: a
client that left in the middle of a block has to abort before anything else is answered.
"""

from __future__ import annotations

import binascii
import struct
from collections.abc import Callable
from typing import Any, Protocol

from canopen.sdo import server
from canopen.sdo.exceptions import SdoAbortedError

from mock_devices.faults import FaultPlan

_BLOCK = 127
_FRAME = 7
_UPLOAD, _DOWNLOAD = 0xA0, 0xC0  # what the client sends
_UPLOAD_ANSWER, _DOWNLOAD_ANSWER = 0xC0, 0xA0
_ABORT = 0x80
_CRC, _SIZE = 0x04, 0x02
_COMMAND, _SEQUENCE, _CRC_ERROR, _LENGTH = 0x05040001, 0x05040003, 0x05040004, 0x06070010
_HARDWARE, _NO_DATA = 0x06060000, 0x08000024
_LONGEST = 1 << 20

Fallback = Callable[[int, bytearray, float], None]


class ObjectWriter(Protocol):
    """The node's dictionary."""

    def get_data(self, index: int, subindex: int, check_readable: bool = False) -> bytes:
        """Bytes of an object. Raises SdoAbortedError."""
        ...

    def set_data(self, index: int, subindex: int, data: bytes, check_writable: bool = False) -> None:
        """ObjectWriter bytes. Raises SdoAbortedError."""
        ...


class SegmentServer(server.SdoServer):
    """canopen's server for expedited and segmented transfer; its segments can be corrupted by a fault."""

    def __init__(self, node: Any, faults: FaultPlan) -> None:
        super().__init__(0x600 + node.id, 0x580 + node.id, node)  # type: ignore[no-untyped-call]
        self._index = self._subindex = 0  # a first frame that is none must be answered as well
        self._faults = faults

    def send_response(self, response: bytearray) -> None:
        """Send one answer."""
        if response[0] & 0xC0 == 0x00 and self._faults.strikes("sdo-toggle"):
            response[0] ^= 0x10
        super().send_response(response)  # type: ignore[no-untyped-call]


class _Upload:
    """An upload under way: what is left and what the block in flight holds."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.at = 0
        self.frames = 0
        self.ending = False


class _Download:
    """A download under way."""

    def __init__(self, key: tuple[int, int], size: int | None) -> None:
        self.key = key
        self.size = size
        self.data = bytearray()
        self.taken = 0
        self.ending = False


class SdoServer:
    """Answers block transfers itself and leaves the rest to `fallback`. `send` sends one frame to the client."""

    def __init__(
        self,
        store: ObjectWriter,
        send: Callable[[bytes], None],
        fallback: Fallback,
        faults: FaultPlan,
        restart: Callable[[], None],
        *,
        blocks: bool = True,
    ) -> None:
        self._store = store
        self._send = send
        self._fallback = fallback
        self._faults = faults
        self._restart = restart
        self._blocks = blocks
        self._upload: _Upload | None = None
        self._download: _Download | None = None
        self._key = (0, 0)

    def on_request(self, cob_id: int, data: bytearray, stamp: float) -> None:
        """One frame of eight bytes from the client."""
        if self._faults.strikes("sdo-abort"):
            self._end(_HARDWARE)
            return
        if self._is_write(data) and self._faults.strikes("drive-reboot"):
            self.reset()
            self._restart()
            return
        try:
            if not self._in_block(bytes(data)):
                self._upload = self._download = None
                self._key = struct.unpack_from("<HB", data, 1)
                self._others(cob_id, data, stamp)
        except SdoAbortedError as error:
            self._end(error.code)
        except KeyError:
            self._end(0x06020000)

    def reset(self) -> None:
        """Forget a transfer under way."""
        self._upload = self._download = None

    def _others(self, cob_id: int, data: bytearray, stamp: float) -> None:
        command = data[0] & 0xE0
        if command in (_UPLOAD, _DOWNLOAD) and not self._blocks:
            self._end(_COMMAND)
        elif command == _UPLOAD and data[0] & 0x03 == 0:
            self._begin_upload(data)
        elif command == _DOWNLOAD and data[0] & 0x01 == 0:
            self._begin_download(data)
        elif command in (_UPLOAD, _DOWNLOAD):
            self._end(_COMMAND)
        else:
            self._fallback(cob_id, data, stamp)

    def _is_write(self, data: bytearray) -> bool:
        return self._download is not None or data[0] & 0xE0 in (0x00, 0x20, _DOWNLOAD)

    def _in_block(self, data: bytes) -> bool:
        """Whether the frame belongs to a block transfer under way, in which case it has been dealt with."""
        if self._download is not None and not self._download.ending:
            if data[0] == _ABORT:
                self.reset()
            else:
                self._take(self._download, data)
            return True
        if data[0] == _ABORT:
            self.reset()
            return False
        if self._download is not None and data[0] & 0xE3 == _DOWNLOAD | 1:
            self._finish_download(self._download, data)
            return True
        if self._upload is not None and data[0] & 0xE0 == _UPLOAD and data[0] & 0x03:
            self._go_on_uploading(self._upload, data)
            return True
        return False

    # Upload: from the node to the client.

    def _begin_upload(self, request: bytearray) -> None:
        index, sub, frames = struct.unpack_from("<HBB", request, 1)
        content = bytes(self._store.get_data(index, sub, check_readable=True))
        if not content or not 1 <= frames <= _BLOCK:
            self._end(0x05040002 if content else _NO_DATA)
            return
        self._upload = _Upload(content)
        self._upload.frames = frames
        self._send(struct.pack("<BHBI", _UPLOAD_ANSWER | _CRC | _SIZE, index, sub, len(content)))

    def _go_on_uploading(self, upload: _Upload, data: bytes) -> None:
        kind = data[0] & 0x03
        if kind == 1:  # the client has it all
            self._upload = None
            return
        if kind == 2:
            taken, upload.frames = data[1], data[2]
            upload.at = min(upload.at + taken * _FRAME, len(upload.data))
            if upload.at >= len(upload.data) and taken:
                unused = -len(upload.data) % _FRAME
                crc = binascii.crc_hqx(upload.data, 0)
                self._send(struct.pack("<BH5x", _UPLOAD_ANSWER | unused << 2 | 1, crc))
                return
        at = upload.at
        for number in range(1, upload.frames + 1):
            part, at = upload.data[at : at + _FRAME], at + _FRAME
            last = 0x80 if at >= len(upload.data) else 0
            self._send(bytes([last | number]) + part.ljust(_FRAME, b"\0"))
            if last:
                return

    # Download: from the client to the node.

    def _begin_download(self, request: bytearray) -> None:
        index, sub = struct.unpack_from("<HB", request, 1)
        size = struct.unpack_from("<I", request, 4)[0] if request[0] & _SIZE else None
        if size is not None and size > _LONGEST:
            self._end(0x05040005)
            return
        self._download = _Download((index, sub), size)
        self._send(struct.pack("<BHBB3x", _DOWNLOAD_ANSWER | _CRC, index, sub, _BLOCK))

    def _take(self, download: _Download, data: bytes) -> None:
        number, last = data[0] & 0x7F, bool(data[0] & 0x80)
        in_order = number == download.taken + 1
        if in_order:
            download.taken = number
            download.data += data[1:]
            download.ending = last
        if last or number == _BLOCK:
            taken, download.taken = download.taken, 0
            self._send(bytes([_DOWNLOAD_ANSWER | 2, taken, _BLOCK]) + bytes(5))

    def _finish_download(self, download: _Download, data: bytes) -> None:
        self._download = None
        unused = data[0] >> 2 & 7
        content = bytes(download.data[: len(download.data) - unused])
        if download.size is not None and len(content) != download.size:
            self._end(_LENGTH)
        elif struct.unpack_from("<H", data, 1)[0] != binascii.crc_hqx(content, 0):
            self._end(_CRC_ERROR)
        else:
            self._store.set_data(*download.key, content, check_writable=True)
            self._send(bytes([_DOWNLOAD_ANSWER | 1]) + bytes(7))

    def _end(self, code: int) -> None:
        key = self._download.key if self._download is not None else self._key
        self.reset()
        self._send(struct.pack("<BHBI", _ABORT, *key, code))
