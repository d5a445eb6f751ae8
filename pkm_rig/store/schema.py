"""The tables as the newest migration leaves them (a test compares the two).

Readings and events of a campaign are numbered in one order of insertion, from 1. `heads` has the last number and the
last chain value of each campaign; it alone is updated.
"""

from __future__ import annotations

import sqlalchemy as sa

REVISION = "0002"

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
