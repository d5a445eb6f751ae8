"""The application object that commands register with, and the options that several of them share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(
    help="Calibrates over-constrained parallel kinematic machines on the machine itself.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)

RigOption = Annotated[Path | None, typer.Option("--rig", help="rig file; without it the embedded mock rig")]
RigNeeded = Annotated[Path, typer.Option("--rig", help="rig file")]
OutOption = Annotated[Path, typer.Option("--out", help="folder of the store and of reports")]
JsonOption = Annotated[bool, typer.Option("--json", help="print one JSON object")]
CampaignArgument = Annotated[str, typer.Argument(help="campaign id in the store, or a recording folder")]
StoredCampaignArgument = Annotated[str, typer.Argument(help="campaign id in the store")]
