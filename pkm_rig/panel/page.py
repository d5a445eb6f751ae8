"""One page: its head with control and Stop, its three views, and the second press; told apart by its client's name."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import run, ui

from calibration.base.errors import InputError, printable
from pkm_rig.errors import StoreError
from pkm_rig.panel.actions import Action
from pkm_rig.panel.history_view import HistoryView
from pkm_rig.panel.measure_view import MeasureView
from pkm_rig.panel.page_words import on_page
from pkm_rig.panel.rig_view import RigView
from pkm_rig.panel.work import Work

LOOK_S = 0.15  # of host time between two looks at what has changed
REMIND_S = 1.0  # and between two at what changes by itself, such as ages
STOP_NOTE = "stops the campaign; not an emergency stop"


class Page:
    """What one browser tab shows of a Work."""

    def __init__(self, work: Work, now_s: Callable[[], float]) -> None:
        self.work, self._now_s = work, now_s
        self.name = ui.context.client.id
        self._shown: tuple[int, ...] = ()
        self._shown_s = -1.0
        self._build()
        ui.context.client.on_delete(lambda: work.control.leave(self.name))
        ui.timer(LOOK_S, self._look)

    def _build(self) -> None:
        work = self.work
        with ui.header().classes("panel-head"):
            with ui.row().classes("full-width items-center no-wrap"):
                ui.label(work.file.rig).classes("name col")
                self._control = ui.button("Take control", on_click=self._take_control).props("dense flat no-caps")
                ui.button("Stop", on_click=self._stop).classes("stop").props("color=negative unelevated")
            with ui.row().classes("full-width items-center justify-between no-wrap note"):
                self._simulated = ui.label("SIMULATED").classes("simulated")
                self._controller = ui.label()
                ui.label(STOP_NOTE).classes("text-right")
        self._dialog = ui.dialog().props("persistent seamless position=bottom")  # Stop can be pressed beside it
        with ui.tabs().props("dense no-caps align=left") as tabs:
            for name in ("Measure", "Rig", "History"):
                ui.tab(name)
        with ui.tab_panels(tabs, value="Measure").classes("full-width bg-transparent").props("animated=false"):
            with ui.tab_panel("Measure").classes("q-pa-none q-pt-sm"):
                self._measure = MeasureView(self)
            with ui.tab_panel("Rig").classes("q-pa-none q-pt-sm"):
                self._rig = RigView(self)
            with ui.tab_panel("History").classes("q-pa-none q-pt-sm"):
                self._history = HistoryView(self)
        tabs.on_value_change(lambda event: self._history.show() if event.value == "History" else None)

    # --- what is pressed

    def press(self, action: Action) -> None:
        """A first press; what moves or writes opens the question that is the second."""
        try:
            prepared = self.work.press(self.name, action)
        except (InputError, StoreError) as error:
            self.say(str(error))
            return
        if prepared is None:
            return
        self._dialog.clear()
        with self._dialog, ui.card().classes("card question"):
            ui.label(f"{action.kind.capitalize()}?").classes("big")
            ui.label(prepared.text)
            with ui.row().classes("full-width justify-end"):
                ui.button("Cancel", on_click=self._dialog.close).props("flat no-caps")
                word = "Yes, go on" if action.kind == "go on" else f"Yes, {action.kind}"
                ui.button(word, on_click=lambda: self._press_again(prepared.secret)).props("color=negative no-caps")
        self._dialog.open()

    def _press_again(self, secret: str) -> None:
        self._dialog.close()
        try:
            self.work.press_again(self.name, secret)
        except InputError as error:
            self.say(str(error))

    def pause(self) -> None:
        """Pause the campaign under way."""
        try:
            self.work.pause(self.name)
        except InputError as error:
            self.say(str(error))

    def say(self, line: str) -> None:
        """A line to whoever has pressed something."""
        ui.notify(printable(on_page(line)), type="warning", multi_line=True, timeout=8000, close_button="Close")

    async def _stop(self) -> None:
        await run.io_bound(self.work.stop)

    def _take_control(self) -> None:
        if self.work.control.holder == self.name:
            self.work.control.leave(self.name)
        else:
            self.work.control.take(self.name)

    # --- what is seen

    @property
    def has_control(self) -> bool:
        """Whether this page commands."""
        return self.work.control.holder == self.name

    def _look(self) -> None:
        work, now_s = self.work, self._now_s()
        version = (work.live.version, work.version, work.control.changes)
        if version == self._shown and (not work.is_busy or now_s - self._shown_s < REMIND_S):
            return
        self._simulated.set_visibility(work.is_simulated)
        if version[2:] != self._shown[2:]:
            self._show_control()
        self._measure.refresh(work.snapshot())
        if version[1:] != self._shown[1:]:
            self._rig.refresh()
            self._history.refresh()
        self._shown, self._shown_s = version, now_s

    def _show_control(self) -> None:
        holder = self.work.control.holder
        if holder == self.name:
            self._controller.set_text("this page has control")
            self._control.set_text("Give up control")
        else:
            self._controller.set_text("nobody has control" if holder is None else "another page has control")
            self._control.set_text("Take control")
            self._dialog.close()
