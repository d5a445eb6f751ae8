"""SDO access to one node: one transfer at a time, nothing written twice, typed errors."""

from __future__ import annotations

import struct
import threading

from canopen.objectdictionary import ObjectDictionary
from canopen.sdo.client import SdoClient
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError, SdoError

from drivers.can_line import CanLine
from drivers.errors import NoAnswer, ProtocolError, SdoRefused
from drivers.objects import TARGET_POSITION, DriveObject

OUT_OF_RANGE = 0x06090030
WRONG_STATE = 0x08000022

_TEXTS: dict[int, tuple[str, str]] = {
    0x05040001: ("command not known", "check the drive's firmware"),
    0x06010002: ("the object is read only", "check the drive's firmware"),
    0x06020000: ("there is no such object", "check make and firmware of the drive"),
    0x06090011: ("there is no such sub-object", "check make and firmware of the drive"),
    OUT_OF_RANGE: ("the value is out of range", "check the value"),
    WRONG_STATE: ("not in this state of the drive", "disable the drive first, or check the bank's status"),
}
_TARGET_TEXTS: dict[int, tuple[str, str]] = {
    OUT_OF_RANGE: (
        "the set-point is outside the software limits or the active table's grid",
        "choose a position inside both",
    ),
    WRONG_STATE: (
        "compensation is on but no valid table is active for this payload",
        "write and activate the payload's table, or switch compensation off",
    ),
}


class SdoAccess:
    """Reads and writes the objects of one node. `timeout_s` is host time, for each answer.

    All methods raise SdoRefused, NoAnswer, ProtocolError and ConnectionFailed.
    """

    def __init__(self, line: CanLine, node_id: int, device: str, timeout_s: float = 1.0) -> None:
        self._line = line
        self._device = device
        self._node_id = node_id
        self._lock = threading.Lock()
        dictionary = ObjectDictionary()  # type: ignore[no-untyped-call]
        self._client = SdoClient(0x600 + node_id, 0x580 + node_id, dictionary)  # type: ignore[no-untyped-call]
        self._client.RESPONSE_TIMEOUT = timeout_s
        self._client.MAX_RETRIES = 1  # one attempt: the library would send a write again
        self._client.network = line.network
        line.subscribe(self._client.tx_cobid, self._client.on_response)

    def close(self) -> None:
        """Stop listening to the node."""
        self._line.unsubscribe(self._client.tx_cobid, self._client.on_response)

    def read(self, entry: DriveObject) -> int:
        """Read an integer object."""
        data = self.read_bytes(entry)
        size = struct.calcsize(entry.format)
        if len(data) < size:
            raise ProtocolError(
                self._device, self._where(entry), f"{len(data)} bytes instead of {size}", "check the drive"
            )
        return int(struct.unpack(entry.format, data[:size])[0])

    def write(self, entry: DriveObject, value: int) -> None:
        """Write an integer object. Raises ValueError if it does not fit."""
        try:
            data = struct.pack(entry.format, value)
        except struct.error as error:
            raise ValueError(f"{entry}: {value} does not fit") from error
        self.write_bytes(entry, data)

    def read_bytes(self, entry: DriveObject) -> bytes:
        """Read an object of any length, by segments where it is long."""
        with self._lock:
            self._line.check()
            try:
                return bytes(self._client.upload(entry.index, entry.sub))
            except (SdoError, OSError, RuntimeError) as error:
                raise self._typed(error, entry) from error

    def write_bytes(self, entry: DriveObject, data: bytes) -> None:
        """Write an object of any length, by segments where it is long."""
        with self._lock:
            self._line.check()
            try:
                self._client.download(entry.index, entry.sub, data)
            except (SdoError, OSError, RuntimeError) as error:
                raise self._typed(error, entry) from error

    def _where(self, entry: DriveObject) -> str:
        return f"node {self._node_id}, {entry}"

    def _typed(self, error: Exception, entry: DriveObject) -> Exception:
        self._line.check()
        if isinstance(error, SdoAbortedError):
            texts = _TEXTS | (_TARGET_TEXTS if entry == TARGET_POSITION else {})
            what, remedy = texts.get(
                error.code, (" ".join(str(error).split()), "look the abort code up in the drive's manual")
            )
            what = f"{what} (abort code 0x{error.code:08X})"
            return SdoRefused(self._device, self._where(entry), what, remedy, error.code)
        if isinstance(error, SdoCommunicationError) and "No SDO response" in str(error):
            return NoAnswer(
                self._device, self._where(entry), "no answer", "check power, node id and cable of the drive"
            )
        return ProtocolError(self._device, self._where(entry), f"SDO: {error}", "check the bus and repeat")
