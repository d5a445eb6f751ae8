"""Locks between processes: `flock` on a file that stays, so the kernel frees it however its owner ends.

The file says who has it; what a former owner left in it counts only while the lock is held.
"""

from __future__ import annotations

import fcntl
import json
import os
import pwd
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pkm_rig.errors import StoreError

LOOKS, LOOK_S = 3, 0.01  # who only looks has the lock for microseconds
MOST_BYTES = 10_000  # of what an owner says


class Lock:
    """A lock that is held until it is released, or until the process ends."""

    def __init__(self, path: Path, what: str) -> None:
        """Take it. StoreError, naming its owner, if another process or another object of this one has it."""
        self._file = _open(path, what)
        try:
            _take(self._file)
        except BlockingIOError:
            owner = _owner(self._file)
            os.close(self._file)
            raise StoreError(f"{what} is in use by {owner}; wait until it has ended, or end it") from None
        except OSError as error:
            os.close(self._file)
            raise StoreError(f"{what}: {path} cannot be locked: {error.strerror}; choose another place") from error
        os.ftruncate(self._file, 0)
        self._mine = this_process()
        self.say_campaign(None)

    def say_campaign(self, campaign: str | None) -> None:
        """Have the file say which campaign the owner works on; None: on none. Whoever reads meanwhile sees either."""
        text = json.dumps(self._mine | {"campaign": campaign}).encode()
        with suppress(OSError):  # it only informs
            os.pwrite(self._file, text.ljust(os.fstat(self._file).st_size), 0)  # cut, it would be empty for a moment

    def release(self) -> None:
        """Let others have it; again does nothing."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1


def _take(file: int) -> None:
    """Lock a file. BlockingIOError if somebody has it for longer than `list` takes to look."""
    for _ in range(LOOKS):
        try:
            return fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            time.sleep(LOOK_S)
    return fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def campaign_worked_on(path: Path) -> str | None:
    """The campaign that the owner of the lock says he works on; None if he says none, or nobody has the lock."""
    try:
        file = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:
        return None
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        campaign = _content(file).get("campaign")
        return campaign if isinstance(campaign, str) else None
    finally:
        os.close(file)
    return None


def user_name() -> str:
    """Who runs this process, by the system: what the environment says anybody can set."""
    try:
        return pwd.getpwuid(os.getuid()).pw_name
    except KeyError:  # a user without a name, as in containers
        return f"user {os.getuid()}"


def _this_command() -> str:
    program = Path(sys.argv[0]).name
    return " ".join(["pkm-rig" if program == "__main__.py" else program, *sys.argv[1:]])[:200]


def _open(path: Path, what: str) -> int:
    """The file, for all users of the computer; one that another user made is not made again."""
    try:
        try:
            return os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC)
        except FileNotFoundError:
            file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
            os.fchmod(file, 0o666)
            return file
    except OSError as error:
        raise StoreError(f"{what}: {path} cannot be opened: {error.strerror}; choose another place") from error


def this_process() -> dict[str, Any]:
    """What an owner says of himself: command, process, user, since when."""
    since = f"{datetime.now(UTC):%F %T} UTC"
    return {"command": _this_command(), "pid": os.getpid(), "user": user_name(), "since": since}


def describe_owner(owner: Mapping[str, Any]) -> str:
    """An owner in words, with his computer where he says it."""
    try:
        host = f" on {owner['host']}" if "host" in owner else ""
        return f"'{owner['command']}', process {owner['pid']} of {owner['user']}{host} since {owner['since']}"
    except KeyError:
        return "another process"


def _owner(file: int) -> str:
    """Who says in the file that he has it."""
    return describe_owner(_content(file))


def _content(file: int) -> dict[str, Any]:
    """What the owner wrote; nothing if it is not that."""
    try:
        content = json.loads(os.pread(file, MOST_BYTES, 0))
    except (ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}
