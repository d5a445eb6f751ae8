"""The short check: is the machine as its calibration left it? Tables on, few poses, ended as soon as it can decide."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from calibration.base.errors import InputError
from calibration.compensation.host import HostCorrection
from calibration.intervals.check_estimate import estimate_check, expected_error_u_m
from calibration.intervals.decision import require_decidable
from calibration.intervals.facts import CalibrationFact, CheckFact, MachineHistory
from calibration.intervals.health import health_test
from calibration.intervals.rules import Verdict, judge_all
from calibration.intervals.settings import IntervalSettings
from pkm_rig.errors import CampaignRefused
from pkm_rig.jobs.check_readings import (
    design_and_residual,
    groups_of,
    known_error_m,
    mean_temperatures_c,
    observe,
    plan_check,
)
from pkm_rig.jobs.interim import require_station
from pkm_rig.jobs.interval_settings import interval_settings
from pkm_rig.jobs.life_record import key_of, mean_temperature_c, note_devices, operating_h, utc_text
from pkm_rig.jobs.reference import Reference, load_reference
from pkm_rig.jobs.tables_in_force import require_host, require_tables
from pkm_rig.results.callbacks import Notify, Progress
from pkm_rig.rig.back_end import corrected_block
from pkm_rig.rig.capabilities import uses_tables
from pkm_rig.rig.kept_tables import kept_tables
from pkm_rig.rig.plans import put_on, visits, warm_up
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.rig_checks import check_rig, require_back_end
from pkm_rig.rig.runner import Runner, describe_campaign, new_campaign_id, open_runner, settings_event
from pkm_rig.rig.schedule import Block, PlannedVisit
from pkm_rig.rig.table_recovery import settle_tables
from pkm_rig.store.life import add_life_row
from pkm_rig.store.life_facts import check_data, machine_history
from pkm_rig.store.store import Store

PHASE = "verification_after"  # of readings with tables on
CHECK_EVENT = "check"


@dataclass(frozen=True)
class HealthResult:
    """A check as it is stored, what all rules say of the machine with it, and how long the warm-up took in rig time."""

    fact: CheckFact
    verdict: Verdict
    answer: str
    warm_up_s: float
    tolerance_m: float
    simulated: bool


def health(
    rig: Rig, store: Store, notify: Notify, progress: Progress, now_s: Callable[[], float] = time.time
) -> HealthResult:
    """Check the machine against the calibration in force and store the result.

    Raises InputError where there is nothing to compare with, CampaignRefused where the rig must not be checked now, and
    DeviceError; the tables stay as they are.
    """
    require_back_end(rig)
    settle_tables(rig, store, notify)
    note_devices(rig, store, notify, now_s)
    problems = check_rig(rig)
    if problems:
        raise CampaignRefused("; ".join(problems))
    history = machine_history(store, rig.file.rig, key_of(rig))
    calibration = history.last_calibration
    if calibration is None:
        raise InputError(f"rig {rig.file.rig}: this store has no accepted calibration of it; run `pkm-rig calibrate`")
    reference = load_reference(store, rig.file.rig, calibration.id, rig.machine, rig.file.payloads)
    by_host = None
    if uses_tables(rig.file, rig.machine):
        require_tables(rig, store, calibration.id, calibration.tables, notify)
    else:
        by_host = require_host(rig, store, calibration.id)
    return _Check(rig, store, notify, progress, now_s, history, calibration, reference, by_host).run()


class _Check:
    def __init__(
        self,
        rig: Rig,
        store: Store,
        notify: Notify,
        progress: Progress,
        now_s: Callable[[], float],
        history: MachineHistory,
        calibration: CalibrationFact,
        reference: Reference,
        by_host: HostCorrection | None,
    ) -> None:
        self._rig, self._store, self._notify, self._progress = rig, store, notify, progress
        self._by_host = by_host
        self._now_s, self._history, self._calibration, self._reference = now_s, history, calibration, reference
        self._settings: IntervalSettings = interval_settings(rig.file.recalibration)
        check = rig.file.recalibration.check
        warm = {"warm_up_max_s": check.warm_up_max_s, "warm_up_step_s": check.warm_up_step_s}
        rig.file = rig.file.model_copy(update={"campaign": rig.file.campaign.model_copy(update=warm)})
        self._longest_s = check.longest_s
        payload = rig.supervisor.state().payload
        if payload is None:
            raise CampaignRefused("the payload is being changed; check the machine when it is on")
        self._payload = payload

    def run(self) -> HealthResult:
        rig, store = self._rig, self._store
        planned, design = plan_check(rig.file, self._reference, self._payload, self._settings.check.looks[-1])
        require_decidable(self._history.machine.tolerance_m(self._now_s()), expected_error_u_m(design))
        if self._by_host is not None:
            planned = list(corrected_block(Block(self._payload, tuple(planned)), self._by_host).visits)
        campaign = new_campaign_id(f"{rig.file.rig}-check")
        store.work_on(campaign)
        tables = kept_tables(rig, store)
        store.add_campaign(describe_campaign(rig, campaign, utc_text(self._now_s()), tables), rig.machine.text)
        store.add_event(campaign, "settings", settings_event(rig))
        total = len(planned) * len(self._reference.moving)

        def show(count: int, what: str) -> None:
            self._progress(count, total, what)

        with open_runner(rig, store, campaign, show, "health", self._notify) as runner:
            return self._measure(runner, planned)

    def _measure(self, runner: Runner, planned: list[PlannedVisit]) -> HealthResult:
        rig = self._rig
        rig.enable()
        rig.host = None if self._by_host is None else self._by_host.corrections
        rig.refresh_atmosphere()
        began_s = rig.clock.now_s()
        runner.run(put_on(runner.devices, self._payload), "payload")
        runner.run(warm_up(runner.devices, planned[:2]), "warm-up")
        warm_up_s = rig.clock.now_s() - began_s
        self._notify(f"warmed up in {warm_up_s / 60.0:.1f} min")
        began_s = rig.clock.now_s()
        require_station(rig)
        smrs = [rig.machine.smrs[i].name for i in self._reference.moving]
        answer, look_s, fact = "go on", 0.0, None
        for look, group in enumerate(groups_of(planned, self._settings.check.looks)):
            before_s = rig.clock.now_s()
            if fact is not None and before_s + look_s - began_s > self._longest_s:
                self._notify(f"the check ends after {(before_s - began_s) / 60.0:.1f} min, undecided")
                break
            block = Block(self._payload, group)
            runner.run(visits(runner.devices, block, PHASE, smrs, nests_measured=look > 0), CHECK_EVENT)
            look_s = rig.clock.now_s() - before_s
            fact = self._fact(runner.campaign, rig.clock.now_s() - began_s)
            answer = self._answer(look, fact)
            if answer != "go on":
                break
        if fact is None:
            raise InputError("recalibration.check: no look; give at least one")
        return self._keep(fact, answer, warm_up_s)

    def _fact(self, campaign: str, duration_s: float) -> CheckFact:
        rig, store = self._rig, self._store
        observed = observe(store.recording(campaign), self._reference, PHASE)
        design, residual = design_and_residual(rig.file, self._reference, observed, self._payload)
        warmth = mean_temperatures_c(observed.observations)
        known_m = known_error_m(rig.file, self._reference, self._payload, warmth)
        found = estimate_check(design, residual, known_m)
        now, station = self._now_s(), rig.station.identity
        return CheckFact(
            id=campaign,
            t_utc_s=now,
            calibration=self._calibration.id,
            instrument="" if station is None else str(station.serial),
            error=found.error,
            watched=design.watched.names,
            change=tuple(found.change.tolist()),
            change_u=tuple(found.change_u.tolist()),
            reference_u=tuple(design.reference_u.tolist()),
            error_per_change=tuple(design.error_per_change.tolist()),
            independent=design.independent,
            temperature_c=mean_temperature_c(warmth),
            poses=int(np.unique(observed.pose).size),
            operating_h=operating_h(rig, store, now),
            duration_s=duration_s,
            known_error_m=float(np.sqrt(np.mean(np.sum(known_m.reshape(-1, 3) ** 2, axis=1)))),
            known_alignment=tuple(design.alignment(known_m).tolist()),
        )

    def _answer(self, look: int, fact: CheckFact) -> str:
        test = health_test(self._history, self._settings, fact)
        size = test.standardised(np.asarray(fact.change), np.asarray(fact.change_u))
        answer = test.looks.answer(look, size)
        worst = int(np.argmax(np.abs(size)))
        self._notify(
            f"{fact.poses} poses: {fact.watched[worst]} off by {size[worst]:+.1f} standard deviations, error "
            f"{fact.error.position_m * 1e6:.1f} um; {answer}"
        )
        return answer

    def _keep(self, fact: CheckFact, answer: str, warm_up_s: float) -> HealthResult:
        rig = self._rig
        tolerance_m = self._history.machine.tolerance_m(fact.t_utc_s)
        verdict = judge_all(self._history.with_check(fact), self._settings, fact.t_utc_s)
        result = HealthResult(fact, verdict, answer, warm_up_s, tolerance_m, bool(rig.simulated_devices))
        with self._store.writing() as connection:
            add_life_row(
                connection,
                "checks",
                rig=rig.file.rig,
                machine=key_of(rig),
                kind=verdict.state,
                data=stored_check(result),
                created=utc_text(fact.t_utc_s),
                campaign=fact.id,
            )
        return result


def stored_check(result: HealthResult) -> dict[str, Any]:
    """The row of a check."""
    return check_data(result.fact) | {
        "tolerance_m": result.tolerance_m,
        "answer": result.answer,
        "reasons": list(result.verdict.reasons),
        "warm_up_s": result.warm_up_s,
        "simulated": result.simulated,
    }


def health_json(result: HealthResult) -> dict[str, Any]:
    """For programs (docs/reference/json.md)."""
    fact, verdict = result.fact, result.verdict
    order = np.argsort(-np.abs(fact.standardised()))
    return {
        "check": fact.id,
        "simulated": result.simulated,
        "verdict": verdict.state,
        "reasons": list(verdict.reasons),
        "remarks": list(verdict.remarks),
        "calibration": fact.calibration,
        "error": {"position_m": fact.error.position_m, "u_m": fact.error.u_m},
        "tolerance_m": result.tolerance_m,
        "poses": fact.poses,
        "duration_s": fact.duration_s,
        "warm_up_s": result.warm_up_s,
        "temperature_c": fact.temperature_c,
        "changes": {
            fact.watched[i]: {
                "value": fact.change[i],
                "u": fact.change_u[i],
                "error_per_unit": fact.error_per_change[i],
            }
            for i in order
        },
        "rules": {r.rule: {"state": r.state, "reason": r.reason} for r in verdict.results},
        "measure": None if verdict.measurement is None else verdict.measurement.extent,
        "due_utc_s": verdict.due_utc_s,
        "act_by_utc_s": None if verdict.prediction is None else verdict.prediction.act_by_utc_s,
    }
