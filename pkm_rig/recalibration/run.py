"""One run: what is due is done, within the envelope and the gates of scheduled work; the rest waits, with reasons."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.intervals.extent import Measurement
from calibration.intervals.facts import CalibrationFact, ErrorFigure
from calibration.intervals.validity import require_certificate
from drivers.errors import DeviceError
from pkm_rig.errors import CampaignRefused, NotChecked, StoreError
from pkm_rig.jobs.calibrate import calibrate
from pkm_rig.jobs.health import health
from pkm_rig.jobs.interval_settings import interval_settings
from pkm_rig.jobs.life_record import STATION, note_devices, utc_text, verdict_data
from pkm_rig.jobs.partial import recalibrate_partly
from pkm_rig.jobs.tables_in_force import require_tables
from pkm_rig.recalibration.envelope import correction_change_m, reasons_beyond
from pkm_rig.recalibration.journal import is_automatic, last_entry, send_notification, tell_plc, write_line
from pkm_rig.recalibration.situation import Situation, date_text, situation_of
from pkm_rig.recalibration.windows import next_opening, open_until
from pkm_rig.results.callbacks import Notify, Progress
from pkm_rig.results.outcome import CampaignOutcome
from pkm_rig.rig.back_end import Correction
from pkm_rig.rig.capabilities import uses_tables
from pkm_rig.rig.config import RigFile, load_rig
from pkm_rig.rig.recalibration_sections import RecalibrationSettings
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.table_change import TableChange
from pkm_rig.store.life import IDENTIFIED, life_rows
from pkm_rig.store.life_facts import calibration_fact
from pkm_rig.store.store import Store

Done = Literal["nothing", "skipped", "check", "calibration", "proposal", "refused", "failed", "interrupted"]
Connect = Callable[[], AbstractContextManager[Rig]]


@dataclass
class RunResult:
    """What a run did and why, the machine's state after it, and whether somebody is asked for."""

    rig: str
    done: Done
    why: str
    state: str = "unknown"
    reasons: tuple[str, ...] = ()
    campaign: str | None = None
    alarm: bool = False
    next_utc_s: float | None = None
    told: dict[str, Any] = field(default_factory=dict)

    def entry(self, now_utc_s: float, command: str) -> dict[str, Any]:
        """The JSON line of the run."""
        return {
            "t_utc": utc_text(now_utc_s),
            "rig": self.rig,
            "command": command,
            "done": self.done,
            "why": self.why,
            "state": self.state,
            "reasons": list(self.reasons),
            "campaign": self.campaign,
            "alarm": self.alarm,
            "next_utc_s": self.next_utc_s,
            **self.told,
        }


@dataclass(frozen=True)
class Plan:
    """What is to be done now: nothing, a check, a calibration, or something that is skipped, and why."""

    what: Literal["nothing", "check", "calibration", "skipped"]
    why: str


def plan(situation: Situation, file: RigFile, *, scheduled: bool) -> Plan:
    """What a run would do, from what is stored; scheduled work also needs a window, and leave to calibrate alone."""
    if situation.state == "fit" and not situation.check_is_due:
        return Plan("nothing", f"nothing is due; the next check is on {date_text(situation.check_due_utc_s)}")
    due = "; ".join(situation.verdict.reasons) or "a check is due"
    hindrance = f"{situation.expired[0]}; have it renewed" if situation.expired else None
    if hindrance is None and scheduled:
        hindrance = _hindrance(situation, file.recalibration)
    if hindrance is not None:
        return Plan("skipped", f"{hindrance} ({due})")
    happened = situation.history.happened_since_calibration()
    is_checked = situation.check_is_due and situation.history.last_calibration is not None and not happened
    return Plan("check" if situation.state == "fit" or is_checked else "calibration", due)


def _hindrance(situation: Situation, section: RecalibrationSettings) -> str | None:
    """Why scheduled work must wait; None if it need not."""
    now_utc_s = situation.now_utc_s
    if situation.postponed_until_utc_s is not None:
        return f"postponed until {date_text(situation.postponed_until_utc_s)}"
    if situation.proposal is not None:
        return f"calibration {situation.proposal.campaign} waits for approval"
    if open_until(section.windows, section.time_zone, now_utc_s) is None:
        opening = next_opening(section.windows, section.time_zone, now_utc_s)
        return "no maintenance window is stated" if opening is None else f"the next window opens {date_text(opening)}"
    if situation.history.last_calibration is None:
        words = situation.begins_anew or "there is no calibration of this machine in the store"
        return f"{words}; the first one is made by hand, with `pkm-rig calibrate`"
    if situation.state != "fit" and not section.alone and not situation.check_is_due:
        return "calibration is not granted (recalibration.alone)"
    return None


