"""What a report is made from: a function of what is stored of a campaign, whatever it came to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

from pydantic import ValidationError

from calibration.base.errors import InputError
from calibration.identification.calibration import identify_recording
from calibration.reduction.reduction import reduce
from pkm_rig.jobs.acceptance import last_verification_attempt, stored_limits_m, stored_outcome
from pkm_rig.jobs.diagnose import try_diagnosis
from pkm_rig.jobs.standard_figures import standard_result
from pkm_rig.report.html import report_path, write_report
from pkm_rig.report.words import Language
from pkm_rig.results.outcome import CampaignOutcome
from pkm_rig.results.report_source import DriveTables, ReportSource
from pkm_rig.rig.certificate_section import CertificateSection
from pkm_rig.rig.config import RigFile
from pkm_rig.rig.recalibration_sections import CertificateEntry
from pkm_rig.rig.table_change import BEGUN, ENDS, GIVEN_UP, KEPT, TRIAL
from pkm_rig.store.campaign_state import campaign_state
from pkm_rig.store.store import Store, open_existing_store
from pkm_rig.store.stored_machine import stored_machine
from pkm_rig.store.stored_rows import StoredEvent, StoredTableChange

NO_TABLE = "no table in use"


def report_source(
    store: Store,
    campaign: str,
    outcome: CampaignOutcome | None = None,
    rig_file: RigFile | None = None,
) -> ReportSource:
    """All of a campaign that a report shows. `outcome`: the verification's, where it is known already.

    `rig_file`: its sections on certificates in place of those that the campaign was measured with. InputError for an
    unknown campaign, StoreError for a damaged one; what cannot be computed is said in the source.
    """
    header, events = store.header(campaign), store.events(campaign)
    settings: Mapping[str, Any] = next((e.data for e in events if e.kind == "settings"), {})
    state, step = campaign_state(events, is_worked_on=campaign in store.worked_on())
    known: dict[str, Any] = {
        "campaign": campaign,
        "header": header,
        "machine": stored_machine(store, campaign),
        "head": store.head(campaign),
        "state": state,
        "step": step,
        "why": _why(events) if state in ("refused", "interrupted", "failed") else "",
        "answered": {key: settings[key] for key in ("station", "drives")} if "drives" in settings else None,
        **_certificate_sections(settings, rig_file),
        "tables": _drive_tables([c for c in store.table_changes() if c.campaign == campaign]),
        "limits_m": stored_limits_m(store, campaign),
    }
    if (
        outcome is None
        and {e.kind for e in events} & {"accepted", "refused"}
        and any(e.kind == "activated" for e in events)
    ):
        outcome = stored_outcome(store, campaign)
    if outcome is not None:
        return ReportSource(
            **known | {"header": outcome.reduction.recording.file},
            recording=outcome.reduction.recording,
            reduction=outcome.reduction,
            calibration=outcome.calibration,
            diagnosis=outcome.diagnosis,
            outcome=outcome,
        )
    if not store.has_readings(campaign):
        return ReportSource(**known, not_reduced="nothing was measured", not_identified="nothing was measured")
    return ReportSource(**known | _measured(store, campaign, settings))


def write_outcome_report(outcome: CampaignOutcome, out: Path) -> None:
    """Write the report of a campaign that has just been verified. Raises OSError."""
    with open_existing_store(out) as store:
        source = report_source(store, outcome.campaign, outcome)
    write_report(source, report_path(outcome.campaign, out))


def parse_language(name: str) -> Language:
    """A language of reports and certificates; InputError if there is none such."""
    if name not in get_args(Language):
        raise InputError(f"--language {name}: not known; use {' or '.join(get_args(Language))}")
    return name  # type: ignore[return-value]


def _measured(store: Store, campaign: str, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Recording, reduction, calibration and figures of standards of a campaign without a verdict, as far as they go."""
    recording = last_verification_attempt(store, campaign)
    found: dict[str, Any] = {"recording": recording, "header": recording.file}
    try:
        found["reduction"] = reduce(recording)
    except InputError as error:
        return found | {"not_reduced": str(error), "not_identified": str(error)}
    made_for = settings.get("rig_file", {}).get("campaign", {}).get("made_for")
    if made_for is not None:
        try:
            found["standard"] = standard_result(found["reduction"], made_for)
        except InputError as error:
            found["standard_failure"] = str(error)
        return found | {"not_identified": f"its visits were made for the formulae of {made_for}"}
    try:
        found["calibration"] = identify_recording(recording)
    except InputError as error:
        return found | {"not_identified": str(error)}
    found["reduction"] = reduce(recording, found["calibration"].reduction)
    return found | {"diagnosis": try_diagnosis(recording)}


def _certificate_sections(settings: Mapping[str, Any], rig_file: RigFile | None) -> dict[str, Any]:
    """The sections of the rig file that the campaign was measured with, or of another; earlier versions had none."""
    if rig_file is not None:
        return {"certificate": rig_file.certificate, "certificates": rig_file.certificates}
    stored = settings.get("rig_file", {})
    section = stored.get("certificate")
    try:
        return {
            "certificate": None if section is None else CertificateSection.model_validate(section),
            "certificates": tuple(CertificateEntry.model_validate(e) for e in stored.get("certificates", ())),
        }
    except ValidationError as error:
        raise InputError(f"stored sections on certificates are not valid: {error.errors()[0]['msg']}") from error


def _why(events: Sequence[StoredEvent]) -> str:
    """Why the last plan failed, or the last session ended early."""
    for event in reversed(events):
        if event.kind == "failed":
            return str(event.data.get("reason", ""))
        if event.kind == "session_ended" and event.data.get("why") not in (None, "finished"):
            return str(event.data["why"])
    return ""


def _drive_tables(steps: Sequence[StoredTableChange]) -> DriveTables | None:
    """What the drives used before the campaign's first change and after its last one."""
    begun = [step for step in steps if step.kind == BEGUN]
    if not begun:
        return None
    as_found = _in_words({r["drive"]: _record_in_words(r) for r in begun[0].data["former"]})
    last = [step for step in steps if step.change == begun[-1].change]
    end = last[-1].kind if last[-1].kind in ENDS else None
    if end == KEPT:
        tried = [step for step in last if step.kind == TRIAL][-1].data["tables"]
        return DriveTables(as_found, _in_words({d: f"generation {g}, CRC {c:08X}" for d, (g, c) in tried.items()}))
    if end is None or end == GIVEN_UP:
        return DriveTables(as_found, "not known: the change of tables was not ended; `pkm-rig tables show` tells")
    if begun[-1].data["target"] is not None:
        return DriveTables(as_found, "as the command asked for")
    return DriveTables(as_found, _in_words({r["drive"]: _record_in_words(r) for r in begun[-1].data["former"]}))


def _record_in_words(record: Mapping[str, Any]) -> str:
    if record["mode"] != "kept" or record["image"] is None:
        return NO_TABLE
    return f"generation {record['generation']}, CRC {record['crc']:08X}"


def _in_words(by_drive: Mapping[str, str]) -> str:
    if set(by_drive.values()) <= {NO_TABLE}:  # also of a correction by the host, which tries no table
        return f"{NO_TABLE} on any drive"
    if len(set(by_drive.values())) == 1:
        return f"{next(iter(by_drive.values()))} on all drives"
    return "; ".join(f"{drive}: {words}" for drive, words in by_drive.items())
