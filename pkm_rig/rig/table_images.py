"""A compensation table as the images that the drives of a rig store."""

from __future__ import annotations

from calibration.compensation.tables import CompensationTable
from calibration.machine.description import Machine
from drivers.drives.table_image import TableImage, machine_id_of
from pkm_rig.rig.config import RigFile


def table_images(file: RigFile, machine: Machine, table: CompensationTable, generation: int) -> list[TableImage]:
    """One a drive: own axis first, then the partner's."""
    out = []
    for axis, drive in enumerate(file.drives):
        partner, corrections = 1 - axis, table.correction_m[axis]
        up_m, down_m = table.by_direction_m[axis].tolist()
        out.append(
            TableImage(
                node_id=drive.node_id,
                generation=generation,
                payload_kg=table.conditions.payload_kg,
                temperature_c=table.temperature_c,
                machine_id=machine_id_of(machine.name),
                own_start_m=float(table.start_m[axis]),
                own_step_m=float(table.step_m[axis]),
                partner_start_m=float(table.start_m[partner]),
                partner_step_m=float(table.step_m[partner]),
                corrections_m=corrections if axis == 0 else corrections.T,
                metres_per_increment=drive.per_increment,
                up_m=up_m,
                down_m=down_m,
            )
        )
    return out
