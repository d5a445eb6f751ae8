"""Commands that keep and check the record: audit, backup, archive, delete."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.text import Text

from calibration.base.errors import InputError
from pkm_rig.cli.options import JsonOption, OutOption, StoredCampaignArgument, campaigns
from pkm_rig.errors import CampaignRefused

WhyOption = Annotated[str, typer.Option(help="why, for the record")]


def audit(
    campaign: Annotated[
        str | None, typer.Argument(help="campaign id in the store; without it all", autocompletion=campaigns)
    ] = None,
    head: Annotated[str | None, typer.Option(help="head from a report or an export that must be in the chain")] = None,
    out: OutOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Whether every stored value is as it was written, and no row is missing, added or moved."""
    from pkm_rig.report.record_text import audit_line, head_line, removed_line
    from pkm_rig.report.terminal import print_result
    from pkm_rig.store.audit import audit, find_head
    from pkm_rig.store.store import open_existing_store

    if head is not None and not re.fullmatch("[0-9a-fA-F]{64}", head):
        raise InputError("audit: a head has 64 hexadecimal digits; copy the whole of it")
    with open_existing_store(out) as store:
        removed = [gone for gone in store.removed() if campaign in (None, gone.campaign)]
        audits = [] if removed and campaign is not None else audit(store, campaign)
    found = None if head is None else find_head(head.lower(), audits, removed)
    result = {
        "campaigns": [found_one.as_dict() for found_one in audits],
        "removed": [gone._asdict() for gone in removed],
        "head": None if found is None else found._asdict(),
    }
    lines = [*map(audit_line, audits), *map(removed_line, removed), *([] if found is None else [head_line(found)])]
    print_result(json, result, *map(Text, lines))
    broken = [one.problem for one in audits if one.state == "broken"]
    if broken:
        raise CampaignRefused(broken[0])
    if head is not None and found is None:
        raise CampaignRefused(f"audit: the head {head} is not in the record; rows after it or all rows were replaced")


def backup(
    file: Annotated[Path, typer.Argument(help="new file")],
    out: OutOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Copy the store to a file, also while a campaign runs, and audit the copy."""
    from pkm_rig.report.terminal import print_result
    from pkm_rig.store.audit import audit
    from pkm_rig.store.copies import back_up
    from pkm_rig.store.place import ServerAddress, store_place
    from pkm_rig.store.store import open_existing_store

    place = store_place(out)
    if isinstance(place, ServerAddress):
        raise InputError(
            f"backup: the store is on a server; use PostgreSQL's own program: pg_dump --dbname={place} --file={file}"
        )
    with open_existing_store(out):  # says what is wrong with it
        back_up(place, file)
    with open_existing_store(file) as store:
        audits = audit(store)
    broken = [one.problem for one in audits if one.state == "broken"]
    result = {"file": str(file), "campaigns": len(audits), "broken": broken}
    print_result(json, result, Text(f"{file}: {len(audits)} {'campaign' if len(audits) == 1 else 'campaigns'}"))
    if broken:
        raise CampaignRefused(f"the copy is as the store, and that is damaged: {broken[0]}")


def archive(
    campaign: StoredCampaignArgument,
    file: Annotated[Path, typer.Argument(help="new store file")],
    why: WhyOption,
    out: OutOption = Path("runs"),
    json: JsonOption = False,
) -> None:
    """Move a campaign into a store file of its own; its head, and who moved it, when and why, stay here."""
    from pkm_rig.report.record_text import removed_line
    from pkm_rig.report.terminal import print_result
    from pkm_rig.store.removal import archive_campaign
    from pkm_rig.store.store import hold_existing_store

    with hold_existing_store(out, campaign=campaign) as store:
        removed = archive_campaign(store, campaign, file, why)
    print_result(json, removed._asdict(), Text(removed_line(removed)))


def delete(
    campaign: StoredCampaignArgument,
    why: WhyOption,
    out: OutOption = Path("runs"),
    json: JsonOption = False,
    yes: Annotated[bool, typer.Option("--yes", help="do not ask")] = False,
) -> None:
    """Delete a campaign; its head, and who deleted it, when and why, stay. Reports are left where they are."""
    from pkm_rig.report.record_text import removed_line
    from pkm_rig.report.terminal import print_result
    from pkm_rig.store.removal import delete_campaign
    from pkm_rig.store.store import hold_existing_store

    with hold_existing_store(out, campaign=campaign) as store:
        if not yes:
            store.head(campaign)  # says if there is no such campaign
            if not sys.stdin.isatty():
                raise InputError("delete: nobody can be asked here; give --yes")
            if not typer.confirm(f"delete campaign {campaign} for good?", err=True):
                raise InputError("delete: not confirmed; nothing was deleted")
        removed = delete_campaign(store, campaign, why)
    print_result(json, removed._asdict(), Text(removed_line(removed)))
