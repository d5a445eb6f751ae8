"""PDO mapping of the drives: what is required, reading it back, and writing the parts that differ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from drivers.can.drive_object import DriveObject
from drivers.can.sdo import SdoAccess

_NOT_VALID = 1 << 31
_NO_RTR = 1 << 30
_COB_ID = 0x7FF

EVERY_SYNC = 1
AT_ONCE = 255


@dataclass(frozen=True)
class PdoMapping:
    """One PDO: its two records, COB-ID, transmission type and (index, sub, bits) of its content."""

    communication: int
    mapping: int
    cob_id: int
    kind: int
    entries: tuple[tuple[int, int, int], ...]


def required_mappings(
    node_id: int, partner_node_id: int | None, partner: Sequence[DriveObject] = ()
) -> list[PdoMapping]:
    """The PDOs of docs/reference/drive-objects.md; RPDO2 only with a partner and objects for what it sends."""
    mappings = [
        PdoMapping(0x1400, 0x1600, 0x200 + node_id, AT_ONCE, ((0x6040, 0, 16),)),
        PdoMapping(0x1800, 0x1A00, 0x180 + node_id, EVERY_SYNC, ((0x6041, 0, 16), (0x6064, 0, 32), (0x6077, 0, 16))),
        PdoMapping(0x1801, 0x1A01, 0x280 + node_id, EVERY_SYNC, ((0x6062, 0, 32), (0x606C, 0, 32))),
    ]
    if partner_node_id is not None and partner:
        entries = tuple((entry.index, entry.sub, 32) for entry in partner)
        mappings.append(PdoMapping(0x1401, 0x1601, 0x280 + partner_node_id, AT_ONCE, entries))
    return mappings


def cyclic_mapping(node_id: int) -> PdoMapping:
    """RPDO3: the target position, for cyclic synchronous position mode."""
    return PdoMapping(0x1402, 0x1602, 0x300 + node_id, AT_ONCE, ((0x607A, 0, 32),))


def mappings_to_write(sdo: SdoAccess, mappings: Sequence[PdoMapping]) -> list[PdoMapping]:
    """The mappings that the drive does not have. Raises SdoRefused, NoAnswer, ProtocolError."""
    return [mapping for mapping in mappings if not _is_set(sdo, mapping)]


def write_mapping(sdo: SdoAccess, mapping: PdoMapping) -> None:
    """Write one mapping as CiA 301 requires: switch the PDO off, empty it, fill it, switch it on."""
    cob_id, kind = _communication(mapping)
    sdo.write(cob_id, mapping.cob_id | _NOT_VALID | _NO_RTR)
    sdo.write(kind, mapping.kind)
    sdo.write(_count(mapping), 0)
    for sub, (index, sub_index, bits) in enumerate(mapping.entries, start=1):
        sdo.write(_entry(mapping, sub), index << 16 | sub_index << 8 | bits)
    sdo.write(_count(mapping), len(mapping.entries))
    sdo.write(cob_id, mapping.cob_id | _NO_RTR)


def _is_set(sdo: SdoAccess, mapping: PdoMapping) -> bool:
    cob_id, kind = _communication(mapping)
    current_cob_id = sdo.read(cob_id)
    if current_cob_id & _NOT_VALID or current_cob_id & _COB_ID != mapping.cob_id or sdo.read(kind) != mapping.kind:
        return False
    if sdo.read(_count(mapping)) != len(mapping.entries):
        return False
    return all(
        sdo.read(_entry(mapping, sub)) == index << 16 | sub_index << 8 | bits
        for sub, (index, sub_index, bits) in enumerate(mapping.entries, start=1)
    )


def _communication(mapping: PdoMapping) -> tuple[DriveObject, DriveObject]:
    return (
        DriveObject(mapping.communication, 1, "<I", "PDO identifier"),
        DriveObject(mapping.communication, 2, "<B", "PDO transmission type"),
    )


def _count(mapping: PdoMapping) -> DriveObject:
    return DriveObject(mapping.mapping, 0, "<B", "number of mapped objects")


def _entry(mapping: PdoMapping, sub: int) -> DriveObject:
    return DriveObject(mapping.mapping, sub, "<I", "mapped object")
