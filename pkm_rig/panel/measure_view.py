"""What is under way: what is asked of the operator, progress, the machine, guards, readings and the model so far."""

from __future__ import annotations

import math

from nicegui import ui

from pkm_rig.panel.actions import Action
from pkm_rig.panel.files import report_of, report_url
from pkm_rig.panel.machine_view import MachineView, Scenes, mesh_of
from pkm_rig.panel.page_parts import PageOfWork
from pkm_rig.panel.page_words import on_page
from pkm_rig.panel.titles import title
from pkm_rig.panel.trend import trend_svg
from pkm_rig.report.asked import asked_of
from pkm_rig.report.notation import with_symbols
from pkm_rig.report.terminal_live import left_in_words
from pkm_rig.rig.live import Guard, LastReading, Snapshot

TREND = "geometric mean over the parameters of standard uncertainty now / before"
RESIDUAL = "residual: from the nominal machine, the mean of the reflector's readings taken off"
ENDED = "The campaign has ended before its time: put right what is said below, then go on"
GO_ON = "press Go on"
LAST_SEEN = "as they were seen last: nothing is connected now"
SIGNS = {"good": "●", "bad": "▲", "unknown": "○"}


class MeasureView:
    """The first view of a page."""

    def __init__(self, page: PageOfWork) -> None:
        self._page = page
        self._guards: dict[str, tuple[Guard, ui.label, ui.label]] = {}
        self._scenes = Scenes(page.work.machine, page.work.file)
        self._estimate_version = -1
        with ui.element("div").classes("panes"):
            with ui.element("div").classes("card whole asked") as self._asked:
                self._asked_action = ui.label().classes("big")
                self._asked_text = ui.label()
                self._take_up = ui.button("", on_click=self._press_take_up).props("no-caps")
                self._go_on = ui.button("Go on", on_click=lambda: page.press(Action("go on"))).props("no-caps")
            with ui.element("div").classes("card whole"):
                self._build_progress()
            with ui.element("div").classes("card"):
                self._place = ui.label().classes("note")
                with ui.element("div").classes("machine"):
                    self._machine = MachineView()
                self._field_note = ui.label().classes("note")
            with ui.element("div").classes("card"):
                title("Guards")
                self._guard_note = ui.label(LAST_SEEN).classes("note")
                self._guard_list = ui.element("div")
            with ui.element("div").classes("card"):
                title("Last readings")
                columns = ("number", "phase", "reflector", "pose", "distance / m", "residual / µm")
                self._readings = ui.table(
                    columns=[{"name": c, "label": c, "field": c, "align": "right"} for c in columns],
                    rows=[],
                    row_key="number",
                ).props("dense flat square hide-bottom")
                self._readings.classes("full-width readings")
                ui.label(RESIDUAL).classes("note")
            with ui.element("div").classes("card"):
                title("The model so far")
                self._model = ui.label("not identified yet").classes("note")
                self._trend_note = ui.label(TREND).classes("note")
                self._trend = ui.html("", sanitize=False).classes("full-width trend")
            with ui.element("div").classes("card whole"):
                title("Messages")
                self._lines = ui.label().classes("lines")

    def _build_progress(self) -> None:
        page = self._page
        self._state = ui.label().classes("big")
        self._bar = ui.linear_progress(0.0, show_value=False, size="10px").props("instant-feedback")
        with ui.row().classes("buttons"):
            self._count = ui.label().classes("count")
            self._left = ui.label()
        self._result = ui.label()
        self._report = ui.link("Report", "", new_tab=True)
        with ui.row().classes("buttons"):
            self._calibrate = ui.button("Calibrate", on_click=lambda: page.press(Action("calibrate"))).props("no-caps")
            self._measure = ui.button("Measure only", on_click=lambda: page.press(Action("measure")))
            self._measure.props("no-caps outline")
            self._pause = ui.button("Pause", on_click=page.pause).props("no-caps outline")

    def refresh(self, seen: Snapshot) -> None:
        """Show what has changed."""
        self._show_progress(seen)
        self._show_request(seen)
        self._show_guards(seen.guards)
        self._guard_note.set_visibility(bool(seen.guards) and math.isnan(seen.t_rig_s))
        self._machine.show(self._scenes.of(seen))
        self._place.set_text(_place(seen))
        rows = [_row(reading) for reading in reversed(seen.readings)]
        if rows != self._readings.rows:  # NiceGUI sends a table whole each time that it is given its rows
            self._readings.rows = rows
        self._lines.set_text(with_symbols("\n".join(on_page(line) for line in reversed(seen.lines))))
        self._show_estimate()

    def _show_progress(self, seen: Snapshot) -> None:
        work = self._page.work
        job = work.job
        if job is None:
            self._state.set_text("Nothing is under way")
        elif job.result is None:
            step = "stopping" if job.stopping else seen.phase or "connecting"
            self._state.set_text(f"{job.action.kind.capitalize()}: {step}")
        else:
            self._state.set_text(f"{job.action.kind.capitalize()}: {'done' if job.result.good else 'ended'}")
        line = "" if job is None or job.result is None else with_symbols(on_page(job.result.line))
        self._result.set_text(line)
        self._result.classes(remove="bad", add="bad" if job and job.result and not job.result.good else "")
        campaign = None if job is None or job.result is None else job.result.campaign
        self._report.set_visibility(campaign is not None and report_of(work.out, campaign) is not None)
        self._report.props(f'href="{report_url(campaign or "")}"')
        self._bar.set_value(min(1.0, seen.done / seen.total) if seen.total else 0.0)
        self._count.set_text(f"{seen.done} of {seen.total} readings" if seen.total else "")
        left = seen.left_s if work.is_busy else None
        self._left.set_text("" if left is None else f"about {left_in_words(left)} left")
        busy, control = work.is_busy, self._page.has_control
        self._calibrate.set_enabled(control and not busy and work.can_verify)
        self._measure.set_enabled(control and not busy)
        self._pause.set_enabled(control and busy)

    def _show_request(self, seen: Snapshot) -> None:
        asked, goes_on = asked_of(seen, GO_ON), self._goes_on()
        self._asked.set_visibility(asked is not None or goes_on is not None)
        self._take_up.set_visibility(goes_on is not None)
        if goes_on is not None:
            self._asked_action.set_text(ENDED)
            self._asked_text.set_text("All readings are kept.")
            self._take_up.set_text("Go on in a new set-up" if goes_on.new_setup else "Go on with the campaign")
            self._take_up.set_enabled(self._page.has_control)
            self._go_on.set_visibility(False)
            return
        if asked is None:
            return
        self._asked_action.set_text(with_symbols(asked.action))
        self._asked_text.set_text(with_symbols(on_page(asked.why)))
        self._go_on.set_visibility(asked.goes_on)
        self._go_on.set_enabled(asked.goes_on and self._page.has_control)

    def _goes_on(self) -> Action | None:
        """What goes on with the campaign that has just ended before its time."""
        job = self._page.work.job
        return None if job is None or job.result is None else job.result.goes_on

    def _press_take_up(self) -> None:
        goes_on = self._goes_on()
        if goes_on is not None:
            self._page.press(goes_on)

    def _show_guards(self, guards: tuple[Guard, ...]) -> None:
        if [guard.name for guard in guards] != list(self._guards):
            self._guard_list.clear()
            self._guards = {}
            with self._guard_list:
                for guard in guards:
                    with ui.element("div").classes("guard"):
                        light = ui.label(SIGNS[guard.light]).classes(f"light-{guard.light}")
                        ui.label(guard.name)
                        value = ui.label(with_symbols(guard.value)).classes("note")
                    self._guards[guard.name] = (guard, light, value)
            return
        for guard in guards:
            before, light, value = self._guards[guard.name]
            if before.light != guard.light:
                light.set_text(SIGNS[guard.light])
                light.classes(remove=f"light-{before.light}", add=f"light-{guard.light}")
            value.set_text(with_symbols(guard.value))
            self._guards[guard.name] = (guard, light, value)

    def _show_estimate(self) -> None:
        follower = self._page.work.follower
        if follower.version == self._estimate_version:
            return
        self._estimate_version = follower.version
        estimates = follower.estimates
        if not estimates:
            self._model.set_text("not identified yet")
            self._trend.set_content("")
            self._trend_note.set_visibility(False)
            self._machine.field(None)
            self._field_note.set_text("")
            return
        last = estimates[-1]
        self._trend_note.set_visibility(True)
        self._model.set_text(with_symbols(last.line))
        self._trend.set_content(trend_svg([e.readings for e in estimates], [e.share_left for e in estimates]))
        self._machine.field(mesh_of(last.field_m, last.field_error_m, last.columns))
        most_um = float(last.field_error_m.max()) * 1e6
        self._field_note.set_text(f"colour: predicted error of the tool, dark none, light {most_um:.0f} µm")


def _place(seen: Snapshot) -> str:
    if seen.pose is None:
        return "the machine in the middle of its workspace; nothing has been heard of the drives yet"
    tool = ", ".join(f"{x * 1e3:.1f}" for x in seen.pose[:3])
    if seen.target is None:
        return f"tool at {tool} mm"
    target = ", ".join(f"{x * 1e3:.1f}" for x in seen.target[:3])
    return f"tool at {tool} mm, target {seen.target_number} at {target} mm"


def _row(reading: LastReading) -> dict[str, str]:
    away = "" if math.isnan(reading.residual_m) else f"{reading.residual_m * 1e6:.0f}"
    return {
        "number": str(reading.sequence),
        "phase": reading.phase.replace("_", " "),
        "reflector": reading.smr,
        "pose": "" if reading.pose < 0 else str(reading.pose),
        "distance / m": f"{reading.distance_m:.5f}",
        "residual / µm": away,
    }
