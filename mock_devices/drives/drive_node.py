"""canopen's node of a mock drive: its object dictionary and its SDO server."""

from __future__ import annotations

from collections.abc import Callable
from importlib import resources

import canopen
from canopen.objectdictionary import ObjectDictionary, eds

from mock_devices.can.sdo_server import SegmentServer
from mock_devices.faults import FaultPlan


class DriveNode(canopen.LocalNode):
    """LocalNode with our EDS, without its heartbeat by host time; calls `stored` with the index of a stored object."""

    def __init__(self, node_id: int, stored: Callable[[int], None], faults: FaultPlan) -> None:
        super().__init__(node_id, _dictionary(node_id))
        self.sdo = SegmentServer(self, faults)
        self._write_callbacks.clear()
        self._stored = stored

    def set_data(self, index: int, subindex: int, data: bytes, check_writable: bool = False) -> None:
        """Store an object."""
        super().set_data(index, subindex, data, check_writable)
        self._stored(index)


def _dictionary(node_id: int) -> ObjectDictionary:
    with resources.files("mock_devices.drives").joinpath("mock_drive.eds").open("r", encoding="ascii") as file:
        dictionary: ObjectDictionary = eds.import_eds(file, node_id)  # type: ignore[no-untyped-call]
    return dictionary
