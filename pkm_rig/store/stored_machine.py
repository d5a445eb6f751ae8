"""The machine of a stored campaign, also of one without readings."""

from __future__ import annotations

import sqlalchemy as sa

from calibration.base.errors import InputError
from calibration.machine.description import Machine, parse_machine
from pkm_rig.store.schema import campaigns
from pkm_rig.store.store import Store
from pkm_rig.store.stored_rows import read_campaign


def stored_machine(store: Store, campaign: str) -> Machine:
    """The nominal machine that a campaign measures. InputError if the campaign is unknown, StoreError if damaged."""
    with store.reading() as connection:
        row = connection.execute(sa.select(campaigns).where(campaigns.c.id == campaign)).first()
    if row is None:
        raise InputError(f"store {store.name}: no campaign '{campaign}'; `pkm-rig list` shows what is there")
    return parse_machine(read_campaign(row, f"store {store.name}").machine, f"machine of campaign {campaign}")
