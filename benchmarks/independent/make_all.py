"""Makes the recordings of an archive that are missing, side by side."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from pathlib import Path
from typing import Protocol, TypeVar

from benchmarks.side_by_side import side_by_side
from tests.kept_results import CannotBeKept


class Named(Protocol):
    """What a recording is made from."""

    @property
    def name(self) -> str:
        """That of the recording's folder."""


_Case = TypeVar("_Case", bound=Named)


def make_all(make_case: Callable[[_Case, Path], str], cases: Sequence[_Case], folder: Path, processes: int) -> None:
    """Make those that are not there; each is whole (`pack.write_case`) or not there. Raises CannotBeKept."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CannotBeKept(f"{folder}: {error.strerror}; name another folder") from error
    missing = [case for case in cases if not (folder / case.name).exists()]
    for part in folder.glob("*.part"):
        shutil.rmtree(part)
    started = time.monotonic()
    with side_by_side(make_case, [(case, folder) for case in missing], processes) as running:
        for done, future in enumerate(as_completed(running), 1):
            name, passed_min = future.result(), (time.monotonic() - started) / 60.0
            left_min = passed_min / done * (len(missing) - done)
            print(
                f"{name} made; {done} of {len(missing)}; {passed_min:.1f} min, {left_min:.1f} left",
                file=sys.stderr, flush=True,
            )  # fmt: skip
