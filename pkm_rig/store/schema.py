"""The tables as the newest migration leaves them (a test compares the two).

Readings and events of a campaign are numbered in one order of insertion, from 1. `heads` has the last number and the
last chain value of each campaign; it alone is updated. The five tables of a machine's life (`life`) outlast campaigns.
"""

from __future__ import annotations

import sqlalchemy as sa

REVISION = "0003"

metadata = sa.MetaData()

campaigns = sa.Table(
    "campaigns",
    metadata,
    sa.Column("id", sa.String, primary_key=True),
    sa.Column("created", sa.String, nullable=False),
    sa.Column("description", sa.Text, nullable=False),
    sa.Column("machine", sa.Text, nullable=False),
    sa.Column("chain", sa.String),
)
readings = sa.Table(
    "readings",
    metadata,
    sa.Column("campaign", sa.ForeignKey("campaigns.id"), primary_key=True),
    sa.Column("position", sa.Integer, primary_key=True, autoincrement=False),
    sa.Column("uid", sa.String, nullable=False),
    sa.Column("sequence", sa.Integer, nullable=False),
    sa.Column("data", sa.Text, nullable=False),
    sa.Column("chain", sa.String),
    sa.UniqueConstraint("campaign", "uid"),
)
events = sa.Table(
    "events",
    metadata,
    sa.Column("campaign", sa.ForeignKey("campaigns.id"), primary_key=True),
    sa.Column("position", sa.Integer, primary_key=True, autoincrement=False),
    sa.Column("created", sa.String, nullable=False),
    sa.Column("kind", sa.String, nullable=False),
    sa.Column("data", sa.Text, nullable=False),
    sa.Column("chain", sa.String),
)
heads = sa.Table(
    "heads",
    metadata,
    sa.Column("campaign", sa.ForeignKey("campaigns.id"), primary_key=True),
    sa.Column("position", sa.Integer, nullable=False),
    sa.Column("chain", sa.String),
)
table_changes = sa.Table(
    "table_changes",
    metadata,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("created", sa.String, nullable=False),
    sa.Column("rig", sa.String, nullable=False),
    sa.Column("machine", sa.String, nullable=False),
    sa.Column("campaign", sa.String),
    sa.Column("change", sa.String, nullable=False),
    sa.Column("kind", sa.String, nullable=False),
    sa.Column("data", sa.Text, nullable=False),
)
removed_campaigns = sa.Table(
    "removed_campaigns",
    metadata,
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


def _of_life(name: str, *columns: sa.Column[str]) -> sa.Table:
    """A table of a machine's life: what is looked for in columns of its own, all else in `data`."""
    return sa.Table(
        name,
        metadata,
        sa.Column("id", sa.Integer, primary_key=True),
        sa.Column("created", sa.String, nullable=False),
        sa.Column("rig", sa.String, nullable=False, index=True),
        sa.Column("machine", sa.String, nullable=False),
        *columns,
        sa.Column("kind", sa.String, nullable=False),
        sa.Column("data", sa.Text, nullable=False),
    )


machines = _of_life("machines")
instruments = _of_life("instruments", sa.Column("serial", sa.String, nullable=False))
calibrations = _of_life("calibrations", sa.Column("campaign", sa.String, nullable=False))
checks = _of_life("checks", sa.Column("campaign", sa.String))
machine_events = _of_life("machine_events", sa.Column("campaign", sa.String))
