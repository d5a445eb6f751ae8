"""Whether two recordings are of one machine, and their readings as they can be compared: without tables."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.base.errors import InputError
from calibration.machine.description import Machine
from calibration.recording.recording import Recording

PARTS_OF_FILE = (
    ("degrees_of_freedom", "degrees of freedom"),
    ("gravity_m_per_s2", "gravity"),
    ("reference_temperature_c", "the reference temperature"),
    ("platform", "the platform"),
    ("tolerances", "tolerances"),
    ("expansion", "thermal expansion"),
)


def require_one_machine(before: Recording, after: Recording) -> None:
    """Raise InputError, in one line, unless both recordings are of one machine whose parts have the same names.

    Names and nominal values must agree: else a difference of two files would be taken for a change of the machine.
    Reflectors may have come, gone or moved (`shared_reflectors`).
    """
    a, b = before.machine, after.machine
    names = f"{before.file.campaign} and {after.file.campaign}"
    if a.name != b.name:
        raise InputError(f"{names} are of different machines, {a.name} and {b.name}; compare campaigns of one machine")
    if before.file.rig != after.file.rig:
        raise InputError(
            f"{names} are of different rigs, {before.file.rig} and {after.file.rig}; compare campaigns of one rig"
        )
    _require_same_names(names, "drives", a.drive_names, b.drive_names)
    _require_same_names(names, "struts", a.strut_names, b.strut_names)
    _require_same_names(names, "guides", a.guide_names, b.guide_names)
    for entries in ("drives", "struts", "guides"):
        for one, other in zip(getattr(a.file, entries), getattr(b.file, entries), strict=True):
            if one != other:
                _refuse_nominal(names, one.name)
    for key, words in PARTS_OF_FILE:
        if getattr(a.file, key) != getattr(b.file, key):
            _refuse_nominal(names, words)
    if before.file.campaign == after.file.campaign and _same_readings(before, after):
        raise InputError(f"{before.file.campaign}: the same campaign twice; give two")


def _require_same_names(campaigns: str, what: str, one: tuple[str, ...], other: tuple[str, ...]) -> None:
    if one == other:
        return
    renamed = sorted(set(one) ^ set(other)) or list(one)
    raise InputError(
        f"{campaigns}: {what} have other names ({', '.join(renamed[:4])}); parameters that were renamed cannot be "
        "compared: use one machine file for both"
    )


def _refuse_nominal(campaigns: str, what: str) -> None:
    raise InputError(
        f"{campaigns}: the machine files differ in {what}; a difference of nominal values is no change of the machine: "
        "export both with one machine file"
    )


def _same_readings(before: Recording, after: Recording) -> bool:
    same = len(before) == len(after) and np.array_equal(before["t_rig_s"], after["t_rig_s"])
    return bool(same and np.array_equal(before.positions_m, after.positions_m))


def shared_reflectors(before: Machine, after: Machine) -> frozenset[str]:
    """Names of the reflectors that both machine files have in the same place; others were mounted in between."""
    by_name = {smr.name: smr for smr in before.smrs}
    return frozenset(
        smr.name
        for smr in after.smrs
        if (former := by_name.get(smr.name)) is not None
        and (smr.on, smr.drive) == (former.on, former.drive)
        and np.array_equal(smr.position_m, former.position_m)
    )


def without_tables(recording: Recording) -> Recording:
    """The recording as if no table had been active: readings under a known table stand where it sent the drives.

    Readings under tables that the recording does not know stay as they are; the linear model leaves them out.
    """
    generation = recording["compensation"]
    known = [g for g in {table.generation for table in recording.file.known_tables} if np.any(generation == g)]
    if not known:
        return recording
    names, drives = recording.file.drives, recording.drives("actual_m")
    columns = dict(recording.columns)
    for number in known:
        rows = generation == number
        for table in recording.file.known_tables:
            if table.generation == number:
                own = names.index(table.drive)
                partner = own if table.partner is None else names.index(table.partner)
                moved = columns[f"{table.drive}_actual_m"].copy()
                moved[rows] += table.correction_m(drives[rows, own], drives[rows, partner])
                columns[f"{table.drive}_actual_m"] = moved
    columns["compensation"] = np.where(np.isin(generation, known), 0.0, generation)
    return replace(recording, columns=columns)
