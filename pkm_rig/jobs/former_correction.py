"""Corrections that campaigns of this store have verified: the former one, and one that is to act again."""

from __future__ import annotations

from typing import Any

from calibration.base.errors import InputError
from calibration.compensation.host import HostCorrection, host_correction
from calibration.compensation.samples import SAME, CorrectionSamples
from calibration.identification.calibration import identify_recording
from pkm_rig.errors import CampaignRefused
from pkm_rig.jobs.life_record import key_of
from pkm_rig.rig.rig import Rig
from pkm_rig.store.life import ACCEPTED, life_rows
from pkm_rig.store.store import Store

ACTIVATED = "activated"  # the event of a correction that was tried, at one payload
SAMPLES = "samples"


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
    calibration = identify_recording(store.recording(campaign), baselines=False)
    correction = host_correction(calibration, payload, dict(found["temperatures_c"]))
    apart = CorrectionSamples.of_json(found[SAMPLES]).largest_difference(correction.corrections)
    if not apart <= SAME:
        raise CampaignRefused(
            f"campaign {campaign}: its correction now comes out {apart * 1e9:.0f} nm (or nrad) from the one that was "
            "verified; see `pkm-rig audit`, or calibrate anew"
        )
    return correction
