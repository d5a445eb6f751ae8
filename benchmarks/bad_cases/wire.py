"""A case through the main job over the real protocols: what the host believes of the rig is not what the mock is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.bad_cases.campaign import machine_file
from benchmarks.bad_cases.cases import KINDS, Case
from benchmarks.demo_check import score
from calibration.base.errors import InputError
from calibration.machine.description import load_machine
from drivers.errors import DeviceError
from pkm_rig.errors import CampaignRefused, StoreError
from pkm_rig.jobs.calibrate import calibrate
from pkm_rig.rig.config import RigFile, embedded_rig_path, load_rig
from pkm_rig.rig.connection import connect_rig
from pkm_rig.store.store import open_store
from pkm_rig.virtual.mock_rig import embedded_mock_rig, fault_plan

REVERSED_AXIS = ("axis = [0.0, 1.0, 0.0]", "axis = [0.0, -1.0, 0.0]")


def run_over_the_wire(case: Case, folder: Path) -> dict[str, Any]:
    """One campaign to its end: `outcome`, `why`, and where tables stay the true RMS errors (m) by payload.

    A refused campaign that leaves a table on in a drive counts as worse than none. Exchanged reflectors are one aiming
    at another one, somewhere in the campaign; the sign of a drive is that of its axis in the host's machine file.
    """
    path = embedded_rig_path()
    file, _ = load_rig(path)
    assert file.mock is not None
    file = file.model_copy(update={"mock": file.mock.model_copy(update={"seed": case.seed})})
    machine = load_machine(machine_file(file, _as_on_the_wire(case), folder))
    faults = fault_plan([f"tracker-wrong-nest@{_at(case)}"]) if case.swapped is not None else None
    true_m: dict[int, tuple[float, float]] = {}
    with (
        open_store(folder / f"{case.kind.replace(' ', '-')}-{case.number}") as store,
        embedded_mock_rig(truly(file, case), path, faults=faults) as mock,
        mock.clock.activity(),
    ):
        host = mock.file.model_copy(update={"payloads": file.payloads})
        outcome, why = None, "tables on"
        try:
            with connect_rig(host, machine, mock.clock, mock.bus_factory, rig_path=path) as rig:
                outcome = calibrate(rig, store, lambda _line: None, lambda _n, _total, _what: None)
        except (InputError, DeviceError, CampaignRefused, StoreError) as error:
            why = f"{type(error).__name__}: {error}".split(";")[0][:160]
        on = [drive.axis_name for drive in mock.mock.drives if drive.axis.compensation.table_in_use is not None]
        if outcome is not None and outcome.accepted:
            true_m = {
                n: (found["true_before"] * 1e-6, found["true_after"] * 1e-6)
                for n, found in score(outcome, mock.mock).items()
            }
            worse = any(after >= before for before, after in true_m.values())
            return {"outcome": "worse" if worse else "survived", "why": why, "true_m": true_m}
    if outcome is not None:
        why = f"verdict: {outcome.decision}"
    if on:
        return {"outcome": "worse", "why": f"{why}; a table is on in {', '.join(on)}", "true_m": true_m}
    return {"outcome": "refused", "why": why, "true_m": true_m}


def truly(file: RigFile, case: Case) -> RigFile:
    """The rig file that the mock reads: what is truly on its platform."""
    payloads = tuple(
        p.model_copy(update={"mass_kg": case.truly_kg.get(n, p.mass_kg)} | _com(case, n))
        for n, p in enumerate(file.payloads)
    )
    return file.model_copy(update={"payloads": payloads})


def _com(case: Case, number: int) -> dict[str, tuple[float, float, float]]:
    return {} if case.truly_com_m is None or number == 0 else {"com_m": case.truly_com_m}


def _as_on_the_wire(case: Case) -> Case:
    return replace(case, file_changes=(REVERSED_AXIS,)) if case.kind == KINDS[3] else case


def _at(case: Case) -> int:
    return int(np.random.default_rng([15, 99, case.number]).integers(20, 1200))
