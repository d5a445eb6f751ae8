"""Each action as its command does it: the same jobs, with the page's operator and the PLC's release in addition."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from calibration.base.errors import InputError
from pkm_rig.errors import StoreError
from pkm_rig.jobs import tables as table_jobs
from pkm_rig.jobs.calibrate import calibrate
from pkm_rig.jobs.check import check_devices
from pkm_rig.jobs.homing import home_drives
from pkm_rig.jobs.interim import run_interim_test
from pkm_rig.jobs.measure import measure
from pkm_rig.jobs.report import report_source, write_outcome_report
from pkm_rig.jobs.session import store_if_there
from pkm_rig.jobs.verify import verify
from pkm_rig.panel.actions import NEED_RELEASE, Action
from pkm_rig.report.diagnosis_text import diagnosis_line
from pkm_rig.report.html import report_path, write_report
from pkm_rig.results.diagnosis_attempt import DiagnosisAttempt
from pkm_rig.results.outcome import CampaignOutcome
from pkm_rig.rig.capabilities import Need
from pkm_rig.rig.config import rig_name, with_visits_of
from pkm_rig.rig.live import Live
from pkm_rig.rig.operator import Operator
from pkm_rig.rig.release import require_release
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.session_record import last_moment
from pkm_rig.rig.table_recovery import end_unfinished_change, settle_tables
from pkm_rig.store.sessions import Moment
from pkm_rig.store.store import open_existing_store, open_store


class Connect(Protocol):
    """`pkm_rig.jobs.session.open_rig`, or what stands in for it."""

    def __call__(
        self, path: Path, *, needs: Need = ..., homing: bool = ..., after: Moment | None = ...
    ) -> AbstractContextManager[Rig]:
        """The connected, supervised rig of a rig file."""
        ...


@dataclass(frozen=True)
class Result:
    """How a job ended: whether its result is good, a line for people, its campaign, what it found, how it goes on."""

    good: bool
    line: str
    campaign: str | None = None
    found: dict[str, Any] | None = None
    goes_on: Action | None = None


@dataclass(frozen=True)
class Workplace:
    """What jobs work with. `hold_of` tells whoever may stop the rig that it is connected, and no more with None."""

    rig_path: Path
    out: Path
    connect: Connect
    live: Live
    operator: Operator
    hold_of: Callable[[Rig | None], None]

    @property
    def rig_name(self) -> str:
        """The rig's name, by which it is held in the store."""
        return rig_name(self.rig_path)

    @contextmanager
    def rig(self, action: Action, needs: Need, *, homing: bool = False, after: Moment | None = None) -> Iterator[Rig]:
        """The connected rig, watched and operated by the page; refused without the PLC's release where it is needed."""
        with self.connect(self.rig_path, needs=needs, homing=homing, after=after) as rig:
            self.live.watch(rig)
            rig.operator = self.operator
            try:
                self.hold_of(rig)
                if action.kind in NEED_RELEASE:
                    require_release(rig)
                yield rig
            finally:
                self.hold_of(None)
                self.live.leave()


def run(action: Action, place: Workplace) -> Result:
    """Do what was asked for; raises what its command would."""
    return _TASKS[action.kind](action, place)


def _check(action: Action, place: Workplace) -> Result:
    with store_if_there(place.out) as store, place.rig(action, Need.MOTION) as rig:
        end_unfinished_change(rig, store, place.live.notify)
        found = check_devices(rig)
        if rig.banks:
            found["tables"] = table_jobs.show_tables(rig, store)["tables"]
        found["guards"] = place.live.snapshot().guards
    problems = found["problems"]
    return Result(not problems, problems[0] if problems else "fit for a campaign", found=found)


def _home(action: Action, place: Workplace) -> Result:
    again = action.kind == "home again"
    needs = Need.HOMING if again else Need.NOTHING
    with store_if_there(place.out) as store, place.rig(action, needs, homing=True) as rig:
        settle_tables(rig, store, place.live.notify)
        found = home_drives(rig, again=again, store=store)
    homed = [name for name, drive in found["drives"].items() if drive["homed"]]
    return Result(True, f"homed: {', '.join(homed) or 'none, all had their reference'}", found=found)


