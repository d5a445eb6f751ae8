"""Partial calibration: the former one is the prior, a few poses show what is uncertain now, fresh ones verify it.

Only what the reasons allow is let loose (`partial_fit`). Fresh poses are added in steps until it is decided which
tables stay (`partial_verification`).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from calibration.base.arrays import Array
from calibration.compensation.host import HostCorrection
from calibration.identification.fit import Fit
from calibration.intervals.envelope import Verification
from calibration.intervals.extent import Measurement
from calibration.intervals.facts import CalibrationFact, ErrorFigure
from calibration.model.operating_conditions import OperatingConditions
from calibration.reduction.reduction import CALIBRATION
from pkm_rig.errors import CampaignRefused
from pkm_rig.jobs.check_readings import groups_of, mean_temperatures_c, observe, plan_check
from pkm_rig.jobs.former_correction import GROWTH, PRIOR, READINGS, activated_events, verified_correction
from pkm_rig.jobs.interim import require_station
from pkm_rig.jobs.interval_settings import interval_settings
from pkm_rig.jobs.life_record import add_identified, identified_data, key_of, utc_text
from pkm_rig.jobs.partial_fit import fit_partly, growth_of, walk_of
from pkm_rig.jobs.partial_verification import AFTER, BEFORE, PLAN, OnTrial, StepwiseVerification, Verified
from pkm_rig.jobs.reference import Reference, load_reference
from pkm_rig.jobs.reversals import stored_reversals
from pkm_rig.results.callbacks import Notify, Progress
from pkm_rig.rig.back_end import BackEnd, Correction, back_end_of
from pkm_rig.rig.capabilities import uses_tables
from pkm_rig.rig.kept_tables import kept_tables
from pkm_rig.rig.plans import put_on, visits, warm_up
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.rig_checks import check_rig, require_back_end
from pkm_rig.rig.runner import Runner, describe_campaign, new_campaign_id, open_runner, settings_event
from pkm_rig.rig.schedule import Block, PlannedVisit, verification_block
from pkm_rig.rig.table_change import VERDICT, TableChange, changing_tables
from pkm_rig.rig.table_recovery import settle_tables
from pkm_rig.store.append import append_event
from pkm_rig.store.life import ACCEPTED, IDENTIFIED, PROPOSED, REFUSED, add_life_row, life_rows
from pkm_rig.store.life_facts import calibration_fact
from pkm_rig.store.store import Store


@dataclass(frozen=True)
class PartialOutcome:
    """What a partial calibration has found and tried, whether that stays, and why what is verified does not."""

    campaign: str
    fact: CalibrationFact
    verification: Verification
    beyond: tuple[str, ...]
    change_m: Array
    correction: Correction
    restored: str

    @property
    def accepted(self) -> bool:
        """Whether the tables stay."""
        return self.verification.accepted and not self.beyond


Judge = Callable[[CalibrationFact, TableChange, Mapping[int, Correction], ErrorFigure, Array], tuple[str, ...]]


def recalibrate_partly(
    rig: Rig,
    store: Store,
    calibration: CalibrationFact,
    measurement: Measurement,
    notify: Notify,
    progress: Progress,
    judge: Judge,
    now_s: Callable[[], float] = time.time,
) -> PartialOutcome:
    """Measure what `measurement` asks for on a connected rig, with the payload that is on; keep what is verified.

    Raises DeviceError, CampaignRefused, StoreError or InputError with the machine stopped and the former tables back.
    """
    require_back_end(rig)
    settle_tables(rig, store, notify)
    problems = check_rig(rig)
    payload = rig.supervisor.state().payload
    if problems or payload is None:
        raise CampaignRefused("; ".join(problems) or "the payload is being changed; calibrate when it is on")
    reference = load_reference(store, rig.file.rig, calibration.id, rig.machine, rig.file.payloads)
    by_tables = uses_tables(rig.file, rig.machine)
    former = None if by_tables else verified_correction(store, calibration.id, payload)
    campaign = new_campaign_id(rig.file.rig)
    store.work_on(campaign)
    header = describe_campaign(rig, campaign, utc_text(now_s()), kept_tables(rig, store))
    store.add_campaign(header, rig.machine.text)
    store.add_event(campaign, "settings", settings_event(rig))
    notify(f"campaign {campaign}: {measurement.extent}; {measurement.reason}")
    progress_to = _Progress(progress, len(reference.moving))
    with (
        open_runner(rig, store, campaign, progress_to.show, "recalibrate", notify) as runner,
        changing_tables(rig, store, "calibrate", campaign) as change,
    ):
        job = _Partial(runner, change, reference, former, measurement, payload, progress_to, notify, now_s)
        return job.run(calibration, judge)


class _Progress:
    """How far a partial calibration is: more poses are added where its verification needs them."""

    def __init__(self, progress: Progress, per_visit: int) -> None:
        self._progress, self._per_visit, self._total = progress, per_visit, 0

    def expect(self, visits: int) -> None:
        """So many visits more."""
        self._total += visits * self._per_visit

    def show(self, number: int, what: str) -> None:
        """Tell it."""
        self._progress(number, self._total, what)


@dataclass
class _Partial:
    runner: Runner
    change: TableChange
    reference: Reference
    former: HostCorrection | None
    measurement: Measurement
    payload: int
    progress: _Progress
    notify: Notify
    now_s: Callable[[], float]

    def run(self, former: CalibrationFact, judge: Judge) -> PartialOutcome:
        rig = self.runner.rig
        block = verification_block(rig.machine, rig.file.campaign, self.payload, rig.file.station.position_m)
        groups = groups_of(block.visits, PLAN.looks)
        planned, growth = self._planned(former)
        back_end = back_end_of(rig, self.change)
        tables = OnTrial(self.runner, back_end, self.payload, self.former if self._host_corrected() else None)

        def visit(group: Sequence[PlannedVisit], phase: str) -> None:
            self._visit(tables.commanded(group), phase)

        self._begin(planned)
        tables.begin()
        visit(groups[0], BEFORE)
        rig.compensate(None)
        self._visit(planned, CALIBRATION)
        fit = self._fit(former, growth)
        report = self.reference.report_frame(fit.frame)
        measured = None if self.former is None else self.former.measured.widened(fit.visits)
        entry = rig.file.payloads[self.payload]
        conditions = OperatingConditions(entry.mass_kg, entry.com_m, rig.temperatures_c())
        correction = back_end.build_partly(fit, report, conditions, measured)
        tables.use_new(back_end.against_reversals(correction, self._former_reversals(former)))
        visit(groups[0], AFTER)
        steps = StepwiseVerification(groups, visit, self.runner, self.reference, report, self.notify)
        grown = np.sqrt(np.diag(growth)[: len(self.reference.model.parameters)])
        return self._decide(judge, fit, steps.run(tables), tables, back_end, grown)

    def _former_reversals(self, former: CalibrationFact) -> Array:
        """Reversal values (d,) by the calibration that is brought up to date: a check's visits tell none."""
        activated = activated_events(self.runner.store, former.id).get(self.payload, {})
        return stored_reversals(activated, len(self.runner.rig.machine.drive_names))

    def _planned(self, former: CalibrationFact) -> tuple[list[PlannedVisit], Array]:
        """The visits that show what is asked for, and by what covariance (k, k) the unknowns may have changed."""
        file = self.runner.rig.file
        planned, design = plan_check(file, self.reference, self.payload, self.measurement.visits or 0)
        drift = interval_settings(file.recalibration).drift
        walked = walk_of(self.reference, design, self.now_s() - former.t_utc_s, drift)
        return planned, walked + growth_of(self.reference, self.measurement)

    def _fit(self, former: CalibrationFact, growth: Array) -> Fit:
        """The former calibration brought up to date by what was measured, and kept with what it is made of."""
        rig, store, campaign = self.runner.rig, self.runner.store, self.runner.campaign
        recording = store.recording(campaign)
        fit = fit_partly(self.reference, recording, growth)
        temperatures = mean_temperatures_c(observe(recording, self.reference, CALIBRATION).observations)
        data = identified_data(rig, store, fit, temperatures, extent=self.measurement.extent, now_s=self.now_s())
        data |= {PRIOR: former.id, READINGS: len(recording), GROWTH: growth.tolist()}
        add_identified(rig, store, campaign, data | {"report": dict(self.reference.report)})
        return fit

    def _host_corrected(self) -> bool:
        """Whether the host corrected, by the calibration in force, before this began."""
        state = self.change.host_former
        if self.former is None or state is None or not state.on:
            return False
        if state.campaign != self.reference.campaign:
            raise CampaignRefused(
                f"{state.in_words()}, in force is calibration {self.reference.campaign}; see `pkm-rig tables`"
            )
        return True

    def _begin(self, planned: Sequence[PlannedVisit]) -> None:
        rig = self.runner.rig
        rig.enable()
        rig.refresh_atmosphere()
        self.runner.run(put_on(self.runner.devices, self.payload), "payload")
        self.runner.run(warm_up(self.runner.devices, planned[:2]), "warm-up")
        require_station(rig)

    def _visit(self, planned: Sequence[PlannedVisit], phase: str) -> None:
        self.progress.expect(len(planned))
        smrs = self.runner.devices.smrs("platform", "slider")
        block = Block(self.payload, tuple(planned))
        self.runner.run(visits(self.runner.devices, block, phase, smrs), phase.replace("_", " "))

    def _decide(
        self, judge: Judge, fit: Fit, seen: Verified, tables: OnTrial, back_end: BackEnd, grown: Array
    ) -> PartialOutcome:
        store, campaign, result = self.runner.store, self.runner.campaign, seen.result
        verdict = {
            "t_utc_s": self.now_s(),
            "as_found": _rms(seen.before_m, result.u_m),
            "without_tables": None,
            "as_left": _rms(seen.after_m, result.u_m),
            "tables": tables.written,
            "table_change": self.change.id,
            "table_temperatures_c": tables.new.conditions.temperatures_c,
            "effects": [],
            "diagnosis": f"not diagnosed: {self.measurement.extent} only",
        }
        found = _identified(store, self.runner.rig, campaign)
        fact = calibration_fact(campaign, found, verdict)
        beyond: tuple[str, ...] = ()
        if result.accepted:
            found_m = ErrorFigure(**_rms(seen.before_m, result.u_m))
            beyond = judge(fact, self.change, {self.payload: tables.new}, found_m, grown)
        moved = fit.theta - self.reference.values[: len(self.reference.model.parameters)]
        outcome = PartialOutcome(campaign, fact, result, beyond, moved, tables.new, self.change.description)
        if tables.new_in_use:
            back_end.require_in_use()
        self._keep_verdict(outcome, verdict)
        if outcome.accepted:
            self.change.keep()
        else:
            self.notify(f"the result is {'proposed' if beyond else 'refused'}; back to {outcome.restored}")
            self.change.bring_to_target()
        return outcome

    def _keep_verdict(self, outcome: PartialOutcome, verdict: dict[str, Any]) -> None:
        rig, store = self.runner.rig, self.runner.store
        event: dict[str, Any] = {VERDICT: self.change.id, "decision": "accepted" if outcome.accepted else "refused"}
        event |= {"beyond": list(outcome.beyond), "rule": outcome.verification.reason}
        kind = ACCEPTED if outcome.accepted else PROPOSED if outcome.beyond else REFUSED
        with store.writing() as connection:
            append_event(connection, outcome.campaign, "accepted" if outcome.accepted else "refused", event)
            add_life_row(
                connection,
                "calibrations",
                rig=rig.file.rig,
                machine=key_of(rig),
                kind=kind,
                data=verdict | {"beyond": list(outcome.beyond)},
                created=utc_text(self.now_s()),
                campaign=outcome.campaign,
            )


def _rms(error_m: Array, u_m: float) -> dict[str, float]:
    return {"position_m": float(np.sqrt(np.mean(np.sum(error_m**2, axis=1)))), "u_m": u_m}


def _identified(store: Store, rig: Rig, campaign: str) -> dict[str, Any]:
    rows = life_rows(store, "calibrations", rig.file.rig)
    return next(row.data for row in reversed(rows) if (row.campaign, row.kind) == (campaign, IDENTIFIED))
