"""Fresh poses with the new correction of a partial calibration and with the former one, until one is shown to stay."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from calibration.base.arrays import Array
from calibration.compensation.host import HostCorrection
from calibration.intervals.envelope import Verification, VerificationPlan, verify_further, without_harm
from calibration.intervals.extent import LEAST_VERIFICATION_POSES
from calibration.reduction.report_frame import ReportFrame
from pkm_rig.errors import CampaignRefused
from pkm_rig.jobs.former_correction import ACTIVATED, MEASURED, SAMPLES
from pkm_rig.jobs.partial_fit import PoseErrors, tool_errors
from pkm_rig.jobs.reference import Reference
from pkm_rig.results.callbacks import Notify
from pkm_rig.rig.back_end import BackEnd, Correction, corrected_block
from pkm_rig.rig.runner import Runner
from pkm_rig.rig.schedule import Block, PlannedVisit

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
    """A new correction and the former one by turns, while a verification measures with both.

    former: the host's, where it had one in use. acting: what visits are to be commanded with.
    """

    def __init__(self, runner: Runner, back_end: BackEnd, payload: int, former: HostCorrection | None) -> None:
        self.new_in_use, self.acting = False, former
        self.written: dict[str, dict[str, Any]] = {}
        self._runner, self._back_end, self._payload, self._former = runner, back_end, payload, former
        self._new: Correction | None = None

    @property
    def new(self) -> Correction:
        """The new one."""
        if self._new is None:
            raise RuntimeError("no correction was tried yet")
        return self._new

    def begin(self) -> None:
        """The former one acts: drives have their tables on already, the host begins to correct."""
        rig, change = self._runner.rig, self._back_end.change
        rig.compensation = int(change.former[0]["generation"]) if change.before.on else 0
        rig.host = None if self._former is None else self._former.corrections

    def use_new(self, correction: Correction) -> None:
        """Have a new correction act on trial, and store what it is."""
        samples = self._back_end.samples(correction)
        self._new, self.written = correction, self._back_end.try_out(correction)
        self.new_in_use, self.acting = True, correction if isinstance(correction, HostCorrection) else None
        activated = {
            "payload": self._payload,
            "payload_kg": correction.conditions.payload_kg,
            "temperatures_c": dict(correction.conditions.temperatures_c),
            "tables": self.written,
            SAMPLES: samples.as_json(),
            **self._back_end.settings(),
        }
        if isinstance(correction, HostCorrection):
            activated[MEASURED] = correction.measured.as_json()
        self._runner.store.add_event(self._runner.campaign, ACTIVATED, activated)

    def exchange(self) -> None:
        """Use the other one. Raises TableError where the new one was not what was measured."""
        if not self.new_in_use:
            self.use_new(self.new)
            return
        self._back_end.require_in_use()
        self._back_end.use_former(self._former)
        self.new_in_use, self.acting = False, self._former

    def commanded(self, planned: Sequence[PlannedVisit]) -> tuple[PlannedVisit, ...]:
        """Visits as they are commanded with what acts."""
        block = Block(self._payload, tuple(planned))
        return (block if self.acting is None else corrected_block(block, self.acting)).visits


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
            before, after = self._errors()
            counts.append(len(before.moves_m))
            if counts[-1] < LEAST_VERIFICATION_POSES:  # poses that a left-out reflector made useless
                continue
            plan = _plan_at(counts, len(self.groups))
            answer, result = verify_further(before.moves_m, after.moves_m, after.move_u_m, plan)
            if after.turns_rad.shape[1]:
                answer, result = without_harm(answer, result, before.turns_rad, after.turns_rad, after.turn_u_rad, plan)
            self.notify(f"verification: {result.reason}")
            if answer != "go on":
                return Verified(before.moves_m, after.moves_m, result)
        raise CampaignRefused(
            f"verification: {counts[-1]} poses were measured before and after, {LEAST_VERIFICATION_POSES} are "
            "needed; look for reflectors that were left out"
        )

    def _visit_with_both(self, group: Sequence[PlannedVisit], tables: OnTrial) -> None:
        """Measure with the one that acts, then with the other: half as many exchanges."""
        for exchange in (False, True):
            if exchange:
                tables.exchange()
            phase = AFTER if tables.new_in_use else BEFORE
            self.visit(group, phase)

    def _errors(self) -> tuple[PoseErrors, PoseErrors]:
        """Errors at the poses that were measured with both corrections."""
        recording = self.runner.store.recording(self.runner.campaign)
        before, after = (tool_errors(recording, self.reference, self.report, phase) for phase in (BEFORE, AFTER))
        common = np.intersect1d(before.pose, after.pose)
        return before.at(common), after.at(common)


def _plan_at(counts: Sequence[int], groups: int) -> VerificationPlan:
    """The plan with as many poses as could be used so far; the last of its groups decides."""
    used = [n for n in counts if n >= LEAST_VERIFICATION_POSES]
    ahead = [used[-1] + 1 + n for n in range(groups - len(counts))]
    return VerificationPlan((*dict.fromkeys(used), *ahead), PLAN.error)
