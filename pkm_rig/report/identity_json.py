"""Who, what and with which instruments, for reports, certificates and programs."""

from __future__ import annotations

from datetime import UTC, date, datetime
from typing import Any

from pkm_rig.results.report_source import ReportSource
from pkm_rig.rig.certificate_section import CertificateSection
from pkm_rig.rig.recalibration_sections import CertificateEntry

NEEDED = ("station", "nest_length")  # the second where the rig has a certified length


def identity_json(source: ReportSource) -> dict[str, Any]:
    """Machine, devices as they answered, parties, procedure, instruments with their certificates, traceability."""
    section = source.certificate or CertificateSection()
    answered = source.answered or {}
    station = answered.get("station")
    measured_on = measuring_days(source)
    instruments = [_instrument_json(entry, station, measured_on) for entry in source.certificates]
    reasons = not_traceable(source, instruments)
    return {
        "report_number": source.campaign,
        "machine": {"name": source.machine.name, **section.machine.model_dump(mode="json")},
        "rig": source.header.rig,
        "station": {"name": source.header.station.name, "answered": station},
        "drives": [{"name": name, "serial": serial} for name, serial in answered.get("drives", {}).items()],
        "laboratory": None if section.laboratory is None else section.laboratory.model_dump(mode="json"),
        "customer": None if section.customer is None else section.customer.model_dump(mode="json"),
        "operator": section.operator,
        "procedure": section.procedure,
        "location": section.location,
        "accreditation": section.accreditation,
        "instruments": instruments,
        "measured": None if measured_on is None else [day.isoformat() for day in measured_on],
        "software": source.header.software,
        "traceable": not reasons,
        "not_traceable": reasons,
    }


def measuring_days(source: ReportSource) -> tuple[date, date] | None:
    """First and last day of measuring, UTC; of the campaign's begin where its sessions do not say."""
    moments = [s.begin_utc_s for s in source.header.sessions] + [s.end_utc_s for s in source.header.sessions]
    known = [datetime.fromtimestamp(moment, UTC).date() for moment in moments if moment is not None]
    if not known:
        try:
            known = [datetime.fromisoformat(source.header.created).astimezone(UTC).date()]
        except ValueError:
            return None
    return min(known), max(known)


def not_traceable(source: ReportSource, instruments: list[dict[str, Any]]) -> list[str]:
    """Why the result is not traceable, a sentence each; empty if it is."""
    reasons = ["simulated: nothing was measured"] if source.header.simulated else []
    for needed in NEEDED[:1] if source.header.nest_length is None else NEEDED:
        if not any(entry["instrument"] == needed for entry in instruments):
            reasons.append(f"no certificate of the {needed.replace('nest_length', 'certified length')} is stated")
    reasons += [f"{entry['instrument']}: {entry['why']}" for entry in instruments if entry["state"] != "valid"]
    return reasons


def _instrument_json(
    entry: CertificateEntry, station: dict[str, Any] | None, measured_on: tuple[date, date] | None
) -> dict[str, Any]:
    state, why = _certificate_state(entry, station, measured_on)
    return {**entry.model_dump(mode="json"), "state": state, "why": why}


def _certificate_state(
    entry: CertificateEntry, station: dict[str, Any] | None, measured_on: tuple[date, date] | None
) -> tuple[str, str]:
    """valid, lapsed or unknown, and why, at the days of measuring."""
    if entry.instrument == "station" and station is not None and entry.serial != str(station["serial"]):
        stated = "no serial number is stated" if entry.serial is None else f"stated is {entry.serial}"
        return "unknown", f"the station that measured has serial number {station['serial']}, {stated}"
    if measured_on is None:
        return "unknown", "the day of measuring is not known"
    if entry.due < measured_on[1]:
        return "lapsed", f"its certificate was due on {entry.due}, measured until {measured_on[1]}"
    if entry.calibrated is not None and entry.calibrated > measured_on[0]:
        return "unknown", f"it was calibrated on {entry.calibrated}, measured from {measured_on[0]}"
    return "valid", ""
