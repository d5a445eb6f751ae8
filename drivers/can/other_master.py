"""Frames that only a CANopen master sends: on a line that we are the master of, nobody else may."""

from __future__ import annotations

from collections.abc import Collection

_NMT, _SYNC, _SDO_REQUEST, _HEARTBEAT = 0x000, 0x080, 0x600, 0x700
_RPDOS = {0x200: "RPDO1 (controlword)", 0x300: "RPDO2 or 3", 0x400: "RPDO3", 0x500: "RPDO4"}
_FUNCTION, _NODE = 0x780, 0x07F


def master_frame(cob_id: int, data: bytes, nodes: Collection[int], master_node_id: int) -> str | None:
    """What a master has sent to one of these nodes or to all, or as `master_node_id`; None for any other frame.

    Identifiers are those of CiA 301's predefined connection set. What other nodes send each other, and what is sent to
    nodes that are not ours, is no concern of ours.
    """
    function, node = cob_id & _FUNCTION, cob_id & _NODE
    if cob_id == _NMT:
        return "an NMT command" if len(data) == 2 and data[1] in (0, *nodes) else None
    if cob_id == _SYNC:
        return "SYNC"
    if cob_id == _HEARTBEAT + master_node_id:
        return f"the heartbeat of node {master_node_id}, which is ours"
    if node not in nodes:
        return None
    if function == _SDO_REQUEST:
        return f"an SDO request to node {node}"
    return f"{_RPDOS[function]} to node {node}" if function in _RPDOS else None
