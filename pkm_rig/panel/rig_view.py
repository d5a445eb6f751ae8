"""The rig: what its file says, what a check finds, homing, the station's test and the tables in the drives."""

from __future__ import annotations

from nicegui import ui
from nicegui.events import UploadEventArguments

from calibration.base.errors import InputError
from pkm_rig.panel.actions import MOST_UPLOAD_BYTES, Action, Kind, planned_readings_of, read_visits
from pkm_rig.panel.page_parts import PageOfWork
from pkm_rig.panel.page_words import on_page
from pkm_rig.panel.titles import title
from pkm_rig.panel.work import NO_RELEASE
from pkm_rig.report.notation import with_symbols

BUTTONS: tuple[tuple[str, Kind], ...] = (
    ("Check", "check"),
    ("Home what lost its reference", "home"),
    ("Home all drives again", "home again"),
    ("Test the station", "interim test"),
)
TABLE_BUTTONS: tuple[tuple[str, Kind], ...] = (
    ("Undo the last change", "tables rollback"),
    ("Switch compensation off", "tables off"),
)
WAITS_OR_ENDS = {"suspend": "waits", "stop": "ends"}


class RigView:
    """The second view of a page."""

    def __init__(self, page: PageOfWork) -> None:
        self._page = page
        self._buttons: list[ui.button] = []
        work = page.work
        with ui.element("div").classes("panes"):
            with ui.element("div").classes("card"):
                title("Rig file")
                for line in self._described():
                    ui.label(with_symbols(line))
                if not work.has_release_register:
                    ui.label(NO_RELEASE).classes("bad")
            with ui.element("div").classes("card"):
                title("Before measuring")
                with ui.row().classes("buttons"):
                    for word, kind in BUTTONS:
                        self._button(word, Action(kind))
                self._found = ui.column().classes("tight q-mt-sm")
            with ui.element("div").classes("card"):
                title("Tables in the drives")
                ui.label("The tables of an accepted campaign stay in use; they can be taken back.").classes("note")
                with ui.row().classes("buttons"):
                    for word, kind in TABLE_BUTTONS:
                        self._button(word, Action(kind))
            with ui.element("div").classes("card"):
                title("Other poses")
                ui.label(
                    "A campaign file (TOML, or a table in CSV) lists visits in place of those of the rig file."
                ).classes("note")
                self._upload = ui.upload(
                    label="campaign file", auto_upload=True, max_file_size=MOST_UPLOAD_BYTES, max_files=1,
                    on_upload=self._uploaded, on_rejected=lambda: page.say("not taken: one file, at most a megabyte"),
                )  # fmt: skip
                self._upload.props('accept=".toml,.csv" flat bordered dense').classes("full-width")
                self._visits = ui.column()
        self.refresh()

    def _button(self, word: str, action: Action) -> None:
        button = ui.button(word, on_click=lambda: self._page.press(action)).props("no-caps outline")
        self._buttons.append(button)

    def _described(self) -> list[str]:
        file, machine = self._page.work.rig_file
        readings = planned_readings_of(file, machine, verify=self._page.work.can_verify, measure=True)
        position = ", ".join(f"{x:g}" for x in file.station.position_m)
        return [
            f"machine: {machine.name}; drives: {', '.join(machine.drive_names)}",
            f"station: {file.station.name}, at {position} m",
            f"payloads: {', '.join(f'{p.name} ({p.mass_kg:g} kg)' for p in file.payloads)}",
            f"a calibration: {file.campaign.calibration_poses} poses, up to {readings} readings, verified with "
            f"{', '.join(file.payloads[n].name for n in file.campaign.verification_payloads)}",
            f"an interlock that opens: the campaign {WAITS_OR_ENDS[file.campaign.on_interlock]}",
            f"a reflector that is not seen: it {WAITS_OR_ENDS[file.campaign.on_unseen]}",
        ]

    async def _uploaded(self, event: UploadEventArguments) -> None:
        self._visits.clear()
        self._upload.reset()  # it takes one file: the next is another one
        try:
            visits = read_visits(event.file.name, await event.file.read(), self._page.work.machine)
        except InputError as error:
            self._page.say(str(error))
            return
        with self._visits:
            ui.label(f"{visits.name}: {len(visits.file.campaign.visits)} visits")
            self._button("Measure these", Action("measure", visits=visits))
        self.refresh()

    def refresh(self) -> None:
        """Show what the last check has found, and what may be pressed."""
        work = self._page.work
        for button in self._buttons:
            button.set_enabled(self._page.has_control and not work.is_busy)
        found = work.checked
        self._found.clear()
        if found is None:
            return
        with self._found:
            station = found["station"]
            lines = [] if station is None else [f"station {station['name']}, serial {station['serial']}"]
            for name, drive in found["drives"].items():
                lines.append(f"drive {name}: node {drive['node_id']}, serial {drive['serial']}, {drive['heartbeat']}")
            lines.append(f"predicted in-plane uncertainty of a visit: {found['in_plane_u_m'] * 1e6:.1f} um")
            lines += [f"tables: {found['tables']}"] if "tables" in found else []
            for line in lines:
                ui.label(with_symbols(line))
            for problem in found["problems"]:
                ui.label(with_symbols(on_page(problem))).classes("bad")
            if not found["problems"]:
                ui.label("fit for a campaign").classes("text-weight-medium")
