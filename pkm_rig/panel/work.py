"""The one job that a panel has under way, in a thread of its own: no page is part of it, and none that is lost ends it.

What a page may do without control is to look on, and to stop.
"""

from __future__ import annotations

import sys
import threading
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calibration.base.errors import InputError, printable
from calibration.machine.description import Machine
from drivers.errors import DeviceError, Stopped
from pkm_rig.errors import CampaignRefused, StationMoved, StoreError, campaign_of
from pkm_rig.jobs.running_follower import Follower
from pkm_rig.panel.actions import NEED_RELEASE, WITH_SECOND_PRESS, Action, what_moves
from pkm_rig.panel.control import Control, Prepared, Presses
from pkm_rig.panel.tasks import Connect, Result, Workplace, run
from pkm_rig.rig.capabilities import can_verify
from pkm_rig.rig.config import RigFile, load_rig
from pkm_rig.rig.live import Live, Snapshot
from pkm_rig.rig.rig import Rig

STOPPED = "stopped from the page"
SAME_S = 0.1  # by which looks of several pages are one
MOST_DIAGNOSED = 20
NO_RELEASE = (
    "the rig file names no register `local_release` of the PLC, the key switch without which a page moves nothing; "
    "use the command line"
)


class PageOperator:
    """The pages as the operator of a campaign: whoever of them has control pauses and lets go on."""

    hint = "press Go on"

    def __init__(self) -> None:
        self._pause = threading.Event()
        self._go_on = threading.Event()
        self.waits = False

    def ask_for_pause(self) -> None:
        """Pause after the reading in hand."""
        self._pause.set()

    def let_go_on(self) -> None:
        """Acknowledge; counts only while it waits."""
        if self.waits:
            self._go_on.set()

    def asks_to_pause(self) -> bool:
        """Whether a pause was asked for and has not begun."""
        return self._pause.is_set()

    def begin_wait(self) -> None:
        """What was pressed before counts no more."""
        self._go_on.clear()
        self._pause.clear()
        self.waits = True

    def acknowledges(self) -> bool:
        """Whether it was let go on; each press counts once."""
        pressed = self._go_on.is_set()
        self._go_on.clear()
        return pressed

    def end_wait(self) -> None:
        """The campaign goes on."""
        self.waits = False


@dataclass(frozen=True)
class Job:
    """A job under way, or the one that has ended last with its result."""

    action: Action
    begun_s: float
    result: Result | None = None
    stopping: bool = False


