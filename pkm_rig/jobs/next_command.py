"""The command that goes on where one has ended, as it can be typed."""

from __future__ import annotations

import shlex
from pathlib import Path

from pkm_rig.rig.config import EMBEDDED, embedded_rig_path
from pkm_rig.store.store import Store


def command_line(*words: str | Path) -> str:
    """A command of pkm-rig with its words quoted for a shell."""
    return shlex.join(["pkm-rig", *map(str, words)])


def rig_word(path: Path) -> str:
    """What names a rig file after --rig."""
    return EMBEDDED if path == embedded_rig_path() else str(path)


def measure_more(store: Store, campaign: str, out: Path) -> str | None:
    """The command that measures a campaign file for a campaign, which the file is to be added to; None without its rig.

    A campaign that was identified or verified on the rig is complete: then it becomes one of its own.
    """
    settings = store.events(campaign, "settings")
    rig = settings[0].data.get("rig_path") if settings else None
    if rig is None:
        return None
    is_complete = store.events(campaign, "identified") or store.events(campaign, "verifying")
    resume = () if is_complete else ("--resume", campaign)
    return command_line("measure", "--rig", rig, "--out", out, *resume, "--campaign")
