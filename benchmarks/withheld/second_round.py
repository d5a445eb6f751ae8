"""Further visits of the same campaign on the same rig: those that a diagnosis asked for, or as many at random."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.withheld.designs import MACHINE
from benchmarks.withheld.making import Case
from mock_devices.machine_file import MachineFile
from mock_devices.recordings.design import Visit, nominal_drives
from mock_devices.recordings.maker import MockRecording, SimulatedCampaign

MORE = 60
ARMS = ("chosen", "random")
_SPEEDS_M_PER_S, _DWELLS_S = (0.01, 1.0), (0.0, 60.0)


def longer_recordings(case: Case, proposed: list[dict[str, Any]], rng: np.random.Generator) -> dict[str, MockRecording]:
    """Both arms; a diagnosis that proposes nothing gets what the random arm gets."""
    machine = case.drawn.timeline.machine
    at_random = random_visits(machine, rng, case.drawn.timeline.design.visits[0])
    chosen = planned_visits(machine, proposed) or at_random
    return {"chosen": longer(case, chosen), "random": longer(case, at_random)}


def planned_visits(machine: MachineFile, proposed: list[dict[str, Any]]) -> tuple[Visit, ...]:
    """Proposed visits as the plant takes them, repeated or cut to MORE; what cannot be reached is left out."""
    visits = [visit for plan in proposed if (visit := _visit(machine, plan)) is not None]
    if not visits:
        return ()
    return tuple(replace(visits[k % len(visits)], pose=1000 + k % len(visits)) for k in range(MORE))


def random_visits(machine: MachineFile, rng: np.random.Generator, like: Visit) -> tuple[Visit, ...]:
    """Random poses, measured like the campaign's own."""
    (x_low, x_high), (y_low, y_high) = machine.workspace_m
    return tuple(
        replace(like, target_m=complex(rng.uniform(x_low, x_high), rng.uniform(y_low, y_high)), pose=1000 + k, pass_=0)
        for k in range(MORE)
    )


def longer(case: Case, visits: tuple[Visit, ...]) -> MockRecording:
    """The recording as it was, followed by what the further visits give."""
    timeline = case.drawn.extended(visits)
    record = SimulatedCampaign(MACHINE, case.bench.settings, timeline).record()
    before = case.recording.columns
    # The nest check that closed the campaign is the one before its first further visit: nothing is told twice.
    n = len(case.recording)
    for name, column in record.columns.items():
        column[:n] = before[name]
    return record


def _visit(machine: MachineFile, plan: dict[str, Any]) -> Visit | None:
    """A planned visit (targets are the platform's, as in a recording), within what the rig can do."""
    x, y = (float(v) for v in plan["target_m"][:2])
    target = complex(x, y) + machine.tool_point
    (x_low, x_high), (y_low, y_high) = machine.workspace_m
    if not (x_low - 1e-6 <= x <= x_high + 1e-6 and y_low - 1e-6 <= y <= y_high + 1e-6):
        return None
    nominal_drives(machine, target)
    return Visit(
        target,
        tuple(1 if side > 0 else -1 for side in plan["direction"]),
        int(plan["payload"]),
        float(np.clip(plan["speed_m_per_s"], *_SPEEDS_M_PER_S)),
        float(np.clip(plan["dwell_s"], *_DWELLS_S)),
    )
