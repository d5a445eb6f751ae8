"""A machine's life over years: machines, instruments, calibrations, checks and events, which outlast campaigns.

What older campaigns say of it is read from their events (`pkm_rig.store.life`); nothing is copied here.
"""

import sqlalchemy as sa
from alembic import op

from pkm_rig.store.migrations.triggers import refuse

revision = "0003"
down_revision = "0002"

OWN_COLUMN = {  # of each table: its name and whether it may be null
    "machines": None,
    "instruments": ("serial", False),
    "calibrations": ("campaign", False),
    "checks": ("campaign", True),
    "machine_events": ("campaign", True),
}


def upgrade() -> None:
    """Make the five tables; nothing in them is ever changed or deleted."""
    for table, column in OWN_COLUMN.items():
        own = [] if column is None else [sa.Column(column[0], sa.String, nullable=column[1])]
        op.create_table(
            table,
            sa.Column("id", sa.Integer, primary_key=True),
            sa.Column("created", sa.String, nullable=False),
            sa.Column("rig", sa.String, nullable=False),
            sa.Column("machine", sa.String, nullable=False),
            *own,
            sa.Column("kind", sa.String, nullable=False),
            sa.Column("data", sa.Text, nullable=False),
        )
        op.create_index(f"ix_{table}_rig", table, ["rig"])
        for verb in ("UPDATE", "DELETE"):
            refuse(verb, table)
