"""Runs plans on a connected rig: run engine, store and progress, with one clear cause when it ends badly."""

from __future__ import annotations

import contextlib
import logging
import os
import secrets
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import bluesky.preprocessors as bpp
import numpy as np
from bluesky import RunEngine
from bluesky.utils import DuringTask

from calibration.recording.header import KnownTable, RecordingFile, StationEntry
from calibration.recording.recording import Recording
from calibration.reduction.nest_checks import nest_shift, usable_readings
from calibration.reduction.reduction import CALIBRATION
from drivers.errors import DeviceError, NoAnswer, SettingsChanged
from pkm_rig.errors import CampaignRefused, StoreError
from pkm_rig.rig.config import EMBEDDED, embedded_rig_path
from pkm_rig.rig.control_watch import WatchedMachine
from pkm_rig.rig.devices import MachineDevice, ReadingTags, StationDevice, WaitDevice
from pkm_rig.rig.operator_devices import PayloadDevice, WaitingDevice
from pkm_rig.rig.plans import CampaignDevices, Plan
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.schedule import Block
from pkm_rig.rig.session_record import session
from pkm_rig.rig.waiting import Waiting
from pkm_rig.rig.worker import Worker
from pkm_rig.store.store import Store
from pkm_rig.version import __version__

SETTINGS = "settings_since_check"
NEW_SETUP = "new_setup"
EXPECTED_ERRORS = (DeviceError, CampaignRefused, StoreError)


class _Interrupted(BaseException):
    """KeyboardInterrupt on its way through the engine, which would take that for a wish to pause its plan."""


class _UntilDone(DuringTask):
    """The thread that runs a plan waits for its end; nothing else happens in it."""

    def __init__(self) -> None:
        """Nothing to prepare; typed, as the engine's is not."""

    def block(self, blocking_event: threading.Event) -> None:
        """Wait for the event."""
        try:
            blocking_event.wait()
        except KeyboardInterrupt:
            raise _Interrupted from None


