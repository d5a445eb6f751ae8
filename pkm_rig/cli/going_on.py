"""How a command that was ended goes on: what its last line says."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from drivers.errors import DeviceError
from pkm_rig.errors import CampaignRefused, StoreError, campaign_of

GO_ON = "go on with: "


@contextmanager
def resumable(command: str, rig: Path | None, out: Path, *options: str) -> Iterator[None]:
    """An error that ends a campaign gets the command, as it is typed, that goes on with it."""
    try:
        yield
    except BaseException as error:
        campaign = campaign_of(error)
        if campaign is not None and (
            isinstance(error, DeviceError | StoreError | CampaignRefused) or not isinstance(error, Exception)
        ):
            from pkm_rig.jobs.next_command import rig_word

            words = ["pkm-rig", command]
            words += [campaign] if command == "verify" else []
            words += [] if rig is None else ["--rig", rig_word(rig)]
            words += [*options, "--out", str(out)]
            words += [] if command == "verify" else ["--resume", campaign]
            error.add_note(GO_ON + shlex.join(words))
        raise
