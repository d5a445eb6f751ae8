"""Options and arguments that several commands share."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Annotated

import typer


def rig_path(name: str) -> Path:
    """The path of a rig file, or of the one that `embedded` names."""
    from pkm_rig.rig import config

    return config.rig_path(name)


def rig_name(path: Path) -> str:
    """The name of the rig of a rig file, by which it is held in the store."""
    from pkm_rig.rig import config

    return config.rig_name(path)


def campaigns(context: typer.Context, incomplete: str) -> list[str]:
    """Ids of the store's campaigns that begin so, for a shell that completes them; none where there is no store.

    Where there are none, as for all other options and arguments, shells complete files.
    """
    import sqlite3

    out = Path(context.params.get("out") or "runs")
    store = out if out.is_file() else out / "pkm-rig.sqlite"
    if (out / "store.toml").is_file():
        return [name for name in _on_the_server(out) if name.startswith(incomplete)]
    if not store.is_file():
        return []
    try:
        with closing(sqlite3.connect(f"{store.resolve().as_uri()}?mode=ro", uri=True)) as connection:
            rows = connection.execute("SELECT id FROM campaigns ORDER BY created DESC LIMIT 1000").fetchall()
    except sqlite3.Error:
        return []
    return [str(row[0]) for row in rows if str(row[0]).startswith(incomplete)]


def _on_the_server(out: Path) -> list[str]:
    from calibration.base.errors import InputError
    from pkm_rig.errors import StoreError
    from pkm_rig.store.store import open_existing_store

    try:
        with open_existing_store(out) as store:
            return store.newest(1000)
    except (InputError, StoreError):
        return []


RigOption = Annotated[
    Path, typer.Option("--rig", parser=rig_path, metavar="RIG.toml", help="rig file; `embedded`: the one of the demo")
]
OutOption = Annotated[Path, typer.Option("--out", help="folder of the store and of reports")]
JsonOption = Annotated[bool, typer.Option("--json", help="print one JSON object")]
CampaignArgument = Annotated[
    str, typer.Argument(help="campaign id in the store, or a recording folder", autocompletion=campaigns)
]
MaybeCampaignArgument = Annotated[
    str | None, typer.Argument(help="campaign id in the store, or a recording folder", autocompletion=campaigns)
]
StoredCampaignArgument = Annotated[str, typer.Argument(help="campaign id in the store", autocompletion=campaigns)]
SequenceOption = Annotated[
    bool,
    typer.Option(
        "--sessions-from-sequence",
        help="a folder whose rig time falls: another session began there; no effect of time is used across it",
    ),
]
