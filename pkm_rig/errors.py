"""Errors of the application beside those of inputs (`calibration.base.errors`) and devices (`drivers.errors`)."""

from __future__ import annotations


class CampaignRefused(Exception):
    """The rig works but must not be calibrated now, or its result is refused; one line with what to do."""


class StationMoved(CampaignRefused):
    """The station does not stand any more where it stood: the campaign goes on in a new set-up."""


class CorrectionGrows(CampaignRefused):
    """A control's correction makes the errors larger: nothing is gone on with before it is mended."""


class NotChecked(Exception):
    """The machine could not be checked now, so nothing is known of it; one line with the reason."""


class StoreError(RuntimeError):
    """The store could not be written or read; one line."""


class WorkersGone(RuntimeError):
    """Nobody is there, or left, to compute for us; one line."""


CAMPAIGN_NOTE = "campaign "  # begins the note of an error that ended a campaign's session


def campaign_of(error: BaseException) -> str | None:
    """The campaign whose session an error ended; None if it ended none."""
    notes = [note for note in getattr(error, "__notes__", ()) if note.startswith(CAMPAIGN_NOTE)]
    return notes[-1].removeprefix(CAMPAIGN_NOTE) if notes else None
