"""Corrections that campaigns of this store have verified: the former one, and one that is to act again."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from calibration.base.errors import InputError
from calibration.compensation.host import HostCorrection, correction_by, host_correction
from calibration.compensation.measured_range import MeasuredRange
from calibration.compensation.samples import SAME, CorrectionSamples
from calibration.identification.calibration import identify_recording
from calibration.model.operating_conditions import OperatingConditions
from calibration.recording.recording import Recording
from pkm_rig.errors import CampaignRefused
from pkm_rig.jobs.life_record import key_of
from pkm_rig.jobs.partial_fit import fit_partly
from pkm_rig.jobs.reference import load_reference
from pkm_rig.rig.rig import Rig
from pkm_rig.store.life import ACCEPTED, IDENTIFIED, life_rows
from pkm_rig.store.store import Store

ACTIVATED = "activated"  # the event of a correction that was tried, at one payload
SAMPLES = "samples"
MEASURED = "measured"  # of a partial calibration: loads, temperatures and poses for which its correction holds
PRIOR, READINGS, GROWTH = "prior", "readings", "growth"  # of a partial one: what its fit can be made again from


def former_correction(rig: Rig, store: Store, campaign: str, payload: int) -> tuple[CorrectionSamples, str] | None:
    """The correction that was accepted last for a payload of this machine, by another campaign, and which; or None."""
    rows = life_rows(store, "calibrations", rig.file.rig)
    key, mass_kg = key_of(rig), rig.file.payloads[payload].mass_kg
    for row in reversed(rows):
        if row.kind != ACCEPTED or row.machine != key or row.campaign in (None, campaign):
            continue
        for event in reversed(store.events(str(row.campaign), ACTIVATED)):
            if SAMPLES in event.data and event.data.get("payload_kg") == mass_kg:
                return CorrectionSamples.of_json(event.data[SAMPLES]), f"campaign {row.campaign}"
    return None


def activated_events(store: Store, campaign: str) -> dict[int, dict[str, Any]]:
    """What was tried last by a campaign, by payload."""
    return {int(event.data["payload"]): event.data for event in store.events(campaign, ACTIVATED)}


def verified_correction(store: Store, campaign: str, payload: int) -> HostCorrection:
    """The host's correction of an accepted campaign for a payload, identified anew from its readings.

    It must be what was verified, to 2 nm. Raises InputError for a payload that was not verified, CampaignRefused for
    another correction.
    """
    found = activated_events(store, campaign).get(payload)
    if found is None:
        raise InputError(f"campaign {campaign}: it was not verified with payload {payload}; put on one that was")
    if SAMPLES not in found:
        raise InputError(f"campaign {campaign}: verified by an older version, which kept no samples; verify anew")
    recording = store.recording(campaign)
    partly = partial_data(store, recording.file.rig, campaign)
    if partly is None:
        calibration = identify_recording(recording, baselines=False)
        correction = host_correction(calibration, payload, dict(found["temperatures_c"]))
    else:
        correction = _brought_up_to_date(store, recording, partly, payload, found)
    apart = CorrectionSamples.of_json(found[SAMPLES]).largest_difference(correction.corrections)
    if not apart <= SAME:
        raise CampaignRefused(
            f"campaign {campaign}: its correction now comes out {apart * 1e9:.0f} nm (or nrad) from the one that was "
            "verified; see `pkm-rig audit`, or calibrate anew"
        )
    return correction


def partial_data(store: Store, rig: str, campaign: str) -> dict[str, Any] | None:
    """What a campaign that brought a former calibration up to date has kept; None for a full one."""
    rows = [row for row in life_rows(store, "calibrations", rig) if (row.campaign, row.kind) == (campaign, IDENTIFIED)]
    return dict(rows[-1].data) if rows and rows[-1].data.get("extent", "full") != "full" else None


def _brought_up_to_date(
    store: Store, recording: Recording, partly: Mapping[str, Any], payload: int, found: Mapping[str, Any]
) -> HostCorrection:
    """The correction of a partial calibration, fitted anew from its readings and the calibration before."""
    file, machine = recording.file, recording.machine
    prior = load_reference(store, file.rig, str(partly[PRIOR]), machine, file.payloads)
    fit = fit_partly(prior, recording.take(slice(int(partly[READINGS]))), np.array(partly[GROWTH], dtype=np.float64))
    entry = file.payloads[payload]
    conditions = OperatingConditions(entry.mass_kg, entry.com_m, dict(found["temperatures_c"]))
    measured = MeasuredRange.of_json(machine, found[MEASURED])
    return correction_by(fit, prior.report_frame(fit.frame), conditions, measured)