@dataclass
class Recalibration:
    """One rig's runs: where its rig file and store are, how it is connected, and what time it is."""

    rig_path: Path
    out: Path
    store: Store
    connect: Connect
    notify: Notify
    progress: Progress
    now_s: Callable[[], float] = time.time

    def run(self, *, scheduled: bool, command: str = "run", quiet: bool = False) -> RunResult:
        """Do what is due. What goes wrong on the way is in the result, in the journal and told, not raised.

        quiet: nothing that was due leaves no line, and the same reason for skipping or failing only one. InputError
        where it cannot be judged what is due: nothing was touched. That and an interrupt leave their line too.
        """
        file, machine = load_rig(self.rig_path)
        try:
            situation = situation_of(self.store, file, machine, self.now_s())
        except InputError as error:
            result = RunResult(file.rig, "failed", str(error), alarm=True)
            if not (quiet and self._is_known(file.rig, result)):
                self._tell(file, result, command)
            raise
        intended = plan(situation, file, scheduled=scheduled)
        if intended.what in ("nothing", "skipped"):
            done: Done = "nothing" if intended.what == "nothing" else "skipped"
            alarm = done == "skipped" and situation.state != "fit"
            result = self._result(situation, done, intended.why, alarm=alarm)
        else:
            try:
                result = self._do(file, intended, scheduled=scheduled)
            except BaseException:  # it was ended from outside: the line is left, nobody is kept waiting
                why = f"interrupted before it was done ({intended.why})"
                broken = RunResult(file.rig, "interrupted", why, situation.state, alarm=True)
                write_line(self.out, file.rig, broken.entry(self.now_s(), command))
                raise
        if not (quiet and self._is_known(file.rig, result)):
            self._tell(file, result, command)
        return result

    def _is_known(self, rig: str, result: RunResult) -> bool:
        """Whether nothing was done, as the journal's last line says already."""
        if result.done == "nothing":
            return True
        last = last_entry(self.out, rig)
        same = (last.get("done"), last.get("why")) == (result.done, result.why)
        return result.done in ("skipped", "failed") and same

    def _do(self, file: RigFile, intended: Plan, *, scheduled: bool) -> RunResult:
        try:
            with self.connect() as rig:
                result = self._on(rig, intended, scheduled=scheduled)
                situation = situation_of(self.store, file, rig.machine, self.now_s())
                tell_plc(rig, file.recalibration.plc, situation, alarm=result.alarm, notify=self.notify)
                return result
        except (DeviceError, CampaignRefused, NotChecked, StoreError, InputError) as error:
            return RunResult(file.rig, "failed", str(error), alarm=True)

    def _on(self, rig: Rig, intended: Plan, *, scheduled: bool) -> RunResult:
        note_devices(rig, self.store, self.notify, self.now_s)
        if (why := self._lacks_certificate(rig)) is not None:
            return self._result(self._now(rig), "skipped", f"{why} ({intended.why})", alarm=True)
        if scheduled and not is_automatic(rig, rig.file.recalibration.plc):
            return self._result(
                self._now(rig), "skipped", f"the PLC does not grant the automatic mode ({intended.why})"
            )
        found: ErrorFigure | None = None
        checked: str | None = None
        before = self._now(rig)
        if intended.what == "check" and not before.history.happened_since_calibration():
            checkup = health(rig, self.store, self.notify, self.progress, self.now_s)
            found, checked = checkup.fact.error, checkup.fact.id
        situation = self._now(rig)
        if situation.state == "fit":
            return self._result(situation, "check", "the machine is fit", campaign=checked)
        if scheduled and not rig.file.recalibration.alone:
            why = f"{situation.state}; somebody has to calibrate (recalibration.alone is not granted)"
            return self._result(situation, "check" if checked else "skipped", why, campaign=checked, alarm=True)
        return self._calibrate(rig, situation, found)

    def _lacks_certificate(self, rig: Rig) -> str | None:
        """Why the station that answers must not be measured with, where the rig file has certificates of a station."""
        station = rig.station.identity
        if station is not None and any(entry.instrument == STATION for entry in rig.file.certificates):
            try:
                require_certificate(self._now(rig).history, str(station.serial), self.now_s())
            except InputError as error:
                return str(error)
        return None

    def _calibrate(self, rig: Rig, before: Situation, found: ErrorFigure | None) -> RunResult:
        last, measurement = before.history.last_calibration, before.verdict.measurement
        embedded = rig.file.can.interface == "embedded" and uses_tables(rig.file, rig.machine)
        if last is not None and embedded:  # its drives forget their tables
            with suppress(CampaignRefused):
                require_tables(rig, self.store, last.id, last.tables, self.notify)
        if last is not None and measurement is not None and measurement.extent != "full":
            return self._calibrate_partly(rig, before, last, measurement)
        settings, why = interval_settings(rig.file.recalibration), "; ".join(before.verdict.reasons)

        def judge(outcome: CampaignOutcome, change: TableChange) -> tuple[str, ...]:
            rows = life_rows(self.store, "calibrations", rig.file.rig, before.key)
            identified = [r for r in rows if (r.campaign, r.kind) == (outcome.campaign, IDENTIFIED)][-1]
            verdict = verdict_data(outcome, had_tables=change.before.on, change=change.id)
            new = calibration_fact(outcome.campaign, identified.data, verdict)
            tried = {written.payload: written.table for written in outcome.written}
            moved_m = correction_change_m(rig, self.store, last, change, tried)
            return reasons_beyond(rig.machine, before.history, settings, new, moved_m, found)

        outcome = calibrate(rig, self.store, self.notify, self.progress, judge=judge)
        after = self._now(rig)
        if outcome.beyond:
            return self._proposed(after, outcome.campaign, outcome.beyond)
        if not outcome.accepted:
            words = f"the tables were {outcome.decision}; {outcome.restored}"
            return self._result(after, "refused", words, campaign=outcome.campaign, alarm=True)
        return self._result(after, "calibration", why, campaign=outcome.campaign)

    def _calibrate_partly(
        self, rig: Rig, before: Situation, last: CalibrationFact, measurement: Measurement
    ) -> RunResult:
        settings = interval_settings(rig.file.recalibration)

        def judge(
            new: CalibrationFact,
            change: TableChange,
            tried: Mapping[int, Correction],
            found: ErrorFigure,
            grown: Array,
        ) -> tuple[str, ...]:
            moved_m = correction_change_m(rig, self.store, last, change, tried)
            return reasons_beyond(rig.machine, before.history, settings, new, moved_m, found, grown.tolist())

        outcome = recalibrate_partly(rig, self.store, last, measurement, self.notify, self.progress, judge, self.now_s)
        after = self._now(rig)
        if outcome.beyond:
            return self._proposed(after, outcome.campaign, outcome.beyond)
        words = f"{measurement.extent}: {measurement.reason}; {outcome.verification.reason}"
        if outcome.accepted:
            return self._result(after, "calibration", words, campaign=outcome.campaign)
        return self._result(after, "refused", f"{words}; calibrate in full", campaign=outcome.campaign, alarm=True)

    def _proposed(self, after: Situation, campaign: str, beyond: tuple[str, ...]) -> RunResult:
        words = f"tables are verified and wait for approval: {'; '.join(beyond)}"
        return self._result(after, "proposal", words, campaign=campaign, alarm=True)

    def _now(self, rig: Rig) -> Situation:
        return situation_of(self.store, rig.file, rig.machine, self.now_s())

    def _result(
        self, situation: Situation, done: Done, why: str, *, campaign: str | None = None, alarm: bool = False
    ) -> RunResult:
        return RunResult(
            situation.rig,
            done,
            why,
            situation.state,
            situation.verdict.reasons,
            campaign,
            alarm or situation.state == "out of tolerance",
            situation.check_due_utc_s if situation.state == "fit" else situation.now_utc_s,
        )

    def _tell(self, file: RigFile, result: RunResult, command: str) -> None:
        line = write_line(self.out, file.rig, result.entry(self.now_s(), command))
        result.told["notified"] = send_notification(file.recalibration.notify, line, self.notify)
