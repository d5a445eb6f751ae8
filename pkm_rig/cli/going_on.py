"""How a command that was ended goes on: what its last line says."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from calibration.base.errors import InputError
from drivers.errors import DeviceError
from pkm_rig.errors import CAMPAIGN_NOTE, CampaignRefused, CorrectionGrows, StationMoved, StoreError, campaign_of

GO_ON = "go on with: "
ANEW = "nothing of it can be tied to a new set-up, measure anew with: "


@contextmanager
def resumable(
    command: str, rig: Path | None, out: Path, *options: str, campaign: str | None = None, new_setup: bool = False
) -> Iterator[None]:
    """An error that ends a campaign gets the command, as it is typed, that goes on with it.

    `campaign`: the one that the command was to go on with, which it has not begun where the devices do not answer;
    `new_setup`: whether it was to do so in a new set-up of the station.
    """
    before = _setups_begun(out, campaign) if new_setup else 0
    try:
        yield
    except BaseException as error:
        if isinstance(error, DeviceError | StoreError | CampaignRefused) or not isinstance(error, Exception):
            if campaign_of(error) is None and campaign is not None:
                error.add_note(CAMPAIGN_NOTE + campaign)
            ended = campaign_of(error)
            if isinstance(error, CorrectionGrows):
                raise
            is_moved = isinstance(error, StationMoved)
            if ended is not None and is_moved and not _can_be_tied(out, ended):
                error.add_note(ANEW + _line(command, rig, out, options))
            elif ended is not None:
                asks_again = new_setup and _setups_begun(out, campaign) == before
                error.add_note(GO_ON + _line(command, rig, out, options, ended, new_setup=is_moved or asks_again))
        raise


def _line(
    command: str,
    rig: Path | None,
    out: Path,
    options: tuple[str, ...],
    campaign: str | None = None,
    *,
    new_setup: bool = False,
) -> str:
    from pkm_rig.jobs.next_command import rig_word

    words = ["pkm-rig", command]
    words += [campaign] if command == "verify" and campaign else []
    words += [] if rig is None else ["--rig", rig_word(rig)]
    words += [*options, "--out", str(out)]
    words += [] if command == "verify" or campaign is None else ["--resume", campaign]
    words += ["--new-setup"] if new_setup else []
    return shlex.join(words)


def _setups_begun(out: Path, campaign: str | None) -> int:
    """How many set-ups of the station a campaign has begun beside its first, as far as the store can be read."""
    from pkm_rig.rig.runner import NEW_SETUP
    from pkm_rig.store.store import open_existing_store

    try:
        with open_existing_store(out) as store:
            return 0 if campaign is None else len(store.events(campaign, NEW_SETUP))
    except (InputError, StoreError):
        return 0


def _can_be_tied(out: Path, campaign: str) -> bool:
    """Whether a new set-up would have points in common with what is there: three nests, or poses that can be used."""
    import numpy as np

    from calibration.reduction.nest_checks import usable_readings
    from calibration.reduction.reduction import CALIBRATION
    from pkm_rig.store.store import open_existing_store

    try:
        with open_existing_store(out) as store:
            recording = store.recording(campaign)
    except (InputError, StoreError):
        return True  # as it mostly is
    nests = sum(smr.on == "floor" for smr in recording.machine.smrs)
    usable = usable_readings(recording) & (np.asarray(recording["phase"]) == CALIBRATION)
    return nests >= 3 or bool(usable.any())
