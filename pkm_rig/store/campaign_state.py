"""Where a campaign stands: whether it runs, how it ended, and at which step, from its events."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

from pkm_rig.store.sessions import BEGUN, ENDED
from pkm_rig.store.stored_rows import StoredEvent

State = Literal["running", "interrupted", "refused", "accepted", "failed", "measured", "imported"]
_STEPS = {  # what is under way, or comes next, after an event
    "session_begun": "connecting",
    "identified": "identifying",
    "diagnosed": "identifying",
    "verifying": "verifying",
    "activated": "verifying",
}


class CampaignState(NamedTuple):
    """A campaign's state and the step that it is at, or came to."""

    state: State
    step: str


def campaign_state(events: Sequence[StoredEvent], *, is_worked_on: bool) -> CampaignState:
    """The state of a campaign. One that somebody works on runs, also before its session has begun.

    A session without an end on which nobody works was killed.
    """
    kinds = [event.kind for event in events]
    step = _step(events)
    if "accepted" in kinds or "refused" in kinds:
        return CampaignState("accepted" if "accepted" in kinds else "refused", "")
    last = next((event for event in reversed(events) if event.kind in (BEGUN, ENDED)), None)
    is_begun = last is not None and last.kind == BEGUN
    if is_worked_on:
        return CampaignState("running", step if is_begun else "connecting")
    if last is None:
        return _state_of_former_version(events, step)
    if is_begun:
        return CampaignState("interrupted", step)
    if last.data["why"] == "finished":
        return CampaignState("measured", "")
    return CampaignState(last.data["why"], step)


def is_measured(events: Sequence[StoredEvent]) -> bool:
    """Whether the calibration's readings are all there: its plan has finished since it was last begun."""
    plans = [e.kind for e in events if e.data.get("plan") == "calibration" and e.kind in ("started", "finished")]
    return bool(plans) and plans[-1] == "finished"


def _step(events: Sequence[StoredEvent]) -> str:
    for event in reversed(events):
        if event.kind in _STEPS:
            return _STEPS[event.kind]
        plan = event.data.get("plan")
        if event.kind == "finished" and plan == "verification before":
            return "writing"
        if plan is not None:
            return "measuring" if plan in ("calibration", "set-up") else "verifying"
    return ""


def _state_of_former_version(events: Sequence[StoredEvent], step: str) -> CampaignState:
    """Version 0.1 kept no sessions: a plan that neither finished nor failed was killed."""
    if not events or events[-1].kind == "imported":
        return CampaignState("imported", "")
    failed = next((e.kind for e in reversed(events) if e.kind in ("failed", "finished", "started")), "")
    if failed == "failed":
        return CampaignState("failed", step)
    return CampaignState("measured", "") if failed == "finished" else CampaignState("interrupted", step)