class Runner:
    """One campaign on one rig. `stage` is what plans are written against."""

    def __init__(
        self,
        rig: Rig,
        store: Store,
        campaign: str,
        progress: Callable[[int, str], None],
        notify: Callable[[str], None] = lambda _line: None,
        order: Sequence[Block] = (),
    ) -> None:
        self.rig, self.store, self.campaign = rig, store, campaign

        def note(kind: str, data: dict[str, Any]) -> None:
            store.add_event(campaign, kind, data)

        self._waiting = Waiting(rig, notify, note)
        self._worker = Worker(self._waiting.suspends_at)
        tags = ReadingTags()
        self.devices = CampaignDevices(
            rig=rig,
            tags=tags,
            machine=WatchedMachine(rig, self._worker, tags, order, notify)
            if rig.moved_by_control
            else MachineDevice(rig, self._worker, tags),
            payload=PayloadDevice(rig, self._worker, notify, note, progress, self._waiting.hold),
            station=StationDevice(rig, self._worker, tags),
            wait=WaitDevice(rig, self._worker),
            progress=progress,
            note=note,
            waiting=WaitingDevice(self._worker, self._waiting, tags),
            nest_shift_m=lambda: float(nest_shift(store.recording(campaign, phase="nests"))[1][-1]),
        )
        self._engine = RunEngine({}, context_managers=[], during_task=_UntilDone())
        self._engine.log.logger.addHandler(logging.NullHandler())  # causes are raised, not logged with tracebacks
        self._engine.subscribe(self._store_reading, "event")
        self._failure: BaseException | None = None

    def close(self) -> None:
        """End the worker and the engine's loop."""
        self._worker.close()
        loop, thread = self._engine.loop, self._engine._th  # the engine has no close of its own
        loop.call_soon_threadsafe(loop.stop)
        thread.join(timeout=10.0)
        if not thread.is_alive():
            loop.close()

    def resume(self, recording: Recording) -> None:
        """Go on with a stored campaign: its numbers; what can be used is kept.

        The next nest check closes what has been measured since the last one, but only in the same set-up, and where the
        station was found with the settings that it had been given: else it leaves out the number that those readings
        would need, so that they are never used. A set-up that was begun (`begin_setup`) has no first check yet.
        """
        tags = self.devices.tags
        begun = [int(event.data["setup"]) for event in self.store.events(self.campaign, NEW_SETUP)]
        tags.setup = max(_last_setup(recording), *begun) if begun else _last_setup(recording)
        is_new = tags.setup > _last_setup(recording)
        tags.sequence = int(recording["sequence"].max()) + 1
        tags.visit_number = int(recording["visit"].max())
        last = int(recording["nest_check"].max())
        settings_events = [event.data.get(SETTINGS, {}) for event in self.store.events(self.campaign, "failed")]
        settings_unchanged = (
            self.rig.station.settings_unchanged_on_connect or {"check": last, "held": True} in settings_events
        )
        closes = not is_new and settings_unchanged and {"check": last, "held": False} not in settings_events
        tags.nest_check = last if closes else last + 1
        usable = usable_readings(recording, None if is_new else tags.nest_check + 1)
        measured = usable & (np.asarray(recording["phase"]) == CALIBRATION)
        for pose, pass_, smr in zip(*(recording[name][measured] for name in ("pose", "pass", "smr")), strict=True):
            self.devices.stored.add((CALIBRATION, int(pose), int(pass_), str(smr)))
        if self.rig.moved_by_control:
            self._doubt_last_visit(recording)

    def _doubt_last_visit(self, recording: Recording) -> None:
        """Measure the last visit anew if the session ended in it: nobody saw that the machine stood until its end."""
        last = int(np.argmax(recording["sequence"]))
        if str(recording["phase"][last]) != CALIBRATION:
            return
        pose, pass_, visit = (int(recording[name][last]) for name in ("pose", "pass", "visit"))
        stored = self.devices.stored
        stored.difference_update([key for key in stored if key[:3] == (CALIBRATION, pose, pass_)])
        self.devices.in_doubt[pose, pass_] = visit

    def begin_setup(self, recording: Recording) -> None:
        """Have the campaign go on in a new set-up of the station, at the rig file's place of it: before `resume`."""
        place = self.rig.file.station.model_dump(mode="json", include={"position_m", "heading_rad"})
        self.store.add_event(self.campaign, NEW_SETUP, {"setup": _last_setup(recording) + 1, **place})

    def run(self, plan: Plan, purpose: str) -> None:
        """Run a plan to its end; on any failure all drives are stopped and the first cause is raised."""
        self.store.add_event(self.campaign, "started", {"plan": purpose})
        self._failure = None
        try:
            with open(os.devnull, "w") as quiet, contextlib.redirect_stdout(quiet):
                self._engine(bpp.run_wrapper(plan, md={"campaign": self.campaign, "purpose": purpose}))
        except BaseException as error:
            self._waiting.end()
            cause = self._first_cause(error)
            with contextlib.suppress(DeviceError):
                self.rig.stop(str(cause) or "interrupted")
            self._end_plan()
            with contextlib.suppress(StoreError):
                reason = str(cause) or type(cause).__name__
                failed = {"plan": purpose, "reason": reason, "emergencies": emergency_log(self.rig)}
                self.store.add_event(self.campaign, "failed", failed | self._settings(cause))
            if cause is error:
                raise
            raise cause from error
        self.store.add_event(self.campaign, "finished", {"plan": purpose})

    def _settings(self, cause: BaseException) -> dict[str, Any]:
        """Whether the station has kept its settings since the last nest check; nothing where it does not say.

        It is not asked where its silence was the cause: that would be waited for once more.
        """
        silent = isinstance(cause, NoAnswer) and cause.device == self.rig.station.name
        if silent or not self.store.has_readings(self.campaign):
            return {}
        check = int(self.store.recording(self.campaign)["nest_check"].max())
        try:
            self.rig.station.require_settings()
        except SettingsChanged:
            return {SETTINGS: {"check": check, "held": False}}
        except (DeviceError, RuntimeError):
            return {}
        return {SETTINGS: {"check": check, "held": True}}

    def _end_plan(self) -> None:
        """An interrupt reaches this thread while the engine's loop continues: end its plan before anything else."""
        if self._engine.state != "idle":
            with (
                contextlib.suppress(Exception),
                open(os.devnull, "w") as quiet,
                contextlib.redirect_stdout(quiet),  # it prints that it aborts
            ):
                self._engine.abort("the campaign ended")

    def _store_reading(self, _name: str, document: dict[str, Any]) -> None:
        """Store a reading; the engine continues only when it is on disk."""
        data = {**document["data"], "uid": document["uid"]}
        try:
            self.store.add_reading(self.campaign, document["uid"], int(data["sequence"]), data)
            self.rig.observer.reading(data, self.devices.station.last_deviation_m)
        except StoreError as error:
            self._failure = error
            raise

    def _first_cause(self, error: BaseException) -> BaseException:
        """The device's or the store's own error behind what the engine raised; supervision's trip comes first."""
        if self.rig.supervisor.trip is not None:
            return self.rig.supervisor.trip
        if isinstance(error, _Interrupted):
            return KeyboardInterrupt()
        if self._failure is not None:
            return self._failure
        cause: BaseException | None = error
        deepest = error
        while cause is not None:
            if isinstance(cause, EXPECTED_ERRORS):
                return cause
            inner: Any = cause.args[0] if cause.args else None
            status_error = inner.exception() if hasattr(inner, "exception") else None
            deepest = status_error or deepest
            cause = cause.__cause__ or status_error or cause.__context__
        return deepest


