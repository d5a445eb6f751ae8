"""Candidates of a folder's diagnosis as rows for its coordinates.csv, to be filled in by whoever measures them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from calibration.base.csv_table import write_table
from calibration.base.rotation import rotation_matrix
from calibration.diagnosis.linear_folder import different_loads
from calibration.diagnosis.result import CampaignAddition
from calibration.machine.inverse import rigid_drives
from calibration.recording.measurement_conditions import CENTRE, PAYLOAD
from calibration.recording.measurement_folder import TARGETS, MeasuredMachine, drive_columns
from pkm_rig.jobs.campaign_file import write_candidates

DECIMALS = 9  # of a coordinate: well below what a drive can resolve


def write_visit_files(
    candidates: Sequence[CampaignAddition], measured: MeasuredMachine, folder: Path
) -> dict[str, str | None]:
    """As `write_candidates`, rows for a folder's coordinates.csv."""
    return write_candidates(candidates, folder, "csv", lambda candidate: visit_rows(candidate, measured))


def visit_rows(candidate: CampaignAddition, measured: MeasuredMachine) -> str:
    """A candidate's visits with the columns of the folder's coordinates.csv; what is to be read is empty.

    Drives are those of the nominal machine, numbers go on after the folder's. Poses that the drives cannot reach are
    left out, as are columns of what nobody can plan (times, torques, temperatures, forces).
    """
    machine, visits = measured.machine, candidate.visits
    tool = np.array([visit.target_m for visit in visits])
    pose = tool.copy()
    pose[:, :3] -= rotation_matrix(tool[:, 3:]) @ machine.tool_point_m
    drives = rigid_drives(machine, machine.nominal, pose)
    low, high = machine.travel.T
    reached = np.flatnonzero(np.all((drives >= low) & (drives <= high), axis=1))
    table = {"visit": float(measured.number.max()) + 1.0 + np.arange(len(reached))}
    table |= {name: np.round(drives[reached, a], DECIMALS) for a, name in enumerate(drive_columns(machine))}
    table |= {name: np.round(pose[reached, c], DECIMALS) for c, name in enumerate(TARGETS)}
    loads = different_loads(measured.visits)[0]
    planned: dict[str, Callable[[int], float]] = {
        "dwell_s": lambda k: visits[k].dwell_s,
        "speed_m_per_s": lambda k: visits[k].speed_m_per_s,
        PAYLOAD: lambda k: loads[visits[k].payload, 0],
        **{name: lambda k, c=c: loads[visits[k].payload, 1 + c] for c, name in enumerate(CENTRE)},  # type: ignore[misc]
        **{
            f"{drive}_direction": lambda k, a=a: float(visits[k].direction[a])  # type: ignore[misc]
            for a, drive in enumerate(machine.drive_names)
        },
    }
    table |= {
        name: np.array([of(k) for k in reached.tolist()]) for name, of in planned.items() if name in measured.conditions
    }
    return write_table(table | {name: np.full(len(reached), np.nan) for name in measured.file.columns})
