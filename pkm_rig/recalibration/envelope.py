"""Whether new tables may stay without anybody's approval: the envelope of the rig file, on what was measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from calibration.intervals.envelope import judge
from calibration.intervals.facts import CalibrationFact, ErrorFigure, MachineHistory
from calibration.intervals.settings import IntervalSettings
from calibration.model.parameters import ParameterSet
from drivers.drives.table_image import decode_table
from pkm_rig.jobs.reference import DRIFT_SHARE
from pkm_rig.jobs.tables_in_force import stored_images
from pkm_rig.rig.drive_tables import as_image
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.table_change import TableChange
from pkm_rig.store.store import Store


def table_change_m(rig: Rig, former: Mapping[str, bytes], change: TableChange) -> float:
    """Largest change of a correction between the former tables and those that were tried; infinite without former ones.

    Tables of one machine share their grid; of two grids nothing can be said, which counts as infinite.
    """
    largest = 0.0
    tried = change.trials[-1]["images"]
    for bank in rig.banks:
        before, new = former.get(bank.drive.name), as_image(tried[bank.drive.name])
        if before is None or new is None:
            return float("inf")
        old, now = (decode_table(image, bank.drive.metres_per_increment).corrections_m for image in (before, new))
        if old.shape != now.shape:
            return float("inf")
        largest = max(largest, float(np.max(np.abs(now - old))))
    return largest


def reasons_beyond(
    rig: Rig,
    store: Store,
    history: MachineHistory,
    settings: IntervalSettings,
    new: CalibrationFact,
    change: TableChange,
    found: ErrorFigure | None,
    grown: Sequence[float] | None = None,
) -> tuple[str, ...]:
    """Why new tables must not stay without approval; empty if they may.

    grown (p,): standard deviation by which each parameter was expected to differ, where something is known to have
    changed; else its drift.
    """
    former = history.last_calibration
    if former is None:
        return ("there is no former calibration to compare with",)
    moved_m = table_change_m(rig, stored_images(rig, store, former.tables), change)
    if not np.isfinite(moved_m):
        return (f"this store does not have the tables of calibration {former.id} to compare with",)
    sigma = np.array([p.sigma for p in ParameterSet.of(rig.machine).parameters])
    drift = DRIFT_SHARE * sigma if grown is None else np.asarray(grown)
    error = found if found is not None else ErrorFigure(0.0, 0.0)
    return judge(settings.envelope, former, new, drift, moved_m, error).reasons
