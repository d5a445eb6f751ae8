"""Where the store of a folder is: a file in it, or a server that `store.toml` in it names.

An address never holds a password: rig files are copied, and kept with every campaign. PostgreSQL's own places serve for
that (PGPASSWORD, ~/.pgpass, a service file).
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, NamedTuple
from urllib.parse import parse_qsl, urlsplit

from pydantic import AfterValidator, Field

from calibration.base.errors import InputError
from calibration.base.toml_file import Section, read_toml

STORE_NAME, SERVER_FILE = "pkm-rig.sqlite", "store.toml"
SCHEME = "postgresql"
SECRETS = ("password", "sslpassword", "passwd")
AS_IN = "write postgresql://USER@HOST/DATABASE"


class ServerAddress(NamedTuple):
    """A database on a PostgreSQL server, as a URL without a password."""

    url: str

    def __str__(self) -> str:
        return self.url


def check_address(text: str) -> str:
    """An address as it was stated. ValueError, which shows nothing of it, if it is none or holds a password."""
    try:
        parts = urlsplit(text)
        words = parse_qsl(parts.query, keep_blank_values=True, strict_parsing=bool(parts.query))
        has_password = parts.password is not None
        _ = parts.port
    except ValueError:
        raise ValueError(f"no address of a store; {AS_IN}") from None
    if has_password or any(key.lower() in SECRETS for key, _ in words):
        raise ValueError(
            "a password in the address would be kept with every campaign; leave it out: PostgreSQL takes it from "
            "PGPASSWORD or ~/.pgpass"
        )
    if parts.scheme != SCHEME or parts.fragment or not text.isprintable() or " " in text:
        raise ValueError(f"no address of a store; {AS_IN}")
    if len(parts.path) < 2 and not any(key in ("dbname", "service") for key, _ in words):
        raise ValueError(f"the address names no database; {AS_IN}")
    return text


Address = Annotated[str, AfterValidator(check_address)]


class ServerFile(Section):
    """`store.toml`: the store of a folder is on a server."""

    store: Address = Field(description="Address of the database, without a password.")


def store_path(out: Path) -> Path:
    """The store's file in a folder; a file is a store itself: a backup or an archive."""
    return out if out.is_file() else out / STORE_NAME


def store_place(out: Path) -> Path | ServerAddress:
    """The store of a folder, whether it is there or not. InputError if its `store.toml` is not valid."""
    if (out / SERVER_FILE).is_file():
        if store_path(out).is_file():
            raise InputError(f"{out}: has {STORE_NAME} and {SERVER_FILE}, which names another store; move one away")
        return ServerAddress(read_toml(out / SERVER_FILE, ServerFile).store)
    return store_path(out)


def has_store(out: Path) -> bool:
    """Whether a folder has a store, be it on a server, which is not asked."""
    place = store_place(out)
    return isinstance(place, ServerAddress) or place.is_file()


def store_folder(out: Path) -> Path:
    """Where reports and pictures are written: beside a store that was given as a file."""
    return out.parent if out.is_file() else out


def campaign_folder(out: Path, campaign: str) -> Path:
    """Where files of a campaign are written: in the store's folder."""
    return store_folder(out) / campaign


def bind_folder(out: Path, address: str) -> None:
    """Have a folder's store be the one on a server, so that commands without a rig file find it.

    InputError if the folder has another one, or cannot be written.
    """
    if out.is_file() or store_path(out).is_file():
        raise InputError(
            f"{out}: has a store of its own, and the rig file says store = {address}; give another folder with --out"
        )
    file = out / SERVER_FILE
    if file.is_file():
        stated = read_toml(file, ServerFile).store
        if stated != address:
            raise InputError(f"{file}: names the store {stated}, the rig file {address}; give another --out")
        return
    part = file.with_name(f"{file.name}.{os.getpid()}.part")
    try:
        out.mkdir(parents=True, exist_ok=True)
        part.write_text(f'store = "{address}"\n', encoding="utf-8")
        part.replace(file)
    except OSError as error:
        raise InputError(f"{file}: {error.strerror}; choose a place that can be written") from error
