"""What a database complains of, and what its damage causes, in one line with what to do about it."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager

from sqlalchemy.exc import IntegrityError, SQLAlchemyError

from calibration.base.errors import InputError
from pkm_rig.errors import StoreError

_SERVER = "check that the server runs, its address, and PGPASSWORD or ~/.pgpass"
ADVICE = {  # by words of the complaint
    "full": "free space or choose another place",
    "No space left": "free space or choose another place",
    "connection to server": _SERVER,
    "connection timeout": _SERVER,
    "resolve host": _SERVER,
    "database is locked": "another process writes or reads it; wait until it has ended",
    "lock timeout": "another computer writes the same rows; wait, and try again",
}


@contextmanager
def one_line(store: str) -> Iterator[None]:
    """Errors of SQLite and PostgreSQL as InputError or StoreError that names the store."""
    try:
        yield
    except IntegrityError as error:
        raise InputError(f"store {store}: {_line(error)}; a reading's uid must be unique") from error
    except UnicodeError as error:
        raise InputError(f"store {store}: a name that is not Unicode; check it") from error
    except (SQLAlchemyError, sqlite3.Error) as error:
        cause = _line(error)
        if "not a database" in cause:
            raise InputError(f"store {store}: {cause}; choose another folder") from error
        advice = next((f"; {advice}" for word, advice in ADVICE.items() if word in cause), "")
        raise StoreError(f"store {store}: {cause}{advice}") from error


@contextmanager
def damage_of(store: str, campaign: str) -> Iterator[None]:
    """What the values of a campaign that is not chained may cause, as StoreError in one line."""
    try:
        yield
    except InputError:
        raise
    except (ValueError, TypeError, LookupError, OverflowError) as error:
        raise StoreError(
            f"store {store}: campaign '{campaign}' is damaged ({error}); restore the store from a backup"
        ) from error


def _line(error: Exception) -> str:
    return " ".join(str(getattr(error, "orig", None) or error).split())
