"""SDO access to one node: one transfer at a time, nothing written twice, typed errors."""

from __future__ import annotations

import queue
import struct
import threading
import time
from collections.abc import Callable
from typing import TypeVar

import can
from canopen.objectdictionary import ObjectDictionary
from canopen.sdo.client import SdoClient
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError, SdoError

from drivers.can.can_line import CanLine
from drivers.can.drive_object import OUT_OF_RANGE, WRONG_STATE, DriveObject
from drivers.can.sdo_block import BlockTransfer, NoResponse, ProtocolBroken, TransferAborted
from drivers.errors import NoAnswer, ProtocolError, SdoRefused

MOST_BYTES = 65_536

_FRAME = 8
_ABORT, _READ = 0x80, 0x40
_GENERAL_ERROR = 0x08000000
_NO_BLOCKS = (0x05040001, 0x06010000)
_OUT_OF_STEP_CODES = (0x05030000, 0x05040000, 0x05040003, 0x05040004)  # toggle, time-out, sequence, CRC
_HARMLESS = ((0x1000, 0), (0x1018, 1), (0x1018, 2), (0x1018, 4))
_MOST_LATE_FRAMES = 300
_UNANSWERED = 4

_Result = TypeVar("_Result")

_TEXTS: dict[int, tuple[str, str]] = {
    0x05040001: ("command not known", "check the drive's firmware"),
    0x06010002: ("the object is read only", "check the drive's firmware"),
    0x06020000: ("there is no such object", "check make and firmware of the drive"),
    0x06090011: ("there is no such sub-object", "check make and firmware of the drive"),
    OUT_OF_RANGE: ("the value is out of range", "check the value"),
    WRONG_STATE: ("not in this state of the drive", "disable the drive first, or check the bank's status"),
}


class _Client(SdoClient):
    """canopen's client, which would fail on a frame that is too short."""

    def on_response(self, can_id: int, data: bytearray, timestamp: float) -> None:
        if len(data) == _FRAME:
            super().on_response(can_id, data, timestamp)  # type: ignore[no-untyped-call]


class _Wire:
    """The client's frames, for block transfer."""

    def __init__(self, client: _Client) -> None:
        self._client = client

    def send(self, data: bytes) -> None:
        """Send a frame to the node."""
        self._client.send_request(data)  # type: ignore[no-untyped-call]

    def receive(self) -> bytes:
        """The next frame from the node."""
        frame: bytes = self._client.responses.get(timeout=self._client.RESPONSE_TIMEOUT)
        return frame

    def forget(self) -> None:
        """Discard what has been received."""
        self._client.responses = queue.Queue()


