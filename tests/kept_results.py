"""Results of long runs, a line of JSON each as they come: a run goes on from them, however the former one ended."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any


def key_of(*parts: str | int) -> str:
    """What a result is found again by: the same as long as everything it depends on is."""
    return hashlib.sha256("\0".join(map(str, parts)).encode()).hexdigest()[:16]


class CannotBeKept(Exception):
    """A file of results that cannot be read or written: what is wrong, and what to do."""


class KeptResults(dict[str, dict[str, Any]]):
    """Results by their `key`, those of a file that is there among them; a line that was not written to its end is none.

    Raises ValueError if the file is damaged elsewhere, CannotBeKept if it can be neither read nor made.
    """

    def __init__(self, path: Path, *, fresh: bool = False) -> None:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            text = path.read_text(encoding="utf-8") if path.exists() and not fresh else ""
        except OSError as error:
            raise CannotBeKept(f"{path}: {error.strerror}; name another folder") from error
        whole = text[: text.rfind("\n") + 1]
        results = [json.loads(line) for line in whole.splitlines()]
        super().__init__({result["key"]: result for result in results})
        if fresh or whole != text:
            path.write_text(whole, encoding="utf-8")
        self._path = path

    def add(self, result: dict[str, Any]) -> None:
        """Keep one more, in the place of a former one with its key."""
        self[result["key"]] = result
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(result) + "\n")


def until_stopped(main: Callable[[], int], again: str = "goes on from here") -> int:
    """The status of a command: 130 after an interrupt, 2 if nothing can be kept; again: what it does then."""
    try:
        return main()
    except CannotBeKept as error:
        print(f"results cannot be kept in {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"stopped; the same command {again}", file=sys.stderr)
        return 130
