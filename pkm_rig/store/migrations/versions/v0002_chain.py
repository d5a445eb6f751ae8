"""Rows of a campaign are numbered and chained; changes of tables and removed campaigns have tables of their own.

Which reading of version 0.1 came before which event is not known: its readings are numbered first, then its events.
"""

import sqlalchemy as sa
from alembic import op

from pkm_rig.store.migrations.triggers import allow, on_server, refuse

revision = "0002"
down_revision = "0001"

KEPT = {"campaigns": "id", "readings": "campaign", "events": "campaign"}  # and the column with the campaign


def upgrade() -> None:
    """Copy readings and events into tables with a position and a chain value; older campaigns have no chain values."""
    for table in KEPT:
        for verb in ("update", "delete"):
            allow(verb, table)
    op.drop_index("ix_events_campaign", "events")
    op.add_column("campaigns", sa.Column("chain", sa.String))
    if on_server():  # there has never been a store of version 0.1 on one
        op.drop_table("readings")
        op.drop_table("events")
        _make_tables()
    else:
        _copy_into_new_tables()
    _make_triggers()


def _copy_into_new_tables() -> None:
    op.rename_table("readings", "former_readings")
    op.rename_table("events", "former_events")
    _make_tables()
    op.execute(
        "INSERT INTO readings (campaign, position, uid, sequence, data) "
        "SELECT campaign, ROW_NUMBER() OVER (PARTITION BY campaign ORDER BY rowid), uid, sequence, data "
        "FROM former_readings ORDER BY rowid"
    )
    op.execute(
        "INSERT INTO events (campaign, position, created, kind, data) "
        "SELECT campaign, ROW_NUMBER() OVER (PARTITION BY campaign ORDER BY id) "
        "+ (SELECT COUNT(*) FROM readings WHERE readings.campaign = former_events.campaign), created, kind, data "
        "FROM former_events ORDER BY id"
    )
    op.execute(
        "INSERT INTO heads (campaign, position) SELECT id, "
        "(SELECT COUNT(*) FROM readings WHERE campaign = id) + (SELECT COUNT(*) FROM events WHERE campaign = id) "
        "FROM campaigns"
    )
    op.drop_table("former_readings")
    op.drop_table("former_events")


def _make_tables() -> None:
    op.create_table(
        "readings",
        sa.Column("campaign", sa.String, sa.ForeignKey("campaigns.id"), primary_key=True),
        sa.Column("position", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column("uid", sa.String, nullable=False),
        sa.Column("sequence", sa.Integer, nullable=False),
        sa.Column("data", sa.Text, nullable=False),
        sa.Column("chain", sa.String),
        sa.UniqueConstraint("campaign", "uid"),
    )
    op.create_table(
        "events",
        sa.Column("campaign", sa.String, sa.ForeignKey("campaigns.id"), primary_key=True),
        sa.Column("position", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column("created", sa.String, nullable=False),
        sa.Column("kind", sa.String, nullable=False),
        sa.Column("data", sa.Text, nullable=False),
        sa.Column("chain", sa.String),
    )
    op.create_table(
        "heads",
        sa.Column("campaign", sa.String, sa.ForeignKey("campaigns.id"), primary_key=True),
        sa.Column("position", sa.Integer, nullable=False),
        sa.Column("chain", sa.String),
    )
    op.create_table(
        "table_changes",
        sa.Column("id", sa.Integer, primary_key=True),
        sa.Column("created", sa.String, nullable=False),
        sa.Column("rig", sa.String, nullable=False),
        sa.Column("machine", sa.String, nullable=False),
        sa.Column("campaign", sa.String),
        sa.Column("change", sa.String, nullable=False),
        sa.Column("kind", sa.String, nullable=False),
        sa.Column("data", sa.Text, nullable=False),
    )
    op.create_table(
        "removed_campaigns",
        sa.Column("campaign", sa.String, primary_key=True),
        sa.Column("created", sa.String, nullable=False),
        sa.Column("readings", sa.Integer, nullable=False),
        sa.Column("rows", sa.Integer, nullable=False),
        sa.Column("head", sa.String),
        sa.Column("removed", sa.String, nullable=False),
        sa.Column("who", sa.String, nullable=False),
        sa.Column("why", sa.String, nullable=False),
        sa.Column("archive", sa.String),
    )


def _make_triggers() -> None:
    """Nothing is changed; nothing is deleted but rows of a campaign whose removal is on record."""
    for table in (*KEPT, "table_changes", "removed_campaigns"):
        refuse("DELETE", table, unless_removed=KEPT.get(table))
        refuse("UPDATE", table)
