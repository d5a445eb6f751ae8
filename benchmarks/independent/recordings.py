"""Where the recordings are, how they are split, and copies of them that hold nothing of the truth."""

from __future__ import annotations

import hashlib
import re
import shutil
import tarfile
from collections.abc import Collection, Iterator
from pathlib import Path

ARCHIVE = "recordings.tar.xz"
FILES = ("machine.toml", "readings.csv", "recording.toml")
_MEMBER = re.compile(r"(?:\./)?(rec\d+)/([^/]+)")


class NoRecordings(RuntimeError):
    """The recordings are not there, or are not what they should be; one line."""


def find_archive(folder: Path) -> Path:
    """The archive of a folder; raises NoRecordings."""
    path = folder / ARCHIVE
    if not path.is_file():
        raise NoRecordings(f"no {ARCHIVE} in {folder}; name its folder with --data or INDEPENDENT_RECORDINGS")
    return path


def is_even(name: str) -> bool:
    """Whether a recording may be looked at: those of even number. Odd ones are scored in final runs only."""
    return int(name.removeprefix("rec")) % 2 == 0


def names_of(archive: Path, *, even: bool) -> list[str]:
    """Names of one half's recordings, in order."""
    names = {name for name, _, _ in _members(archive)}
    return sorted(name for name in names if is_even(name) is even)


def copy_recordings(archive: Path, names: Collection[str], folder: Path) -> None:
    """Write the recording folders of `names`: the three files of a recording and nothing else of the archive."""
    for name, file, stream in _members(archive):
        if name in names:
            (folder / name).mkdir(parents=True, exist_ok=True)
            with (folder / name / file).open("wb") as copy:
                shutil.copyfileobj(stream, copy)
    lacking = [name for name in sorted(names) if not all((folder / name / file).is_file() for file in FILES)]
    if lacking:
        raise NoRecordings(f"{archive}: {lacking[0]} lacks one of {', '.join(FILES)}; fetch the archive anew")


def digest_of(archive: Path) -> str:
    """Hash that tells archives apart."""
    return hashlib.sha256(archive.read_bytes()).hexdigest()[:12]


def _members(archive: Path) -> Iterator[tuple[str, str, tarfile.ExFileObject]]:
    """Recording, file and content of each file of a recording; the truth's members are passed over unread."""
    try:
        with tarfile.open(archive) as tar:
            for member in tar:
                parts = _MEMBER.fullmatch(member.name)
                if member.isfile() and parts and parts[2] in FILES:
                    stream = tar.extractfile(member)
                    assert isinstance(stream, tarfile.ExFileObject)
                    yield parts[1], parts[2], stream
    except (tarfile.TarError, EOFError, OSError) as error:
        raise NoRecordings(f"{archive}: {error}; fetch the archive anew") from error
