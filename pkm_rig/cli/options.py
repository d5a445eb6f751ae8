"""Options and arguments that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

RigOption = Annotated[Path | None, typer.Option("--rig", help="rig file; without it the embedded mock rig")]
RigNeeded = Annotated[Path, typer.Option("--rig", help="rig file")]
OutOption = Annotated[Path, typer.Option("--out", help="folder of the store and of reports")]
JsonOption = Annotated[bool, typer.Option("--json", help="print one JSON object")]
CampaignArgument = Annotated[str, typer.Argument(help="campaign id in the store, or a recording folder")]
StoredCampaignArgument = Annotated[str, typer.Argument(help="campaign id in the store")]
