"""Locks of rigs on a PostgreSQL server: advisory locks of a connection, which the server frees however that ends.

The table `rig_locks` says who holds a rig; a row of it counts only while the connection that wrote it has the lock. It
is no part of the record: only servers have it.
"""

from __future__ import annotations

import hashlib
import json
import socket
from contextlib import suppress
from typing import Any

import sqlalchemy as sa
from sqlalchemy.dialects.postgresql import insert
from sqlalchemy.exc import DBAPIError, SQLAlchemyError

from pkm_rig.errors import StoreError
from pkm_rig.store.lock import describe_owner, this_process

EVERY_RIG = ""  # the name under which somebody holds the whole store
FREED_WITHIN_S = 2  # of an owner's end: until then the server may not have seen that a killed one's connection is gone
LOCK_NOT_AVAILABLE = "55P03"  # SQLSTATE

_metadata = sa.MetaData()
rig_locks = sa.Table(
    "rig_locks",
    _metadata,
    sa.Column("rig", sa.Text, primary_key=True),
    sa.Column("number", sa.BigInteger, nullable=False),
    sa.Column("backend", sa.Integer, nullable=False),  # of the connection that has the lock
    sa.Column("owner", sa.Text, nullable=False),  # JSON
)
_HELD = sa.text(  # an advisory lock of one 64-bit number is listed as its two halves
    "SELECT r.rig, r.owner FROM rig_locks r JOIN pg_locks l ON l.locktype = 'advisory' AND l.granted "
    "AND l.objsubid = 1 AND l.mode = 'ExclusiveLock' AND l.pid = r.backend "
    "AND l.database = (SELECT oid FROM pg_database WHERE datname = current_database()) "
    "AND ((l.classid::bigint << 32) | l.objid::bigint) = r.number"
)


def make_table(connection: sa.Connection) -> None:
    """Make the table, in a new store."""
    rig_locks.create(connection, checkfirst=True)


def lock_number(connection: sa.Connection, kind: str, name: str) -> int:
    """The 64-bit number of a lock; databases have their own each, schemas of one database get theirs here."""
    schema = connection.execute(sa.select(sa.func.current_schema())).scalar()
    digest = hashlib.sha256(json.dumps(["pkm-rig", schema, kind, name]).encode()).digest()
    return int.from_bytes(digest[:8], "big", signed=True)


class RigHold:
    """A rig, or the whole store, that one connection has, until it is released or ends."""

    def __init__(self, engine: sa.Engine, where: str, rig: str | None) -> None:
        """Take it. StoreError, naming who has it, if another connection does.

        Each rig shares the store's own lock, which is taken whole without a rig's name.
        """
        self._where = f"{where}: rig {rig}" if rig else where
        self._rig = rig or EVERY_RIG
        self._mine = this_process() | {"host": socket.gethostname()}
        self._connection = engine.connect()
        try:
            self._take(rig)
        except BaseException:
            self.release()
            raise

    @property
    def connection(self) -> sa.Connection:
        """The connection that has the lock; StoreError if it has ended, and the lock with it."""
        if self._connection.invalidated or self._connection.closed:
            raise StoreError(
                f"{self._where}: the connection to the server was lost, and with it the lock of the rig; what was "
                "stored before is kept"
            )
        return self._connection

    def say_campaign(self, campaign: str | None) -> None:
        """Have others see which campaign is worked on; None: on none."""
        with suppress(SQLAlchemyError, StoreError), self.connection.begin():  # it only informs
            own = rig_locks.update().where(rig_locks.c.rig == self._rig)
            self.connection.execute(own.values(owner=json.dumps(self._mine | {"campaign": campaign})))

    def release(self) -> None:
        """Let others have it; again does nothing. The connection is not used again: its end frees the lock."""
        with suppress(SQLAlchemyError):
            self._connection.invalidate()
        self._connection.close()

    def _take(self, rig: str | None) -> None:
        connection = self._connection
        with connection.begin():
            connection.execute(sa.text(f"SET LOCAL lock_timeout = '{FREED_WITHIN_S}s'"))
            whole = lock_number(connection, "store", "")
            number = whole if rig is None else lock_number(connection, "rig", rig)
            if rig is None:
                got = _got(connection, "pg_advisory_lock", whole)
            else:
                got = _got(connection, "pg_advisory_lock_shared", whole)
                got = got and _got(connection, "pg_advisory_lock", number)
            if not got:
                raise StoreError(
                    f"{self._where} is in use by {self._owner(connection)}; wait until it has ended, or end it"
                )
            backend = connection.execute(sa.select(sa.func.pg_backend_pid())).scalar()
            values = {"number": number, "backend": backend, "owner": json.dumps(self._mine | {"campaign": None})}
            row = insert(rig_locks).values(rig=self._rig, **values)
            connection.execute(row.on_conflict_do_update(index_elements=["rig"], set_=values))

    def _owner(self, connection: sa.Connection) -> str:
        """Who keeps us out: the one who has the rig or the whole store, for the whole store anyone who has a rig."""
        held = {row.rig: row.owner for row in connection.execute(_HELD)}
        found = [held[name] for name in (self._rig, EVERY_RIG) if name in held]
        if not found and self._rig == EVERY_RIG:
            found = [held[name] for name in sorted(held)]
        return describe_owner(_content(found[0]) if found else {})


def campaigns_held(connection: sa.Connection) -> set[str]:
    """The campaigns that holders say they work on."""
    if not sa.inspect(connection).has_table(rig_locks.name):
        return set()
    campaigns = (_content(row.owner).get("campaign") for row in connection.execute(_HELD))
    return {campaign for campaign in campaigns if isinstance(campaign, str)}


def _got(connection: sa.Connection, function: str, number: int) -> bool:
    """Whether a lock could be had within the time that the transaction has set."""
    try:
        with connection.begin_nested():  # a time-out ends what it happens in
            connection.execute(sa.select(getattr(sa.func, function)(number)))
    except DBAPIError as error:
        if getattr(error.orig, "sqlstate", None) != LOCK_NOT_AVAILABLE:
            raise
        return False
    return True


def _content(text: str) -> dict[str, Any]:
    try:
        content = json.loads(text)
    except ValueError:
        return {}
    return content if isinstance(content, dict) else {}
