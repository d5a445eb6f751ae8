"""Tables of a recording as files."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np

from calibration.compensation.tables import table_for_payload
from calibration.recording.recording import Recording
from calibration.reduction.figures import noise_floor
from pkm_rig.jobs.control_files import IdentifiedLoad
from pkm_rig.store.place import campaign_folder


def compensate_recording(recording: Recording, payload: int, out: Path) -> dict[str, Any]:
    """Compute the tables for a payload at the campaign's last temperatures and save one CSV a drive."""
    identified = IdentifiedLoad.of(recording, payload)
    table = table_for_payload(identified.calibration, payload, identified.load.temperatures_c)
    floor = noise_floor(identified.calibration.reduction)
    folder = campaign_folder(out, recording.file.campaign) / f"tables-payload-{payload}"
    folder.mkdir(parents=True, exist_ok=True)
    count = table.correction_m.shape[1]
    axes = [table.start_m[a] + table.step_m[a] * np.arange(count) for a in range(2)]
    largest = {}
    for a, drive in enumerate(recording.file.drives):
        with (folder / f"{drive}.csv").open("w", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow([f"{name}_commanded_m" for name in recording.file.drives] + [f"{drive}_correction_m"])
            for i, first in enumerate(axes[0]):
                for j, second in enumerate(axes[1]):
                    row = (first, second, table.correction_m[a, i, j])
                    writer.writerow([repr(float(v)) for v in row])
        largest[drive] = float(np.max(np.abs(table.correction_m[a])))
    return {
        "campaign": recording.file.campaign,
        "simulated": recording.file.simulated,
        "payload_kg": table.conditions.payload_kg,
        "temperatures_c": identified.load.temperatures_c,
        "largest_correction_m": largest,
        "grid": [count, count],
        "interpolation_rms_m": table.interpolation_rms_m,
        "interpolation_max_m": table.interpolation_max_m,
        "noise_m": None if floor is None else floor.position_rms_m,
        "folder": str(folder),
    }
