"""Fresh poses with the new tables of a partial calibration and with the former ones, until it is decided which stay."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.compensation.tables import CompensationTable
from calibration.intervals.envelope import Verification, VerificationPlan, verify_further
from calibration.intervals.extent import LEAST_VERIFICATION_POSES
from calibration.reduction.report_frame import ReportFrame
from pkm_rig.errors import CampaignRefused
from pkm_rig.jobs.partial_fit import pose_u_m, tool_errors
from pkm_rig.jobs.reference import Reference
from pkm_rig.results.callbacks import Notify
from pkm_rig.rig.back_end import DriveTables
from pkm_rig.rig.runner import Runner
from pkm_rig.rig.schedule import PlannedVisit
from pkm_rig.rig.table_change import TableChange

BEFORE, AFTER = "verification_before", "verification_after"
PLAN = VerificationPlan()
Visit = Callable[[Sequence[PlannedVisit], str], None]


@dataclass(frozen=True)
class Verified:
    """Errors (n, m) at fresh poses before and after, and what they say."""

    before_m: Array
    after_m: Array
    result: Verification


class OnTrial:
    """New tables and the former ones by turns, while a verification measures with both."""

    def __init__(self, runner: Runner, change: TableChange, table: CompensationTable, payload: int) -> None:
        self.table, self.written, self.new_in_use = table, dict[str, dict[str, Any]](), False
        self._runner, self._change, self._payload = runner, change, payload

    def use_new(self) -> None:
        """Write the new tables and use them on trial."""
        self.written = DriveTables(self._runner.rig, self._change).try_out(self.table)
        temperatures = dict(self.table.conditions.temperatures_c)
        activated = {"payload": self._payload, "temperatures_c": temperatures, "tables": self.written}
        self._runner.store.add_event(self._runner.campaign, "activated", activated)
        self.new_in_use = True

    def exchange(self) -> None:
        """Use the other ones. Raises TableError where the new ones were not what was measured."""
        if not self.new_in_use:
            self.use_new()
            return
        self._change.require_in_use()
        self._change.use_former()
        self.new_in_use = False


@dataclass(frozen=True)
class StepwiseVerification:
    """Poses of each step, how they are visited, by what they are judged; those of the first step are measured."""

    groups: Sequence[Sequence[PlannedVisit]]
    visit: Visit
    runner: Runner
    reference: Reference
    report: ReportFrame
    notify: Notify

    def run(self, tables: OnTrial) -> Verified:
        """Step after step until it is decided. Raises CampaignRefused if too few poses can be used."""
        counts: list[int] = []
        for number, group in enumerate(self.groups):
            if number:
                self._visit_with_both(group, tables)
            before, after, u_m = self._errors()
            counts.append(len(before))
            if counts[-1] < LEAST_VERIFICATION_POSES:  # poses that a left-out reflector made useless
                continue
            answer, result = verify_further(before, after, u_m, _plan_at(counts, len(self.groups)))
            self.notify(f"verification: {result.reason}")
            if answer != "go on":
                return Verified(before, after, result)
        raise CampaignRefused(
            f"verification: {counts[-1]} poses were measured before and after, {LEAST_VERIFICATION_POSES} are "
            "needed; look for reflectors that were left out"
        )

    def _visit_with_both(self, group: Sequence[PlannedVisit], tables: OnTrial) -> None:
        """Measure with the tables that are in use, then with the others: half as many exchanges."""
        for exchange in (False, True):
            if exchange:
                tables.exchange()
            phase = AFTER if tables.new_in_use else BEFORE
            self.visit(group, phase)

    def _errors(self) -> tuple[Array, Array, float]:
        """Errors (n, m) at the poses that were measured with both tables, and a coordinate's standard uncertainty."""
        recording = self.runner.store.recording(self.runner.campaign)
        (before, at), (after, also_at) = (
            tool_errors(recording, self.reference, self.report, phase) for phase in (BEFORE, AFTER)
        )
        common = np.intersect1d(at, also_at)
        u_m = pose_u_m(recording, self.reference, self.report, AFTER)
        return before[[_row_of(at, n) for n in common]], after[[_row_of(also_at, n) for n in common]], u_m


def _plan_at(counts: Sequence[int], groups: int) -> VerificationPlan:
    """The plan with as many poses as could be used so far; the last of its groups decides."""
    used = [n for n in counts if n >= LEAST_VERIFICATION_POSES]
    ahead = [used[-1] + 1 + n for n in range(groups - len(counts))]
    return VerificationPlan((*dict.fromkeys(used), *ahead), PLAN.error)


def _row_of(poses: NDArray[np.intp], pose: int) -> int:
    return int(np.flatnonzero(poses == pose)[-1])