def _last_setup(recording: Recording) -> int:
    return int(recording["station"].max())


@contextmanager
def open_runner(
    rig: Rig,
    store: Store,
    campaign: str,
    progress: Callable[[int, str], None],
    command: str = "measure",
    notify: Callable[[str], None] = lambda _line: None,
    order: Sequence[Block] = (),
) -> Iterator[Runner]:
    """A runner that is closed in the end: one session of the campaign. order: of a program by which a control moves."""
    with session(rig, store, campaign, command, notify):
        runner = Runner(rig, store, campaign, progress, notify, order)
        rig.observer.campaign(campaign)
        try:
            yield runner
        finally:
            runner.close()


def emergency_log(rig: Rig) -> list[dict[str, Any]]:
    """What the drives have reported by EMCY since they were connected, oldest first."""
    return [
        {"drive": drive.name, "code": e.code, "register": e.register, "t_rig_s": e.t_rig_s, "t_host_s": e.t_host_s}
        for drive in rig.drives.drives
        for e in tuple(drive.emergencies)
    ]


def settings_event(rig: Rig) -> dict[str, Any]:
    """The rig file as it was used, seeds included, and who answered on each line: for traceability."""
    station = rig.station.identity
    control = {"moved_by_control": True} if rig.moved_by_control else {}
    return control | {
        "rig_file": rig.file.model_dump(mode="json", exclude={"mock"}),
        "rig_path": _path_word(rig.path),
        "station": None if station is None else {"name": station.name, "serial": station.serial},
        "drives": {d.name: None if d.identity is None else d.identity.serial for d in rig.drives.drives},
    }


def _path_word(path: Path | None) -> str | None:
    """What names a rig file after --rig, from any folder."""
    return None if path is None else EMBEDDED if path == embedded_rig_path() else str(path.resolve())


def new_campaign_id(rig_name: str) -> str:
    """Rig, time and four random characters."""
    return f"{rig_name}-{datetime.now(UTC):%Y%m%d-%H%M%S}-{secrets.token_hex(2)}"


def describe_campaign(rig: Rig, campaign: str, created: str, known_tables: Sequence[KnownTable] = ()) -> RecordingFile:
    """The recording's header for a campaign on this rig, with the compensation tables that are kept for it."""
    file = rig.file
    return RecordingFile(
        format=1,
        campaign=campaign,
        rig=file.rig,
        created=created,
        software=f"pkm-rig {__version__}",
        drives=tuple(d.name for d in file.drives),
        rotary_drives=rig.machine.rotary_drives,
        sensors=rig.sensors,
        extra_columns=rig.extra_columns,
        station=StationEntry(
            name=file.station.name,
            position_m=file.station.position_m,
            heading_rad=file.station.heading_rad,
            accuracy=file.station.accuracy,
        ),
        nest_length=file.nest_length,
        nest_limit_m=file.campaign.nest_limit_m,
        payloads=file.payloads,
        nuisance=file.nuisance,
        drive_positions="commanded" if rig.moved_by_control else "read",
        simulated=bool(rig.simulated_devices),
        known_tables=tuple(known_tables),
    )
