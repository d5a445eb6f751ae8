"""Options and arguments that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def rig_path(name: str) -> Path:
    """The path of a rig file, or of the one that `embedded` names."""
    from pkm_rig.rig import config

    return config.rig_path(name)


RigOption = Annotated[
    Path, typer.Option("--rig", parser=rig_path, metavar="RIG.toml", help="rig file; `embedded`: the one of the demo")
]
OutOption = Annotated[Path, typer.Option("--out", help="folder of the store and of reports")]
JsonOption = Annotated[bool, typer.Option("--json", help="print one JSON object")]
CampaignArgument = Annotated[str, typer.Argument(help="campaign id in the store, or a recording folder")]
StoredCampaignArgument = Annotated[str, typer.Argument(help="campaign id in the store")]
SequenceOption = Annotated[
    bool,
    typer.Option(
        "--sessions-from-sequence",
        help="a folder whose rig time falls: another session began there; no effect of time is used across it",
    ),
]
