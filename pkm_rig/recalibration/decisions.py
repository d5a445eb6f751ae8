"""What people enter: that a calibration may wait, and what has happened to the machine."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, date, datetime, time, timedelta
from typing import Any

from calibration.base.errors import InputError
from pkm_rig.jobs.life_record import utc_text
from pkm_rig.recalibration.situation import Situation
from pkm_rig.store.life import add_to_life
from pkm_rig.store.life_facts import POSTPONED
from pkm_rig.store.store import Store

NOTED = ("collision", "structure changed", "reference lost")
LONGEST = timedelta(days=366)


def postpone(store: Store, situation: Situation, who: str, why: str, until: str) -> str:
    """Let scheduled work wait until a date (its end, UTC) or a time; that time. InputError for one that cannot be."""
    end = _end_of(until)
    now = datetime.fromtimestamp(situation.now_utc_s, UTC)
    if not now < end <= now + LONGEST:
        raise InputError(f"recalibrate postpone: --until {until}: give an end within the next year")
    data = {"who": who.strip(), "why": why.strip(), "until_utc_s": end.timestamp()}
    _add(store, situation, POSTPONED, data)
    return utc_text(end.timestamp())


def note(store: Store, situation: Situation, event: str, part: str, who: str, why: str) -> None:
    """Enter an event that no device reports."""
    if event not in NOTED:
        raise InputError(f"recalibrate note: --event is one of {', '.join(NOTED)}")
    if event == "reference lost" and part.strip() not in ("", *situation.drives):
        raise InputError(f"recalibrate note: --part {part}: no such drive; there are {', '.join(situation.drives)}")
    data = {"part": part.strip(), "detail": why.strip(), "who": who.strip()}
    _add(store, situation, event, data)


def _add(store: Store, situation: Situation, kind: str, data: Mapping[str, Any]) -> None:
    add_to_life(
        store,
        "machine_events",
        rig=situation.rig,
        machine=situation.key,
        kind=kind,
        data=data,
        created=utc_text(situation.now_utc_s),
        campaign=None,
    )


def _end_of(until: str) -> datetime:
    try:
        if "T" not in until:
            return datetime.combine(date.fromisoformat(until) + timedelta(days=1), time(), tzinfo=UTC)
        end = datetime.fromisoformat(until)
    except (ValueError, OverflowError) as error:
        raise InputError(f"recalibrate postpone: --until '{until}' is no date; give it as 2027-01-31") from error
    return end if end.tzinfo else end.replace(tzinfo=UTC)
