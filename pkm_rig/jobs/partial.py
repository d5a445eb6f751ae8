"""Partial calibration: the former one is the prior, a few poses show what is uncertain now, fresh ones verify it.

Only what the reasons allow is let loose: the offset of a drive that has lost its reference, or thermal expansion. All
else keeps the former calibration's uncertainty, so that a few readings move it as little as they must.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.compensation.tables import build_table
from calibration.identification.fit import Fit
from calibration.identification.from_prior import Prior, identify_from_prior
from calibration.instruments.smr_positions import SmrPositions, StationModel
from calibration.intervals.envelope import Verification, verify
from calibration.intervals.extent import LEAST_VERIFICATION_POSES, Measurement
from calibration.intervals.facts import CalibrationFact, ErrorFigure
from calibration.intervals.watched import watched_changes
from calibration.machine.description import PARTS
from calibration.model.operating_conditions import OperatingConditions
from calibration.recording.recording import Recording
from calibration.reduction.figures import free_axes
from calibration.reduction.pose_filter import filter_poses
from calibration.reduction.reduction import CALIBRATION
from calibration.reduction.report_frame import ReportFrame
from pkm_rig.errors import CampaignRefused
from pkm_rig.jobs.check_readings import machine_frame, mean_temperatures_c, observe, plan_visits
from pkm_rig.jobs.interim import require_station
from pkm_rig.jobs.life_record import add_identified, identified_data, key_of, utc_text
from pkm_rig.jobs.reference import MOUNTING, Reference, load_reference
from pkm_rig.results.callbacks import Notify, Progress
from pkm_rig.rig.back_end import DriveTables
from pkm_rig.rig.kept_tables import kept_tables
from pkm_rig.rig.plans import put_on, visits, warm_up
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.rig_checks import check_rig, require_table_banks
from pkm_rig.rig.runner import Runner, describe_campaign, new_campaign_id, open_runner, settings_event
from pkm_rig.rig.schedule import Block, verification_block
from pkm_rig.rig.table_change import VERDICT, TableChange, changing_tables
from pkm_rig.rig.table_recovery import settle_tables
from pkm_rig.store.append import append_event
from pkm_rig.store.life import ACCEPTED, IDENTIFIED, PROPOSED, REFUSED, add_life_row, life_rows
from pkm_rig.store.life_facts import calibration_fact
from pkm_rig.store.store import Store

OFFSET_U_M = 1e-3  # by which a drive that has lost its reference may stand off
BEFORE, AFTER = "verification_before", "verification_after"


@dataclass(frozen=True)
class PartialOutcome:
    """What a partial calibration has found, whether its tables stay, and why tables that are verified do not."""

    campaign: str
    fact: CalibrationFact
    verification: Verification
    beyond: tuple[str, ...]
    change_m: Array
    restored: str

    @property
    def accepted(self) -> bool:
        """Whether the tables stay."""
        return self.verification.accepted and not self.beyond


Judge = Callable[[CalibrationFact, TableChange, ErrorFigure, Array], tuple[str, ...]]


def growth_of(reference: Reference, measurement: Measurement) -> Array:
    """Covariance (k, k) of the reference's unknowns by which they may have changed, for what is to be measured.

    A drive's offset moves both base joints of its struts and its slider's reflector along its axis.
    """
    names, machine = reference.names, reference.machine
    growth = np.zeros((len(names), len(names)))
    if measurement.extent == "expansion":
        for part in PARTS:
            if f"expansion.{part}" in names:
                row = names.index(f"expansion.{part}")
                growth[row, row] = machine.u_expansion_per_k[part] ** 2
        return growth
    watched = watched_changes(reference.model.parameters)
    for drive in measurement.drives:
        column = np.zeros(len(names))
        name = f"drive_offset.{drive}"
        if name not in watched.names:
            raise InputError(f"drive {drive}: its offset is no change of this machine; calibrate in full")
        column[: len(reference.model.parameters)] = watched.combination[:, watched.names.index(name)]
        number = machine.drive_names.index(drive)
        for smr in machine.smrs:
            if smr.on == "slider" and smr.drive == number:
                for axis, share in zip("xyz", machine.nominal.axis[number], strict=True):
                    column[names.index(f"{MOUNTING}{smr.name}.{axis}")] = share
        growth += OFFSET_U_M**2 * np.outer(column, column)
    return growth


def fit_partly(reference: Reference, recording: Recording, measurement: Measurement) -> Fit:
    """The former calibration, brought up to date by the few readings of a recording."""
    observed = observe(recording, reference, CALIBRATION).observations
    accuracy = recording.file.station.accuracy.to_station_accuracy()
    smrs = tuple(sorted(set(observed.smr.tolist())))
    station = StationModel.from_accuracy(machine_frame(reference, observed), smrs, accuracy)
    prior = Prior(reference.names, reference.values, reference.covariance + growth_of(reference, measurement))
    return identify_from_prior(reference.model, observed.visits, [SmrPositions(observed, station)], prior)


def tool_errors(
    recording: Recording, reference: Reference, report: ReportFrame, phase: str
) -> tuple[Array, NDArray[np.intp]]:
    """Errors (n, m) of the tool's free coordinates at the verification poses, and the poses' numbers (n,)."""
    observed = observe(recording, reference, phase, drives_matter=False)
    poses = filter_poses(report, observed.observations)
    position, _ = report.tool_error(
        poses.coordinates[poses.measured], observed.observations.visits.target_m[poses.measured]
    )
    return position[:, free_axes(report.machine)[0]], observed.pose[poses.measured]


def pose_u_m(recording: Recording, reference: Reference, report: ReportFrame, phase: str) -> float:
    """Standard uncertainty of a measured coordinate of the platform: the root of the mean variance."""
    observed = observe(recording, reference, phase, drives_matter=False)
    covariance = filter_poses(report, observed.observations).covariance
    moves = np.flatnonzero(report.machine.dof < 3)
    variance = np.nanmean(np.diagonal(covariance, axis1=1, axis2=2)[:, moves])
    return float(np.sqrt(variance)) * reference.noise


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
    require_table_banks(rig)
    settle_tables(rig, store, notify)
    problems = check_rig(rig)
    payload = rig.supervisor.state().payload
    if problems or payload is None:
        raise CampaignRefused("; ".join(problems) or "the payload is being changed; calibrate when it is on")
    reference = load_reference(store, rig.file.rig, calibration.id, rig.machine, rig.file.payloads)
    campaign = new_campaign_id(rig.file.rig)
    store.work_on(campaign)
    header = describe_campaign(rig, campaign, utc_text(now_s()), kept_tables(rig, store))
    store.add_campaign(header, rig.machine.text)
    store.add_event(campaign, "settings", settings_event(rig))
    notify(f"campaign {campaign}: {measurement.extent}; {measurement.reason}")
    poses = LEAST_VERIFICATION_POSES
    total = (measurement.visits or 0) * len(reference.moving) + 2 * poses * len(reference.moving)
    with (
        open_runner(rig, store, campaign, lambda n, what: progress(n, total, what), "recalibrate", notify) as runner,
        changing_tables(rig, store, "calibrate", campaign) as change,
    ):
        return _Partial(runner, change, reference, measurement, payload, notify, now_s).run(calibration, judge)


@dataclass
class _Partial:
    runner: Runner
    change: TableChange
    reference: Reference
    measurement: Measurement
    payload: int
    notify: Notify
    now_s: Callable[[], float]

    def run(self, former: CalibrationFact, judge: Judge) -> PartialOutcome:
        rig = self.runner.rig
        block = verification_block(rig.machine, rig.file.campaign, self.payload)
        block = replace(block, visits=block.visits[:LEAST_VERIFICATION_POSES])
        planned = plan_visits(rig.file, self.reference, self.payload, self.measurement.visits or 0)
        rig.enable()
        rig.refresh_atmosphere()
        self.runner.run(put_on(self.runner.devices, self.payload), "payload")
        self.runner.run(warm_up(self.runner.devices, planned[:2]), "warm-up")
        require_station(rig)
        rig.compensation = int(self.change.former[0]["generation"]) if self.change.before.on else 0
        self._visit(block, BEFORE, "verification before")
        rig.compensate(None)
        self._visit(Block(self.payload, tuple(planned)), CALIBRATION, "calibration")
        fit = fit_partly(self.reference, self._recording(), self.measurement)
        self._keep_identified(fit)
        report = self.reference.report_frame(fit.frame)
        written, temperatures = self._write(fit, report)
        self._visit(block, AFTER, "verification after")
        self.change.require_in_use()
        return self._decide(former, judge, fit, report, written, temperatures)

    def _visit(self, block: Block, phase: str, plan: str) -> None:
        smrs = self.runner.devices.smrs("platform", "slider")
        self.runner.run(visits(self.runner.devices, block, phase, smrs), plan)

    def _recording(self) -> Recording:
        return self.runner.store.recording(self.runner.campaign)

    def _keep_identified(self, fit: Fit) -> None:
        rig, store = self.runner.rig, self.runner.store
        observed = observe(self._recording(), self.reference, CALIBRATION).observations
        data = identified_data(
            rig, store, fit, mean_temperatures_c(observed), extent=self.measurement.extent, now_s=self.now_s()
        )
        add_identified(rig, store, self.runner.campaign, data | {"report": dict(self.reference.report)})

    def _write(self, fit: Fit, report: ReportFrame) -> tuple[dict[str, dict[str, Any]], dict[str, float]]:
        rig = self.runner.rig
        temperatures, entry = rig.temperatures_c(), rig.file.payloads[self.payload]
        table = build_table(fit, report, OperatingConditions(entry.mass_kg, entry.com_m, temperatures))
        written = DriveTables(rig, self.change).try_out(table)
        activated = {"payload": self.payload, "temperatures_c": temperatures, "tables": written}
        self.runner.store.add_event(self.runner.campaign, "activated", activated)
        return written, temperatures

    def _decide(
        self,
        former: CalibrationFact,
        judge: Judge,
        fit: Fit,
        report: ReportFrame,
        written: dict[str, dict[str, Any]],
        temperatures: dict[str, float],
    ) -> PartialOutcome:
        recording, store, campaign = self._recording(), self.runner.store, self.runner.campaign
        (before, at), (after, also_at) = (
            tool_errors(recording, self.reference, report, phase) for phase in (BEFORE, AFTER)
        )
        common = np.intersect1d(at, also_at)
        if len(common) < LEAST_VERIFICATION_POSES:
            raise CampaignRefused(
                f"verification: {len(common)} poses were measured before and after, {LEAST_VERIFICATION_POSES} are "
                "needed; look for reflectors that were left out"
            )
        before, after = before[np.isin(at, common)], after[np.isin(also_at, common)]
        result = verify(before, after, pose_u_m(recording, self.reference, report, AFTER))
        self.notify(f"verification at {len(common)} poses: {result.reason}")
        verdict = {
            "t_utc_s": self.now_s(),
            "as_found": _rms(before, result.u_m),
            "without_tables": None,
            "as_left": _rms(after, result.u_m),
            "tables": written,
            "table_change": self.change.id,
            "table_temperatures_c": temperatures,
            "effects": [],
            "diagnosis": f"not diagnosed: {self.measurement.extent} only",
        }
        found = _identified(store, self.runner.rig, campaign)
        fact = calibration_fact(campaign, found, verdict)
        count = len(self.reference.model.parameters)
        grown = np.sqrt(np.diag(growth_of(self.reference, self.measurement))[:count])
        beyond: tuple[str, ...] = ()
        if result.accepted:
            beyond = judge(fact, self.change, ErrorFigure(**_rms(before, result.u_m)), grown)
        outcome = PartialOutcome(
            campaign, fact, result, beyond, fit.theta - self.reference.values[:count], self.change.description
        )
        self._keep_verdict(outcome, verdict)
        if outcome.accepted:
            self.change.keep()
        else:
            self.notify(f"the result is {'proposed' if beyond else 'refused'}; back to {self.change.description}")
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
