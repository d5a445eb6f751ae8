"""A store on a PostgreSQL server: several rigs and computers at once, each rig held by a lock of its connection.

Who holds a rig writes through the very connection that has the lock: where that ends, nothing more is written.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import sqlalchemy as sa
from sqlalchemy import event

from calibration.base.errors import InputError
from pkm_rig.errors import StoreError
from pkm_rig.store.migrate import NEW, migrate, revision_of
from pkm_rig.store.place import ServerAddress
from pkm_rig.store.schema import REVISION
from pkm_rig.store.server_lock import RigHold, campaigns_held, lock_number, make_table

MISSING = "a store on a server needs psycopg; install it with: pip install 'pkm-rig[postgresql]'"
WAIT_S = 10  # for the server's answer to a connection, and for a row that somebody else writes
CLIENT = {  # of libpq: a network that is gone is noticed within a minute, not after hours
    "connect_timeout": WAIT_S,
    "keepalives_idle": 20,
    "keepalives_interval": 10,
    "keepalives_count": 3,
    "tcp_user_timeout": 40_000,
    "application_name": "pkm-rig",
}
SESSION = (  # of the server: the same from its side, so that a computer without power does not keep its lock
    "SET tcp_keepalives_idle = 20",
    "SET tcp_keepalives_interval = 10",
    "SET tcp_keepalives_count = 3",
    f"SET lock_timeout = '{WAIT_S}s'",
    "SET client_encoding = 'UTF8'",
    "SET TimeZone = 'UTC'",
)
NO_IDLE_LIMIT = "SET idle_session_timeout = 0"  # a campaign may wait for hours; known from version 14 on
LEAST_VERSION, IDLE_VERSION = 120_000, 140_000

_log = logging.getLogger(__name__)


class Server:
    """One database; `name` is how messages call it."""

    path = None

    def __init__(self, address: ServerAddress) -> None:
        self.address, self.name = address, str(address)
        self._engine: sa.Engine | None = None
        self._hold: RigHold | None = None
        self._mutex = threading.RLock()  # threads take turns at the connection that has the lock

    def open(self, *, read_only: bool) -> None:
        """Connect. To write, an empty database gets the tables, and an older schema is migrated.

        InputError where psycopg is missing, or the database is not one of ours; StoreError where an older schema is
        only to be read.
        """
        self._engine = _engine(self.address)
        with self._reading() as connection:
            revision = revision_of(connection, self.name)
        if revision == REVISION:
            return
        if read_only:
            if revision == NEW:
                raise InputError(f"store {self.name}: empty; nothing was stored in it")
            raise StoreError(
                f"store {self.name}: has schema {revision}, this version {REVISION}; back it up with pg_dump, then any "
                "command that writes brings it there, such as `pkm-rig measure`"
            )
        self._bring_up_to_date()

    def close(self) -> None:
        """Close all connections, and with them let others have the rig."""
        if self._hold is not None:
            self._hold.release()
        if self._engine is not None:
            self._engine.dispose()

    @contextmanager
    def writing(self) -> Iterator[sa.Connection]:
        """A transaction; rows of one campaign are added in turn (`append.head_of` keeps others out)."""
        if self._hold is None:
            with self._connected.begin() as connection:
                yield connection
            return
        with self._mutex:
            connection = self._hold.connection
            with connection.begin():
                yield connection

    @contextmanager
    def reading(self) -> Iterator[sa.Connection]:
        """A connection that sees the store at one moment and cannot change it."""
        with self._reading() as connection:
            yield connection

    def hold(self, rig: str | None) -> None:
        """Keep others from working on a rig, or, without a name, on any. StoreError, naming who has it."""
        if self._hold is None:
            self._hold = RigHold(self._connected, f"store {self.name}", rig)

    def say_campaign(self, campaign: str | None) -> None:
        """Have others see which campaign the holder works on."""
        with self._mutex:
            if self._hold is not None:
                self._hold.say_campaign(campaign)

    def worked_on(self) -> set[str]:
        """Campaigns that somebody works on now, on any computer."""
        with self._reading() as connection:
            return campaigns_held(connection)

    @property
    def _connected(self) -> sa.Engine:
        assert self._engine is not None
        return self._engine

    def _reading(self) -> sa.Connection:
        options = {"isolation_level": "REPEATABLE READ", "postgresql_readonly": True}
        return self._connected.connect().execution_options(**options)

    def _bring_up_to_date(self) -> None:
        """Make or migrate the tables in one transaction; of two processes the second finds it done."""
        with self._connected.begin() as connection:
            connection.execute(sa.select(sa.func.pg_advisory_xact_lock(lock_number(connection, "schema", ""))))
            revision = revision_of(connection, self.name)
            if revision == REVISION:
                return
            if revision == NEW:
                _require_database(connection, self.name)
                make_table(connection)
            else:
                _log.warning("store %s: brought from schema %s to %s", self.name, revision, REVISION)
            migrate(connection, revision)


def _engine(address: ServerAddress) -> sa.Engine:
    url = sa.make_url(address.url).set(drivername="postgresql+psycopg")
    settings = {key: value for key, value in CLIENT.items() if key not in url.query}
    try:
        engine = sa.create_engine(url, connect_args=settings)
    except ModuleNotFoundError as error:
        raise InputError(MISSING) from error
    event.listen(engine, "connect", _set_up)
    return engine


def _set_up(connection: Any, _record: object) -> None:
    """Of each new connection: every commit reaches the server's disk, a lost computer is noticed."""
    version = connection.info.server_version
    former, connection.autocommit = connection.autocommit, True
    for statement in (*SESSION, *([NO_IDLE_LIMIT] if version >= IDLE_VERSION else ())):
        connection.execute(statement)
    if connection.execute("SHOW synchronous_commit").fetchone()[0] in ("off", "local"):
        connection.execute("SET synchronous_commit = on")
    connection.autocommit = former


def _require_database(connection: sa.Connection, name: str) -> None:
    """Before tables are made: what could not hold them is said. Without fsync they are made, with a warning."""
    shown = {key: str(connection.exec_driver_sql(f"SHOW {key}").scalar()) for key in ("server_encoding", "fsync")}
    if shown["server_encoding"] != "UTF8":
        raise InputError(
            f"store {name}: the database's encoding is {shown['server_encoding']}; make one with "
            "`createdb --encoding=UTF8 --template=template0`"
        )
    version = int(str(connection.exec_driver_sql("SHOW server_version_num").scalar()))
    if version < LEAST_VERSION:
        raise InputError(f"store {name}: the server is older than PostgreSQL 12; use a newer one")
    if shown["fsync"] != "on":
        _log.warning("store %s: the server runs with fsync off: a power cut may lose readings", name)
