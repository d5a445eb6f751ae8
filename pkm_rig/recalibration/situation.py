"""What a rig's store says of its machine now: what is due and why, what waits, what hinders; no device is asked."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from calibration.base.errors import InputError
from calibration.intervals.check_estimate import expected_error_u_m
from calibration.intervals.decision import require_decidable
from calibration.intervals.facts import MachineHistory
from calibration.intervals.rules import Verdict, is_postponed, judge_all
from calibration.machine.description import Machine
from calibration.model.parameters import ParameterSet
from pkm_rig.jobs.check_readings import plan_check
from pkm_rig.jobs.interval_settings import DAY_S, interval_settings
from pkm_rig.jobs.reference import keeps_covariance, load_reference
from pkm_rig.rig.config import RigFile, load_rig
from pkm_rig.store.life import ACCEPTED, PROPOSED, LifeRow, life_rows, machine_key
from pkm_rig.store.life_facts import end_of_day_utc_s, machine_history
from pkm_rig.store.store import Store

APPROVED, WITHDRAWN = "approved", "withdrawn"


@dataclass(frozen=True)
class Situation:
    """The machine's history, the verdict of all rules on it, and what else decides whether something is done now.

    proposal: the calibration that waits for approval. expired: certificates that are no longer valid, in words.
    drives: names of its drives. check_due_utc_s: when the next check is due. begins_anew: that the store has another
    machine of this rig, in words.
    """

    rig: str
    key: str
    drives: tuple[str, ...]
    now_utc_s: float
    history: MachineHistory
    verdict: Verdict
    postponed_until_utc_s: float | None
    proposal: LifeRow | None
    expired: tuple[str, ...]
    check_due_utc_s: float
    begins_anew: str | None

    @property
    def state(self) -> str:
        """Fit, due or out of tolerance."""
        return self.verdict.state

    @property
    def check_is_due(self) -> bool:
        """Whether a check should be made now."""
        return self.now_utc_s >= self.check_due_utc_s

    def as_dict(self) -> dict[str, Any]:
        """For programs (docs/reference/json.md)."""
        verdict = self.verdict
        prediction = verdict.prediction
        return {
            "rig": self.rig,
            "machine": self.key,
            "state": self.state,
            "reasons": list(verdict.reasons),
            "remarks": [*([self.begins_anew] if self.begins_anew else []), *verdict.remarks],
            "rules": {r.rule: {"state": r.state, "reason": r.reason} for r in verdict.results},
            "measure": None if verdict.measurement is None else verdict.measurement.extent,
            "due_utc_s": verdict.due_utc_s,
            "interval_utc_s": None if prediction is None else [prediction.early_utc_s, prediction.late_utc_s],
            "act_by_utc_s": None if prediction is None else prediction.act_by_utc_s,
            "check_due_utc_s": self.check_due_utc_s,
            "postponed_until_utc_s": self.postponed_until_utc_s,
            "proposal": None if self.proposal is None else self.proposal.campaign,
            "expired": list(self.expired),
        }


def read_situation(store: Store, rig_path: Path, now_utc_s: float) -> tuple[Situation, RigFile]:
    """The situation of a rig file's machine; InputError in one line where it cannot be judged."""
    file, machine = load_rig(rig_path)
    return situation_of(store, file, machine, now_utc_s), file


def require_decidable_check(store: Store, rig_path: Path, situation: Situation) -> None:
    """InputError for a tolerance below 2 U of the first check, before it is made; later the last check tells.

    By the design of a check with all poses, without payload. Where the calibration's version kept no covariance there
    can be no check: that is said when it is to be made.
    """
    history, (file, machine) = situation.history, load_rig(rig_path)
    last = history.last_calibration
    if last is None or history.checks or not keeps_covariance(store, file.rig, last.id):
        return
    reference = load_reference(store, file.rig, last.id, machine, file.payloads)
    _, design = plan_check(file, reference, 0, interval_settings(file.recalibration).check.looks[-1])
    require_decidable(history.machine.tolerance_m(situation.now_utc_s), expected_error_u_m(design))


def situation_of(store: Store, file: RigFile, machine: Machine, now_utc_s: float) -> Situation:
    """The situation of a rig's machine. InputError: no tolerance, one below 2 U, or the clock was set back."""
    section = file.recalibration
    if section.tolerance_m is None:
        raise InputError("rig file: recalibration.tolerance_m is missing; state the largest error that is allowed")
    key = machine_key(machine, ParameterSet.of(machine).names)
    history = machine_history(store, file.rig, key, section.tolerance_m, now_utc_s)
    verdict = judge_all(history, interval_settings(section), now_utc_s)
    return Situation(
        rig=file.rig,
        key=key,
        drives=machine.drive_names,
        now_utc_s=now_utc_s,
        history=history,
        verdict=verdict,
        postponed_until_utc_s=_postponed_until(history, now_utc_s),
        proposal=waiting_proposal(store, file.rig, key),
        expired=tuple(expired_certificates(file, now_utc_s)),
        check_due_utc_s=_check_due(history, section.check_every_days),
        begins_anew=_begins_anew(store, file.rig, key) if history.last_calibration is None else None,
    )


def _begins_anew(store: Store, rig: str, key: str) -> str | None:
    former = [row.machine for row in life_rows(store, "calibrations", rig) if row.machine not in ("", key)]
    if not former:
        return None
    return (
        f"rig {rig}: another machine file, or other parameters, than before ({former[-1]}, now {key}): its history "
        "begins anew"
    )


def _postponed_until(history: MachineHistory, now_utc_s: float) -> float | None:
    if not is_postponed(history, now_utc_s):
        return None
    return max(one.until_utc_s for one in history.postponements if one.t_utc_s <= now_utc_s)


def _check_due(history: MachineHistory, every_days: float) -> float:
    """A check is due so long after the last check or calibration; at once after an event."""
    made = [c.t_utc_s for c in history.calibrations[-1:]] + [c.t_utc_s for c in history.checks[-1:]]
    if not made:
        return 0.0
    later = [event.t_utc_s for event in history.events if event.t_utc_s > max(made)]
    return min(later) if later else max(made) + every_days * DAY_S


def waiting_proposal(store: Store, rig: str, key: str) -> LifeRow | None:
    """The calibration that waits for approval: the last that was proposed, if nothing has been decided since."""
    rows = [r for r in life_rows(store, "calibrations", rig, key) if r.kind in (PROPOSED, ACCEPTED)]
    if not rows or rows[-1].kind != PROPOSED:
        return None
    events = life_rows(store, "machine_events", rig, key)
    ended = [e for e in events if e.kind in (APPROVED, WITHDRAWN) and e.campaign == rows[-1].campaign]
    return None if ended else rows[-1]


def expired_certificates(file: RigFile, now_utc_s: float) -> list[str]:
    """Certificates that are no longer valid, in words."""
    return [
        f"the certificate of {entry.instrument} ({entry.number}) has expired on {entry.due.isoformat()}"
        for entry in file.certificates
        if now_utc_s >= end_of_day_utc_s(entry.due.isoformat())
    ]


def days_until(t_utc_s: float | None, now_utc_s: float) -> float | None:
    """Days from now, at least 0; None for none."""
    return None if t_utc_s is None else max(0.0, (t_utc_s - now_utc_s) / DAY_S)


def date_text(t_utc_s: float | None) -> str:
    """A date for people."""
    return "none in sight" if t_utc_s is None else f"{datetime.fromtimestamp(t_utc_s, UTC):%Y-%m-%d %H:%M} UTC"
