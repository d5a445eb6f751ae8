"""Campaigns leave the store by deletion or into an archive; their head stays, and who removed them, when and why."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import sqlalchemy as sa

from calibration.base.errors import InputError
from pkm_rig.errors import CampaignRefused
from pkm_rig.store.append import now_text
from pkm_rig.store.audit import audit
from pkm_rig.store.copies import new_store_file
from pkm_rig.store.lock import user_name
from pkm_rig.store.schema import campaigns, events, heads, readings, removed_campaigns
from pkm_rig.store.store import Store
from pkm_rig.store.stored_rows import RemovedCampaign

TABLES = (
    (campaigns, campaigns.c.id),
    (readings, readings.c.campaign),
    (events, events.c.campaign),
    (heads, heads.c.campaign),
)


def delete_campaign(store: Store, campaign: str, why: str) -> RemovedCampaign:
    """Delete a campaign; what stays of it. It may be damaged."""
    with store.writing() as connection:
        return _remove(connection, campaign, _reason(why), None)


def archive_campaign(store: Store, campaign: str, file: Path, why: str) -> RemovedCampaign:
    """Move a campaign into a new store file, audited before it leaves this one; what stays of it here.

    Raises CampaignRefused if the campaign is damaged, InputError if the file is there already.
    """
    why = _reason(why)
    with store.writing() as connection:
        connection.execute(sa.select(heads).where(heads.c.campaign == campaign).with_for_update())
        with new_store_file(file) as part, closing(Store(part)) as archive:
            with archive.writing() as target:
                for table, name in TABLES:
                    rows = connection.execute(sa.select(table).where(name == campaign)).mappings()
                    for some in rows.partitions(1000):
                        target.execute(table.insert(), [dict(row) for row in some])
            _refuse_broken(archive, campaign)
        return _remove(connection, campaign, why, file)


def _reason(why: str) -> str:
    if not why.strip():
        raise InputError("--why says nothing; state why the campaign is removed")
    return why.strip()


def _refuse_broken(archive: Store, campaign: str) -> None:
    (found,) = audit(archive, campaign)
    if found.state == "broken":
        raise CampaignRefused(f"{found.problem}; `pkm-rig backup` copies the store as it is")


def _remove(connection: sa.Connection, campaign: str, why: str, archive: Path | None) -> RemovedCampaign:
    created = connection.execute(sa.select(campaigns.c.created).where(campaigns.c.id == campaign)).scalar()
    if created is None:
        raise InputError(f"no campaign '{campaign}'; `pkm-rig list` shows what is there")
    head = connection.execute(sa.select(heads).where(heads.c.campaign == campaign).with_for_update()).first()
    count = sa.select(sa.func.count()).select_from(readings).where(readings.c.campaign == campaign)
    removed = RemovedCampaign(
        campaign=campaign,
        created=str(created).encode(errors="backslashreplace").decode(),
        readings=connection.execute(count).scalar_one(),
        rows=head.position if head else 0,
        head=head.chain if head else None,
        removed=now_text(),
        who=user_name(),
        why=why,
        archive=None if archive is None else str(archive.absolute()),
    )
    connection.execute(removed_campaigns.insert().values(**removed._asdict()))
    for table, name in reversed(TABLES):
        connection.execute(table.delete().where(name == campaign))
    return removed
