"""The store of version 0.1."""

import sqlalchemy as sa
from alembic import op

from pkm_rig.store.migrations.triggers import refuse

revision = "0001"
down_revision = None


def upgrade() -> None:
    """Make the tables of campaigns, readings and events."""
    op.create_table(
        "campaigns",
        sa.Column("id", sa.String, primary_key=True),
        sa.Column("created", sa.String, nullable=False),
        sa.Column("description", sa.Text, nullable=False),
        sa.Column("machine", sa.Text, nullable=False),
    )
    op.create_table(
        "readings",
        sa.Column("campaign", sa.String, sa.ForeignKey("campaigns.id"), primary_key=True),
        sa.Column("uid", sa.String, primary_key=True),
        sa.Column("sequence", sa.Integer, nullable=False),
        sa.Column("data", sa.Text, nullable=False),
    )
    op.create_table(
        "events",
        sa.Column("id", sa.Integer, primary_key=True),
        sa.Column("campaign", sa.String, sa.ForeignKey("campaigns.id"), nullable=False, index=True),
        sa.Column("created", sa.String, nullable=False),
        sa.Column("kind", sa.String, nullable=False),
        sa.Column("data", sa.Text, nullable=False),
    )
    for table in ("campaigns", "readings", "events"):
        for verb in ("UPDATE", "DELETE"):
            refuse(verb, table)