def _interim_test(action: Action, place: Workplace) -> Result:
    with store_if_there(place.out) as store, place.rig(action, Need.NOTHING) as rig:
        end_unfinished_change(rig, store, place.live.notify)
        result = run_interim_test(rig)
    return Result(result.passed, "interim test passed" if result.passed else f"interim test: {result.failures[0]}")


def _measure(action: Action, place: Workplace) -> Result:
    with (
        open_store(place.out, hold=True, rig=place.rig_name, campaign=action.campaign) as store,
        place.rig(action, Need.MOTION, after=_end_of(action, place)) as rig,
    ):
        if action.visits is not None:
            rig.file = with_visits_of(rig.file, action.visits.file, action.visits.name)
        live = place.live
        campaign = measure(rig, store, live.notify, live.progress, action.campaign, new_setup=action.new_setup)
    return Result(True, f"campaign {campaign} is measured", campaign)


def _calibrate(action: Action, place: Workplace) -> Result:
    live = place.live
    with (
        open_store(place.out, hold=True, rig=place.rig_name, campaign=action.campaign) as store,
        place.rig(action, Need.MOTION | Need.TABLES, after=_end_of(action, place)) as rig,
    ):
        outcome = calibrate(rig, store, live.notify, live.progress, action.campaign, new_setup=action.new_setup)
    return _judged(outcome, place)


def _verify(action: Action, place: Workplace) -> Result:
    live, campaign = place.live, str(action.campaign)
    with (
        open_store(place.out, hold=True, rig=place.rig_name, campaign=campaign) as store,
        place.rig(action, Need.MOTION | Need.TABLES, after=_end_of(action, place)) as rig,
    ):
        outcome = verify(rig, store, campaign, live.notify, live.progress, new_setup=action.new_setup)
    return _judged(outcome, place)


def _end_of(action: Action, place: Workplace) -> Moment | None:
    if action.campaign is None:
        return None
    with open_existing_store(place.out) as store:
        store.header(action.campaign)  # an unknown campaign is reported before any device is touched
        return last_moment(store, action.campaign)


def _judged(outcome: CampaignOutcome, place: Workplace) -> Result:
    try:
        write_outcome_report(outcome, place.out)
    except OSError as error:  # the result stands, whatever becomes of its report
        raise StoreError(f"report: {error}; the result is in the store, have it written again") from error
    rules = "; ".join(f"{v.payload_kg:g} kg: {v.decision.rule}" for v in outcome.verified)
    return Result(outcome.accepted, f"{outcome.decision}: {rules}", outcome.campaign)


def _tables(action: Action, place: Workplace) -> Result:
    with store_if_there(place.out) as store, place.rig(action, Need.TABLES, homing=True) as rig:
        end_unfinished_change(rig, store, place.live.notify)
        if action.kind == "tables off":
            table_jobs.change_to_off(rig, store)
        elif store is None:
            raise InputError("nothing is known of former tables: there is no store yet")
        else:
            table_jobs.roll_back(rig, store, table_jobs.last_change(rig, store))
        shown = table_jobs.show_tables(rig, store)
    return Result(True, f"tables: {shown['tables']}", found=shown)


def _diagnose(action: Action, place: Workplace) -> Result:
    from pkm_rig.jobs.diagnose import run_diagnosis  # noqa: PLC0415  # draws, which takes a second to import

    campaign = str(action.campaign)
    place.live.progress(0, 0, "diagnosing")
    diagnosis, found = run_diagnosis(find_stored(campaign, place.out), place.out)
    return Result(True, diagnosis_line(DiagnosisAttempt(diagnosis)), campaign, found)


def _report(action: Action, place: Workplace) -> Result:
    campaign = str(action.campaign)
    place.live.progress(0, 0, "writing the report")
    with open_existing_store(place.out) as store:
        source = report_source(store, campaign)
    write_report(source, report_path(campaign, place.out))
    return Result(True, f"the report of {campaign} is written", campaign)


def find_stored(campaign: str, out: Path) -> Any:
    """The recording of a campaign of the store; never a folder of that name."""
    with open_existing_store(out) as store:
        return store.recording(campaign)


_TASKS: dict[str, Callable[[Action, Workplace], Result]] = {
    "check": _check,
    "home": _home,
    "home again": _home,
    "interim test": _interim_test,
    "measure": _measure,
    "calibrate": _calibrate,
    "verify": _verify,
    "tables off": _tables,
    "tables rollback": _tables,
    "diagnose": _diagnose,
    "report": _report,
}