class SdoAccess:
    """Reads and writes the objects of one node. `timeout_s` is host time, for each answer.

    At the start and after a failed transfer a harmless object is read before the next one begins, so that no late
    answer is taken for a new one. A read is repeated once after a lost or garbled answer. After a lost answer to a
    write the object is read back, so that nothing is written twice. Long objects are transferred in blocks if the
    drive supports it. A node that has not answered four times in a row is not waited for again before four more
    time-outs have passed. All methods raise SdoRefused, NoAnswer, ProtocolError and ConnectionFailed.
    """

    def __init__(self, line: CanLine, node_id: int, device: str, timeout_s: float = 1.0) -> None:
        self._line = line
        self._device = device
        self._node_id = node_id
        self._lock = threading.RLock()
        dictionary = ObjectDictionary()  # type: ignore[no-untyped-call]
        self._client = _Client(0x600 + node_id, 0x580 + node_id, dictionary)  # type: ignore[no-untyped-call]
        self._client.RESPONSE_TIMEOUT = timeout_s
        self._client.MAX_RETRIES = 1  # one attempt: the library would repeat a write
        self._client.network = line.network
        self._wire = _Wire(self._client)
        self._block = BlockTransfer(self._wire)
        self._blocks = True
        self._out_of_step = True  # another master may have left the drive in the middle of a transfer
        self._probes = 0
        self._unanswered, self._unanswered_s = 0, 0.0
        line.subscribe(self._client.tx_cobid, self._client.on_response)

    def close(self) -> None:
        """Stop listening to the node."""
        self._line.unsubscribe(self._client.tx_cobid, self._client.on_response)

    def read(self, entry: DriveObject, *, retry: bool = True) -> int:
        """Read an integer object; with `retry` once more after a lost answer."""
        data = self.read_bytes(entry, retry=retry)
        size = struct.calcsize(entry.format)
        if len(data) < size:
            raise ProtocolError(
                self._device, self._where(entry), f"{len(data)} bytes instead of {size}", "check the drive"
            )
        return int(struct.unpack(entry.format, data[:size])[0])

    def read_twice(self, entry: DriveObject) -> int:
        """Read a setting that nothing else would find wrong: it must be the same both times."""
        first, second = self.read(entry), self.read(entry)
        if first != second:
            what = f"it was read twice, as {first} and {second}"
            raise ProtocolError(self._device, self._where(entry), what, "check the bus and repeat")
        return first

    def write(self, entry: DriveObject, value: int) -> None:
        """Write an integer object. Raises ValueError if it does not fit."""
        try:
            data = struct.pack(entry.format, value)
        except struct.error as error:
            raise ValueError(f"{entry}: {value} does not fit") from error
        self.write_bytes(entry, data)

    def read_bytes(self, entry: DriveObject, *, retry: bool = True) -> bytes:
        """Read an object of any length."""
        with self._lock:
            try:
                return self._transfer(entry, lambda: self._upload(entry))
            except (NoAnswer, ProtocolError):
                if not retry:
                    raise
                return self._transfer(entry, lambda: self._upload(entry))

    def write_bytes(self, entry: DriveObject, data: bytes) -> None:
        """Write an object of any length."""
        with self._lock:
            try:
                self._transfer(entry, lambda: self._download(entry, data))
            except (NoAnswer, ProtocolError):
                if not entry.reads_back:
                    raise
                if not self._is_written(entry, data):
                    self._transfer(entry, lambda: self._download(entry, data))

    def _is_written(self, entry: DriveObject, data: bytes) -> bool:
        """Whether a write whose answer was lost has been carried out; a refusal means that the object is empty."""
        try:
            return self.read_bytes(entry) == data
        except SdoRefused:
            return False

    def _upload(self, entry: DriveObject) -> bytes:
        if entry.format or not self._blocks:
            return self._upload_by_segments(entry)
        return self._by_block(
            lambda: self._block.upload(entry.index, entry.sub, MOST_BYTES), lambda: self._upload_by_segments(entry)
        )

    def _upload_by_segments(self, entry: DriveObject) -> bytes:
        """The library's upload, which does not compare lengths."""
        with self._client.open(entry.index, entry.sub, buffering=0) as stream:  # type: ignore[no-untyped-call]
            size, data = stream.size, bytes(stream.read())
        if size not in (None, len(data)):
            raise ProtocolBroken(f"{len(data)} bytes received, {size} were announced")
        return data

    def _download(self, entry: DriveObject, data: bytes) -> None:
        if entry.format or not self._blocks or not data:
            self._client.download(entry.index, entry.sub, data)
            return
        self._by_block(
            lambda: self._block.download(entry.index, entry.sub, data),
            lambda: self._client.download(entry.index, entry.sub, data),
        )

    def _by_block(self, by_block: Callable[[], _Result], by_segments: Callable[[], _Result]) -> _Result:
        """A drive without block transfer aborts at the first frame; it is not tried again."""
        self._wire.forget()
        try:
            return by_block()
        except TransferAborted as error:
            if error.code not in _NO_BLOCKS:
                raise
            self._blocks = False
        return by_segments()

    def _transfer(self, entry: DriveObject, work: Callable[[], _Result]) -> _Result:
        self._line.check()
        try:
            if self._is_silent():
                raise NoResponse("no answer")
            if self._out_of_step:
                self._get_in_step()
            result = work()
        except can.CanError as error:
            self._line.mark_lost(error)
            self._line.check()
            raise  # not reached: a lost line is an error of its own
        except (SdoError, TransferAborted, ProtocolBroken, NoResponse, OSError, RuntimeError) as error:
            typed_error = self._typed_error(error, entry)
            self._out_of_step = not isinstance(typed_error, SdoRefused)
            if not isinstance(typed_error, NoAnswer):
                self._unanswered = 0
            elif not self._is_silent():
                self._unanswered, self._unanswered_s = self._unanswered + 1, time.monotonic()
            raise typed_error from error
        self._unanswered = 0
        return result

    def _is_silent(self) -> bool:
        """Whether the node has just not answered: leaving a line that is cut must not wait at every step."""
        since_s = time.monotonic() - self._unanswered_s
        return self._unanswered >= _UNANSWERED and since_s < _UNANSWERED * self._client.RESPONSE_TIMEOUT

    def _get_in_step(self) -> None:
        """Read a harmless object and discard everything before its answer; frames keep their order on the bus.

        The objects alternate, so that a late answer to the previous probe is not taken for the present one.
        """
        index, sub = _HARMLESS[self._probes % len(_HARMLESS)]
        self._probes += 1
        self._wire.forget()
        self._wire.send(struct.pack("<BHBI", _ABORT, 0, 0, _GENERAL_ERROR))
        self._wire.send(struct.pack("<BHB4x", _READ, index, sub))
        expected_answer = struct.pack("<HB", index, sub)
        for _ in range(_MOST_LATE_FRAMES):
            try:
                frame = self._wire.receive()
            except queue.Empty as error:
                raise NoResponse("no answer") from error
            if frame[0] & 0xE0 == _READ and frame[1:4] == expected_answer:
                self._out_of_step = False
                return
        raise ProtocolBroken("unrequested frames keep arriving")

    def _where(self, entry: DriveObject) -> str:
        return f"node {self._node_id}, {entry}"

    def _typed_error(self, error: Exception, entry: DriveObject) -> Exception:
        self._line.check()
        if isinstance(error, SdoAbortedError | TransferAborted):
            if error.code in _OUT_OF_STEP_CODES:
                what = f"the drive has lost frames of the transfer (abort code 0x{error.code:08X})"
                return ProtocolError(self._device, self._where(entry), what, "check the bus and repeat")
            what, remedy = {**_TEXTS, **entry.refusals}.get(
                error.code, (" ".join(str(error).split()), "look the abort code up in the drive's manual")
            )
            what = f"{what} (abort code 0x{error.code:08X})"
            return SdoRefused(self._device, self._where(entry), what, remedy, error.code)
        silent = isinstance(error, SdoCommunicationError) and "No SDO response" in str(error)
        if silent or isinstance(error, NoResponse):
            return NoAnswer(
                self._device, self._where(entry), "no answer", "check power, node id and cable of the drive"
            )
        return ProtocolError(self._device, self._where(entry), f"SDO: {error}", "check the bus and repeat")
