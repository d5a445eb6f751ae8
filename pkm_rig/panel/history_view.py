"""Campaigns of the store: what became of each, its report, its diagnosis with pictures, and how it goes on."""

from __future__ import annotations

import contextlib
from typing import Any

from nicegui import run, ui

from calibration.base.errors import InputError
from calibration.diagnosis.result import Quantity
from pkm_rig.errors import StoreError
from pkm_rig.panel.actions import Action, Kind, Visits
from pkm_rig.panel.files import next_measurements, picture_url, pictures_of, report_of, report_url
from pkm_rig.panel.page_parts import PageOfWork
from pkm_rig.panel.titles import title
from pkm_rig.panel.work import Work
from pkm_rig.report.diagnosis_text import format_quantity
from pkm_rig.report.notation import with_symbols
from pkm_rig.store.place import has_store
from pkm_rig.store.store import open_existing_store
from pkm_rig.store.stored_rows import CampaignSummary, StoredEvent

MOST_CAMPAIGNS = 50
GOES_ON = ("interrupted", "failed")
NO_DETAIL: dict[str, list[Any]] = {"events": [], "pictures": [], "found": [], "next": []}
SAID = ("readings", "reason", "decision", "plan", "name", "why", "payload")


class HistoryView:
    """The third view of a page; read from the store when it is opened, and when a job ends."""

    def __init__(self, page: PageOfWork) -> None:
        self._page = page
        self._buttons: list[ui.button] = []
        self._is_shown = False
        with ui.element("div").classes("card full-width"):
            title("Campaigns")
            self._list = ui.column().classes("full-width tight")
        with ui.element("div").classes("card full-width q-mt-sm") as self._card:
            self._detail = ui.column().classes("full-width tight")
        self._card.set_visibility(False)

    async def show(self) -> None:
        """Read the list anew."""
        self._is_shown = True
        campaigns = await run.io_bound(campaigns_of, self._page.work) or []
        self._buttons.clear()
        self._list.clear()
        with self._list:
            if not campaigns:
                ui.label("none yet")
            for summary in campaigns:
                self._campaign(summary)
        self._enable()

    def refresh(self) -> None:
        """What may be pressed has changed, or a job has ended."""
        self._enable()
        if self._is_shown and not self._page.work.is_busy:
            ui.timer(0.05, self.show, once=True)

    def _enable(self) -> None:
        for button in self._buttons:
            button.set_enabled(self._page.has_control and not self._page.work.is_busy)

    def _campaign(self, summary: CampaignSummary) -> None:
        campaign = summary.campaign
        with ui.element("div").classes("campaign full-width"):
            ui.label(campaign).classes("text-weight-medium")
            state = f"{summary.state} {summary.step}".strip()
            simulated = ", SIMULATED" if summary.simulated else ""
            ui.label(f"{state}: {summary.readings} readings, {summary.created[:16].replace('T', ' ')}{simulated}")
            if summary.damage:
                ui.label(summary.damage).classes("bad")
                return
            with ui.row().classes("buttons"):
                ui.button("Details", on_click=lambda: self._open(campaign)).props("no-caps flat dense")
                if report_of(self._page.work.out, campaign) is not None:
                    ui.link("Report", report_url(campaign), new_tab=True)
                elif summary.state != "running":
                    self._button("Write the report", Action("report", campaign))
                kind: Kind = "calibrate" if self._page.work.can_verify else "measure"
                if summary.state == "measured" and kind == "calibrate":
                    self._button("Verify", Action("verify", campaign))
                if summary.state in GOES_ON or (summary.state == "refused" and summary.step):  # before a verdict
                    self._button("Go on", Action(kind, campaign))
                    self._button("Go on, the station stands anew", Action(kind, campaign, new_setup=True))
                if summary.readings:
                    self._button("Diagnose", Action("diagnose", campaign))

    def _button(self, word: str, action: Action) -> None:
        button = ui.button(word, on_click=lambda: self._page.press(action)).props("no-caps outline dense")
        self._buttons.append(button)

    async def _open(self, campaign: str) -> None:
        detail = await run.io_bound(detail_of, self._page.work, campaign) or NO_DETAIL
        self._card.set_visibility(True)
        self._detail.clear()
        with self._detail:
            title(campaign)
            for line in detail["found"]:
                ui.label(with_symbols(line))
            for visits, resumes in detail["next"]:
                count = len(visits.file.campaign.visits)
                self._button(
                    f"Measure next: {visits.name} ({count} visits)",
                    Action("measure", campaign if resumes else None, visits),
                )
            for name in detail["pictures"]:
                ui.image(picture_url(campaign, name)).classes("full-width").style("max-width: 50rem")
            ui.label("\n".join(detail["events"])).classes("lines")
        self._enable()
        self._card.run_method("scrollIntoView")


def campaigns_of(work: Work) -> list[CampaignSummary]:
    """The last campaigns of the store, newest first; none where there is no store."""
    if not has_store(work.out):
        return []
    with open_existing_store(work.out) as store:
        return list(reversed(store.campaigns()))[:MOST_CAMPAIGNS]


def detail_of(work: Work, campaign: str) -> dict[str, Any]:
    """What there is to be seen of one campaign."""
    with open_existing_store(work.out) as store:
        events = store.events(campaign)
    kinds = {event.kind for event in events}
    resumes = not kinds & {"identified", "verifying", "accepted", "refused", "imported"}
    following: list[tuple[Visits, bool]] = []
    with contextlib.suppress(InputError, StoreError):
        following = [(visits, resumes) for visits in next_measurements(work.out, campaign, work.machine)]
    diagnosed = work.diagnosed.get(campaign) or next((e.data for e in reversed(events) if e.kind == "diagnosed"), None)
    return {
        "events": [_event_line(event) for event in events],
        "pictures": pictures_of(work.out, campaign),
        "found": [] if diagnosed is None else diagnosis_lines(diagnosed),
        "next": following,
    }


def diagnosis_lines(found: dict[str, Any]) -> list[str]:
    """A diagnosis in a few lines: the verdict, its effects, the gap, what to measure next."""
    if "failure" in found:
        return [f"no diagnosis: {found['failure']}"]
    verdict = {"none": "no effect beyond the model", "unknown": "something that no effect explains"}
    lines = [f"diagnosis: {verdict.get(found['verdict'], found['verdict'])}"]
    for effect in found["effects"]:
        size = Quantity("", effect["value"] or 0.0, effect["u"] or 0.0, effect["unit"])
        value = "" if effect["value"] is None else f", {format_quantity(size)}"
        share = "" if effect["probability"] is None else f", probability {effect['probability']:.2f}"
        lines.append(f"{effect['effect']} at {effect['place'] or 'no single place'}{value}{share}")
    gap = found["gap"]
    if gap["before_m"] is not None and gap["after_m"] is not None:
        after = f", {gap['after_m'] * 1e6:.1f} um with it" if found["effects"] else ""
        lines.append(f"gap on withheld data: {gap['before_m'] * 1e6:.1f} um{after}")
    for entry in found["next_measurement"]:
        minutes = "" if entry["minutes"] is None else f", {entry['minutes']:.0f} min"
        lines.append(f"to measure next: {entry['name']}: {entry['adds']}{minutes}")
    return lines


def _event_line(event: StoredEvent) -> str:
    said = ", ".join(f"{key} {event.data[key]}" for key in SAID if event.data.get(key) not in (None, ""))
    return f"{event.created[:19].replace('T', ' ')}  {event.kind}{': ' if said else ''}{said[:300]}"
