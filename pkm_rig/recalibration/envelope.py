"""Whether new tables may stay without anybody's approval: the envelope of the rig file, on what was measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from calibration.base.arrays import Array
from calibration.compensation.samples import CorrectionSamples
from calibration.intervals.envelope import judge
from calibration.intervals.facts import CalibrationFact, ErrorFigure, MachineHistory
from calibration.intervals.settings import IntervalSettings
from calibration.machine.description import Machine
from calibration.model.parameters import ParameterSet
from drivers.drives.table_image import TableImage, decode_table
from pkm_rig.jobs.former_correction import SAMPLES, activated_events
from pkm_rig.jobs.reference import DRIFT_SHARE
from pkm_rig.jobs.tables_in_force import stored_images
from pkm_rig.rig.back_end import Correction, back_end_of
from pkm_rig.rig.capabilities import uses_tables
from pkm_rig.rig.drive_tables import as_image
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.table_change import TableChange
from pkm_rig.store.store import Store


def correction_change_m(
    rig: Rig, store: Store, former: CalibrationFact | None, change: TableChange, tried: Mapping[int, Correction]
) -> float:
    """Largest change of a drive's correction from a calibration to what was tried (by payload), at the drive's joint.

    Infinite where the store does not have the former one.
    """
    if former is None:
        return float("inf")
    if uses_tables(rig.file, rig.machine):
        return table_change_m(rig, stored_images(rig, store, former.tables), change)
    before = {event["payload_kg"]: event for event in activated_events(store, former.id).values()}
    back_end, arms, largest = back_end_of(rig, change), rig.machine.arms_m, [0.0]
    for correction in tried.values():
        event = before.get(correction.conditions.payload_kg)
        if event is None or SAMPLES not in event:
            return float("inf")
        changes = back_end.changes_since(correction, CorrectionSamples.of_json(event[SAMPLES]))
        largest.append(float(np.max(np.abs(changes) * arms, initial=0.0)))
    return max(largest)


def table_change_m(rig: Rig, former: Mapping[str, bytes], change: TableChange) -> float:
    """Largest change of a correction from the former tables to those that were tried; infinite without former ones."""
    largest = 0.0
    tried = change.trials[-1]["images"]
    for bank in rig.banks:
        before, new = former.get(bank.drive.name), as_image(tried[bank.drive.name])
        if before is None or new is None:
            return float("inf")
        old, now = (decode_table(image, bank.drive.metres_per_increment) for image in (before, new))
        largest = max(largest, largest_difference_m(old, now))
    return largest


def largest_difference_m(a: TableImage, b: TableImage) -> float:
    """Largest difference of the corrections of two tables of one drive, each held at its edges.

    Both are bilinear in every cell of the grid that has the nodes of both: it is largest at one of that grid's nodes.
    """
    nodes = [_nodes_m(table) for table in (a, b)]
    points = np.stack(np.meshgrid(*map(np.union1d, *nodes), indexing="ij"), axis=-1)
    at_a, at_b = (
        RegularGridInterpolator(axes, table.corrections_m)(np.clip(points, [x[0] for x in axes], [x[-1] for x in axes]))
        for table, axes in zip((a, b), nodes, strict=True)
    )
    return float(np.max(np.abs(at_a - at_b))) + max(abs(a.up_m - b.up_m), abs(a.down_m - b.down_m))


def _nodes_m(table: TableImage) -> tuple[Array, Array]:
    own, partner = (np.arange(count, dtype=np.float64) for count in table.corrections_m.shape)
    return table.own_start_m + table.own_step_m * own, table.partner_start_m + table.partner_step_m * partner


def reasons_beyond(
    machine: Machine,
    history: MachineHistory,
    settings: IntervalSettings,
    new: CalibrationFact,
    moved_m: float,
    found: ErrorFigure | None,
    grown: Sequence[float] | None = None,
) -> tuple[str, ...]:
    """Why a new correction must not stay without approval; empty if it may.

    moved_m: largest change of a drive's correction (`correction_change_m`). found: the error with the former one.
    grown (p,): standard deviation by which each parameter was expected to differ, where something is known to have
    changed; else its drift.
    """
    former = history.last_calibration
    if former is None:
        return ("there is no former calibration to compare with",)
    if not np.isfinite(moved_m):
        return (f"this store does not have the tables of calibration {former.id} to compare with",)
    sigma = np.array([p.sigma for p in ParameterSet.of(machine).parameters])
    drift = DRIFT_SHARE * sigma if grown is None else np.asarray(grown)
    error = found if found is not None else ErrorFigure(0.0, 0.0)
    return judge(settings.envelope, former, new, drift, moved_m, error).reasons
