"""Reading files from strangers: plain files only, no more bytes than stated, before anything is parsed.

Every reader of this package and of the application opens its files here.
"""

from __future__ import annotations

import io
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from calibration.base.errors import InputError

MAX_FILE_BYTES = 1_000_000
MAX_LINE = 100_000  # characters


class _BoundedFile(io.RawIOBase):
    """A descriptor that gives up to so many bytes and then refuses: a file may grow while it is read."""

    def __init__(self, descriptor: int, path: Path, most_bytes: int) -> None:
        self._descriptor, self._path, self._most_bytes, self._taken = descriptor, path, most_bytes, 0

    def readable(self) -> bool:
        """It is."""
        return True

    def readinto(self, buffer: object) -> int:
        """Read what fits into the buffer, one byte more than allowed at most."""
        with memoryview(buffer) as view:  # type: ignore[arg-type]
            data = os.read(self._descriptor, min(len(view), self._most_bytes + 1 - self._taken))
            view[: len(data)] = data
        self._taken += len(data)
        if self._taken > self._most_bytes:
            raise _too_large(self._path, self._most_bytes)
        return len(data)

    def close(self) -> None:
        """Close the descriptor."""
        if not self.closed:
            os.close(self._descriptor)
        super().close()


@contextmanager
def open_text(path: Path, most_bytes: int = MAX_FILE_BYTES) -> Iterator[io.TextIOWrapper]:
    """A plain UTF-8 file, with a byte order mark or without, line ends as they are.

    InputError in one line for anything else, also while it is read.
    """
    if "\0" in str(path):
        raise InputError(f"{str(path)!r}: no path; check it")
    try:
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0))
        with _BoundedFile(descriptor, path, most_bytes) as raw:
            found = os.fstat(descriptor)
            if not stat.S_ISREG(found.st_mode):
                raise InputError(f"{path}: not a plain file; name a file")
            if found.st_size > most_bytes:
                raise _too_large(path, most_bytes)
            with io.TextIOWrapper(io.BufferedReader(raw), encoding="utf-8-sig", newline="") as stream:
                yield stream
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; check the path") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not UTF-8 text; save it as UTF-8") from error


def read_text(path: Path, most_bytes: int = MAX_FILE_BYTES) -> str:
    """The text of a small UTF-8 file, lines ending in \\n; raises InputError with one line."""
    with open_text(path, most_bytes) as stream:
        return stream.read().replace("\r\n", "\n").replace("\r", "\n")


def require_file_or_folder(path: Path) -> None:
    """Raise InputError for what is there and is neither, such as a device or a pipe; it is not opened."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise InputError(f"{path}: not a plain file or folder; check the path")


def bounded_lines(stream: io.TextIOBase, path: Path) -> Iterator[str]:
    """Lines of an open file; InputError for one that is longer than MAX_LINE characters."""
    number = 0
    while line := stream.readline(MAX_LINE + 1):
        number += 1
        if len(line) > MAX_LINE:
            raise InputError(f"{path}: line {number} is longer than {MAX_LINE} characters; not a file of pkm-rig")
        yield line


def _too_large(path: Path, most_bytes: int) -> InputError:
    return InputError(f"{path}: larger than {most_bytes} bytes; not a file of pkm-rig")
