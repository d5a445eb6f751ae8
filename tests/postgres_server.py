"""A PostgreSQL server of our own for tests: in a temporary folder, on a unix socket only, run as an ordinary user."""

from __future__ import annotations

import os
import pwd
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from itertools import count
from pathlib import Path

import pytest

from pkm_rig.store.place import ServerAddress
from pkm_rig.store.store import Store

PROGRAMS = "/usr/lib/postgresql"  # where Debian has them, not on the path
ORDINARY = ("postgres", "nobody")  # whom root asks: the server refuses to run as root
SETTINGS = {
    "listen_addresses": "",
    "fsync": "off",  # these stores are thrown away
    "full_page_writes": "off",
    "shared_buffers": "16MB",
    "max_wal_size": "64MB",
    "autovacuum": "off",
    "max_connections": "60",
}
LIMIT_S = 120  # of every wait: no test run hangs on a server
_numbers = count(1)


@cache
def program(name: str) -> str | None:
    """The path of one of the server's programs, the newest that there is; None without."""
    versions = sorted(Path(PROGRAMS).glob(f"*/bin/{name}"), key=lambda path: float(path.parts[-3]))
    return str(versions[-1]) if versions else shutil.which(name)


def why_none() -> str | None:
    """Why no server can be started here; None if one can."""
    missing = [name for name in ("initdb", "pg_ctl", "postgres") if program(name) is None]
    if missing:
        return f"PostgreSQL's {missing[0]} is not installed"
    if os.getuid() == 0 and _ordinary() is None:
        return "PostgreSQL does not run as root, and there is no ordinary user to run it as"
    try:
        import psycopg  # noqa: F401, PLC0415
    except ImportError:
        return "psycopg is not installed"
    return None


def _ordinary() -> pwd.struct_passwd | None:
    for name in ORDINARY:
        with suppress(KeyError):
            return pwd.getpwnam(name)
    return None


class PostgresServer:
    """A running server; `user` is its superuser, whom it trusts."""

    user = "rigs"

    def __init__(self, folder: Path) -> None:
        self.folder, self.data = folder, folder / "data"
        self._pattern: str | None = None
        user = _ordinary() if os.getuid() == 0 else None
        self._as: dict[str, object] = {}
        if user is not None:
            os.chown(folder, user.pw_uid, user.pw_gid)
            self._as = {"user": user.pw_uid, "group": user.pw_gid, "extra_groups": ()}
        self.run(
            "initdb", "-D", self.data, "-U", self.user, "--auth=trust", "--encoding=UTF8", "--locale=C", "--no-sync"
        )
        self.start()

    def start(self) -> None:
        """Have it run, and answer."""
        options = " ".join(f"-c {key}={value or chr(39) * 2}" for key, value in SETTINGS.items())
        options += f" -c unix_socket_directories={self.folder}"
        self.run("pg_ctl", "-D", self.data, "-w", "-t", "60", "-l", self.folder / "log", "-o", options, "start")

    def stop(self) -> None:
        """End it, and whoever is connected."""
        self.run("pg_ctl", "-D", self.data, "-m", "immediate", "stop")

    def run(self, name: str, *words: object) -> None:
        """Run one of the server's programs as its user."""
        command = [str(program(name)), *map(str, words)]
        with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as said:  # at a pipe that a server that
            done = subprocess.run(  # it has started holds open, one would wait beyond the limit
                command,
                cwd=self.folder,
                stdin=subprocess.DEVNULL,
                stdout=said,
                stderr=subprocess.STDOUT,
                timeout=LIMIT_S,
                check=False,
                **self._as,
            )
            said.seek(0)
            assert done.returncode == 0, said.read()

    def address(self, database: str = "postgres", user: str | None = None) -> str:
        """Of a database of it."""
        return f"postgresql://{user or self.user}@/{database}?host={self.folder}"

    def query(self, statement: str, database: str = "postgres") -> list[tuple]:
        """What a statement gives, asked of the server directly."""
        import psycopg  # noqa: PLC0415

        limit = f"-c statement_timeout={LIMIT_S}s"
        address = self.address(database)
        with psycopg.connect(address, autocommit=True, connect_timeout=LIMIT_S, options=limit) as connection:
            cursor = connection.execute(statement)
            return cursor.fetchall() if cursor.description else []

    def new_database(self, options: str = "") -> str:
        """The name of a database that is new and empty."""
        name = f"store_{next(_numbers)}"
        self.query(f"CREATE DATABASE {name} {options}")
        return name

    def new_store(self) -> str:
        """The name of a database that has a new store."""
        if self._pattern is None:
            self._pattern = self.new_database()
            Store(ServerAddress(self.address(self._pattern))).close()
        return self.new_database(f"TEMPLATE {self._pattern}")


@contextmanager
def running_server() -> Iterator[PostgresServer]:
    """A server of its own, gone with its files afterwards; the test is skipped where there can be none."""
    why = why_none()
    if why is not None:
        pytest.skip(why)
    folder = Path(tempfile.mkdtemp(prefix="pkm-pg-"))  # a short path: a socket's has 107 characters at most
    try:
        server = PostgresServer(folder)
        try:
            yield server
        finally:
            with suppress(AssertionError, subprocess.TimeoutExpired):  # a test may have stopped it
                server.stop()
    finally:
        shutil.rmtree(folder, ignore_errors=True)
