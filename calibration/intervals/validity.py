"""What must hold before anything is decided: a clock that runs forward, comparable facts, a tolerance wide enough.

Each function says in one line what is wrong, or what begins anew.
"""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime

from calibration.base.errors import InputError
from calibration.intervals.decision import require_decidable
from calibration.intervals.facts import MachineHistory

CLOCK_SLACK_S = 60.0


def require_clock(history: MachineHistory, now_utc_s: float) -> None:
    """Refuse a time before the newest stored fact; a minute is allowed for clocks of several computers."""
    last = history.last_time_utc_s
    if now_utc_s < last - CLOCK_SLACK_S:
        raise InputError(
            f"machine {history.machine.name}: now is {_date(now_utc_s)} UTC, but the store has a row of {_date(last)}: "
            "the clock was set back; set it right"
        )


def require_tolerance(history: MachineHistory, now_utc_s: float) -> None:
    """Refuse a tolerance that is below 2 U of the last check; without one there is nothing to compare."""
    if history.checks:
        require_decidable(history.machine.tolerance_m(now_utc_s), history.checks[-1].error.u_m)


def require_certificate(history: MachineHistory, serial: str, now_utc_s: float) -> None:
    """Refuse an instrument that is unknown or whose certificate has expired."""
    instrument = history.instrument(serial)
    if instrument is None:
        raise InputError(f"instrument {serial}: has no certificate in the rig file; enter it in [[certificates]]")
    if now_utc_s > instrument.due_utc_s:
        raise InputError(
            f"instrument {serial}: certificate {instrument.certificate} expired on {_date(instrument.due_utc_s)}: "
            "have it calibrated"
        )


def comparable(history: MachineHistory) -> tuple[MachineHistory, tuple[str, ...]]:
    """The part of a history that can be compared with today's machine, and remarks on what begins anew.

    Calibrations of other parameters than the machine has now, and all that was before them, are left out, and so are
    their checks. Another instrument than before is remarked; its checks stay (`drift` treats it as a step of its own).
    """
    names = set(history.machine.parameter_names)
    remarks = []
    kept = history
    other = [i for i, c in enumerate(history.calibrations) if set(c.parameter_names) != names]
    if other:
        kept_calibrations = history.calibrations[other[-1] + 1 :]
        ids = {c.id for c in kept_calibrations}
        kept = replace(
            history, calibrations=kept_calibrations, checks=tuple(c for c in history.checks if c.calibration in ids)
        )
        last = history.calibrations[other[-1]]
        changed = sorted(names ^ set(last.parameter_names))
        remarks.append(
            f"calibration {last.id} and older ones have other parameters ({', '.join(changed[:3])}"
            f"{', ...' if len(changed) > 3 else ''}): history begins anew after them"
        )
    before = kept.calibrations[-1].instrument if kept.calibrations else ""
    for check in kept.checks_since_calibration():
        if check.instrument != before:
            remarks.append(
                f"check {check.id}: instrument {check.instrument} in place of {before}: its first difference is not "
                "taken for a change of the machine"
            )
            before = check.instrument
    return kept, tuple(remarks)


def _date(t_utc_s: float) -> str:
    return datetime.fromtimestamp(t_utc_s, UTC).strftime("%Y-%m-%d %H:%M")
