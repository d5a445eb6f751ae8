"""One session of a campaign in the store: when this process' work on it began and ended, and why."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from calibration.base.errors import InputError
from pkm_rig.errors import CAMPAIGN_NOTE, CampaignRefused, StoreError
from pkm_rig.rig.clock import ScaledClock
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.rig_checks import require_same_kind
from pkm_rig.store import sessions
from pkm_rig.store.sessions import BEGUN, ENDED, Moment
from pkm_rig.store.store import Store

WAIT_S = 60.0  # by which the rig's clock may lie behind the campaign: it is waited for


@contextmanager
def session(
    rig: Rig,
    store: Store,
    campaign: str,
    command: str,
    notify: Callable[[str], None],
    utc_s: Callable[[], float] = time.time,
) -> Iterator[int]:
    """Record the begin and the end of a session; its number.

    The store is held for the campaign meanwhile: StoreError if another process holds it. InputError if the rig's clock
    lies before the campaign's end, for times would overlap, and for simulated devices where the campaign's were real.
    """
    require_same_kind(rig, store, campaign)
    store.work_on(campaign)
    try:
        with _recorded(rig, store, campaign, command, notify, utc_s) as number:
            yield number
    finally:
        store.work_on(None)


@contextmanager
def _recorded(
    rig: Rig, store: Store, campaign: str, command: str, notify: Callable[[str], None], utc_s: Callable[[], float]
) -> Iterator[int]:
    after = last_moment(store, campaign)
    if after is not None:
        _require_later(rig, after, campaign)
    number = 1 + max((int(e.data["session"]) for e in store.events(campaign, BEGUN)), default=0)
    scale = rig.clock.time_scale if isinstance(rig.clock, ScaledClock) else None

    def now() -> dict[str, float]:
        return {"t_rig_s": rig.clock.now_s(), "t_utc_s": utc_s()}

    moment = now()
    set_back_s = 0.0 if after is None else after.set_back_s(moment["t_utc_s"])
    if set_back_s > 0.0:
        moment["set_back_s"] = set_back_s
        notify(
            f"the computer's clock was set back by {set_back_s:.0f} s since the campaign's last session; "
            "the time between them counts as none"
        )
    store.add_event(campaign, BEGUN, {"session": number, "command": command, **moment, "time_scale": scale})
    try:
        yield number
    except BaseException as error:
        error.add_note(CAMPAIGN_NOTE + campaign)
        with contextlib.suppress(StoreError):
            end = {"session": number, **now(), "why": _why(error), "reason": str(error) or "interrupted"}
            store.add_event(campaign, ENDED, end | {"head": store.head(campaign)})
        raise
    end = {"session": number, **now(), "why": "finished"}
    store.add_event(campaign, ENDED, end | {"head": store.head(campaign)})


def last_moment(store: Store, campaign: str) -> Moment | None:
    """Where a campaign ended, on both clocks; None if it has not begun."""
    recording = store.recording(campaign) if store.has_readings(campaign) else None
    return sessions.last_moment(recording, store.events(campaign))


def _require_later(rig: Rig, after: Moment, campaign: str) -> None:
    behind_s = after.t_rig_s - rig.clock.now_s()
    if 0.0 < behind_s <= WAIT_S:
        rig.wait(behind_s)
    elif behind_s > 0.0:
        raise InputError(
            f"campaign {campaign}: it ended at rig time {after.t_rig_s:.0f} s and this rig's clock is {behind_s:.0f} s "
            "before that; connect the rig for this campaign"
        )


def _why(error: BaseException) -> str:
    if not isinstance(error, Exception):
        return "interrupted"
    return "refused" if isinstance(error, CampaignRefused) else "failed"