class Work:
    """Starts, pauses and stops jobs for pages; every method may be called from any thread."""

    def __init__(
        self,
        rig_path: Path,
        out: Path,
        connect: Connect,
        *,
        host_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """Raises InputError if the rig file is not valid."""
        self.file, self.machine = load_rig(rig_path)
        self.can_verify = can_verify(self.file, self.machine, rig_path)
        self.out = out
        self.live, self.control, self.operator = Live(), Control(), PageOperator()
        self.presses: Presses[Action] = Presses(self.control, host_s)
        self._host_s = host_s
        self._place = Workplace(rig_path, out, connect, self.live, self.operator, self._hold)
        self._lock = threading.Lock()
        self._rig: Rig | None = None
        self._thread: threading.Thread | None = None
        self._stop_order: str | None = None
        self.job: Job | None = None
        self.checked: dict[str, Any] | None = None
        self.diagnosed: dict[str, dict[str, Any]] = {}
        self.follower = Follower(out, host_s)
        self._seen: tuple[float, Snapshot] | None = None
        self.version = 0

    @property
    def rig_file(self) -> tuple[RigFile, Machine]:
        """The rig as its file describes it."""
        return self.file, self.machine

    @property
    def has_release_register(self) -> bool:
        """Whether the rig file names the PLC's register of the local release."""
        return "local_release" in self.file.plc.registers

    @property
    def is_simulated(self) -> bool:
        """Whether the rig is known to be a simulated one: embedded, or by the last check or campaign."""
        return self.file.can.interface == "embedded" or bool(self.checked and self.checked["simulated"])

    @property
    def is_busy(self) -> bool:
        """Whether a job is under way."""
        return self.job is not None and self.job.result is None

    def press(self, page: str, action: Action) -> Prepared[Action] | None:
        """A first press: the job is begun, or, if it moves or writes anything, what it will do is to be pressed again.

        Raises InputError: NotInControl, a rig that cannot do it, a PLC without the register of the local release.
        """
        self.control.require(page)
        if action.kind in NEED_RELEASE:
            self._require_release_register()
        if action.kind == "go on":
            if not self.operator.waits:
                raise InputError("nothing waits to go on")
        else:
            self._require_idle()
        if action.kind in WITH_SECOND_PRESS:
            return self.presses.first(page, action, what_moves(action, self.file, self.machine))
        self._begin(action)
        return None

    def press_again(self, page: str, secret: str) -> None:
        """The second press: begin what was prepared. Raises InputError."""
        action = self.presses.second(page, secret)
        if action.kind == "go on":
            self.operator.let_go_on()
        else:
            self._begin(action)

    def pause(self, page: str) -> None:
        """Pause the campaign after the reading in hand. Raises InputError."""
        self.control.require(page)
        if not self.is_busy:
            raise InputError("nothing is under way")
        self.operator.ask_for_pause()
        self.live.notify("pausing after this reading")

    def stop(self, why: str = STOPPED) -> None:
        """Stop whatever is under way, from any page: all drives at once, and the campaign for good."""
        with self._lock:
            if not self.is_busy or self.job is None:
                return
            self._stop_order = why
            self.job = Job(self.job.action, self.job.begun_s, stopping=True)
            self.version += 1
            rig = self._rig
        if rig is not None:
            rig.order_stop(why)

    def snapshot(self) -> Snapshot:
        """What there is to see, taken once for all pages that look at about the same time."""
        seen, now_s = self._seen, self._host_s()
        if seen is None or not 0.0 <= now_s - seen[0] < SAME_S:
            self._seen = seen = (now_s, self.live.snapshot())
            if self.is_busy and self.job is not None and self.job.action.kind in ("calibrate", "measure"):
                self.follower.look(seen[1].campaign, seen[1].done)
        return seen[1]

    def close(self) -> None:
        """Stop what is under way and wait for its end."""
        self.stop("the panel was ended at its computer")
        self.wait()
        self.follower.close()

    def wait(self, limit_s: float | None = None) -> bool:
        """Wait for the job's end; whether it has ended."""
        thread = self._thread
        if thread is not None:
            thread.join(limit_s)
        return not self.is_busy

    def _require_release_register(self) -> None:
        if not self.has_release_register:
            raise InputError(NO_RELEASE)

    def _require_idle(self) -> None:
        if self.is_busy and self.job is not None:
            raise InputError(f"{self.job.action.kind} is under way; wait for its end, or stop it")

    def _begin(self, action: Action) -> None:
        with self._lock:
            self._require_idle()
            self._stop_order = None
            self.operator.end_wait()
            self.job = Job(action, self._host_s())
            self.version += 1
            self.live.begin()
            self._thread = threading.Thread(target=self._work, args=(action,), name="panel-job")
            self._thread.start()

    def _hold(self, rig: Rig | None) -> None:
        """The rig is connected, or is being left; a stop that was ordered meanwhile reaches it."""
        with self._lock:
            self._rig = rig
            order = self._stop_order
        if rig is not None and order is not None:
            rig.order_stop(order)
            raise Stopped("drives", rig.file.rig, order, "begin again when the machine may move")

    def _work(self, action: Action) -> None:
        try:
            result = run(action, self._place)
        except (InputError, CampaignRefused, DeviceError, StoreError, OSError) as error:
            result = Result(False, _line(error), campaign_of(error) or action.campaign, goes_on=_goes_on(action, error))
        except BaseException as error:
            print(traceback.format_exc(), file=sys.stderr)
            line = f"internal error: {type(error).__name__}: {error}; please report it"
            result = Result(False, line, campaign_of(error))
        self.operator.end_wait()
        with self._lock:
            if self.job is not None:
                self.job = Job(self.job.action, self.job.begun_s, result, self.job.stopping)
            if result.found is not None and action.kind == "check":
                self.checked = result.found
            if result.found is not None and action.kind == "diagnose" and result.campaign is not None:
                self.diagnosed = dict([*self.diagnosed.items(), (result.campaign, result.found)][-MOST_DIAGNOSED:])
            self.version += 1
        self.live.notify(result.line)


def _goes_on(action: Action, error: BaseException) -> Action | None:
    """What goes on with the campaign whose session an error has ended; None if it has ended none."""
    campaign = campaign_of(error)
    if campaign is None or action.kind not in ("calibrate", "measure", "verify"):
        return None
    return Action(action.kind, campaign, action.visits, new_setup=isinstance(error, StationMoved))


def _line(error: BaseException) -> str:
    notes = [note for note in getattr(error, "__notes__", ()) if not note.startswith("campaign ")]
    return printable("; ".join([str(error), *notes]))
