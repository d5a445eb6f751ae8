"""The record for people: what an audit found, what was removed."""

from __future__ import annotations

from pkm_rig.store.audit import Audit, FoundHead
from pkm_rig.store.stored_rows import RemovedCampaign


def audit_line(audit: Audit) -> str:
    """What was found of a campaign."""
    if audit.state == "broken":
        return f"{audit.campaign}  BROKEN  {audit.problem}"
    counts = f"{audit.rows} rows, {audit.readings} of them readings"
    head = f"head {audit.head}" if audit.head else "begun by version 0.1: its rows can be read"
    return f"{audit.campaign}  {audit.state}  {counts}  {head}"


def head_line(found: FoundHead) -> str:
    """Where the head that was asked for is in the record."""
    later = found.rows - found.row
    return f"the head is that of row {found.row} of {found.rows} of {found.campaign}: " + (
        f"nothing up to there has changed, {later} rows came later" if later else "nothing has changed"
    )


def removed_line(removed: RemovedCampaign) -> str:
    """What stays of a campaign that was removed."""
    how = f"archived to {removed.archive}" if removed.archive else "deleted"
    head = f"head {removed.head}" if removed.head else "not chained"
    return (
        f"{removed.campaign}  {how} on {removed.removed} by {removed.who}: {removed.why}  "
        f"{removed.readings} readings  {head}"
    )
