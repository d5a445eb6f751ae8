"""What may be said of each visit of a measurement folder beside its drives: when, from which side, under which load.

docs/reference/measurements.md defines the columns; all are optional. Names are those of a recording.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.machine.description import Machine
from calibration.model.visits import Visits

OF_VISIT = ("t_rig_s", "dwell_s", "speed_m_per_s")
PAYLOAD, CENTRE = "payload_mass_kg", tuple(f"payload_com_{c}_m" for c in "xyz")
FORCE, POINT = tuple(f"force_{c}_n" for c in "xyz"), tuple(f"force_point_{c}_m" for c in "xyz")
OF_DRIVE = ("direction", "torque_ratio")
NOT_NEGATIVE = ("dwell_s", "speed_m_per_s", PAYLOAD)
LARGEST = 1.0e9  # of any of these numbers: sums of squares stay finite


def names_of(machine: Machine) -> tuple[str, ...]:
    """All columns that a folder of a machine may have."""
    of_drives = tuple(f"{drive}_{quantity}" for drive in machine.drive_names for quantity in OF_DRIVE)
    return (*OF_VISIT, PAYLOAD, *CENTRE, *FORCE, *POINT, *of_drives)


def checked_conditions(path: Path, machine: Machine, table: Mapping[str, Array]) -> dict[str, Array]:
    """Those of the columns (v,) that are there. Raises InputError, in one line, where one cannot be."""
    said = {name: table[name] for name in names_of(machine) if name in table}
    groups = [CENTRE, FORCE, POINT, *(tuple(f"{drive}_{q}" for drive in machine.drive_names) for q in OF_DRIVE)]
    for group in groups:
        some = [name for name in group if name in said]
        if some and len(some) < len(group):
            raise InputError(f"{path}: of the columns {', '.join(group)} some are missing; give all or none")
    for of, needed in ((CENTRE[0], PAYLOAD), (POINT[0], FORCE[0])):
        if of in said and needed not in said:
            raise InputError(f"{path}: column '{of}' without '{needed}'; give both")
    for name, values in said.items():
        side = name.endswith("_direction")
        wrong = ~np.isin(values, (-1.0, 1.0)) if side else np.abs(values) > LARGEST
        if name in NOT_NEGATIVE:
            wrong |= values < 0.0
        if np.any(wrong):
            row = int(np.argmax(wrong))
            rule = "the side is 1 (from below) or -1" if side else "it must not be negative, nor beyond 1e9"
            raise InputError(f"{path}: line {row + 2}, column '{name}': {values[row]:g}; {rule}")
    return said


def with_loads(visits: Visits, said: Mapping[str, Array]) -> Visits:
    """The visits with the payloads and forces that are said of them."""
    zero = np.zeros(len(visits))
    forces, points = (np.column_stack([said.get(name, zero) for name in names]) for names in (FORCE, POINT))
    return replace(
        visits,
        payload_kg=said.get(PAYLOAD, zero),
        payload_com_m=np.column_stack([said.get(name, zero) for name in CENTRE]),
        forces=((forces, points),) if FORCE[0] in said else (),
    )
