"""Where commands print: results on stdout, messages and progress on stderr."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console, RenderableType
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

Tell = Callable[[int, int, str], None]  # advance, total, what

messages = Console(stderr=True, highlight=False)
results = Console(highlight=False)


def print_json(result: dict[str, Any]) -> None:
    """One machine-readable object on stdout."""
    print(json.dumps(result, allow_nan=False))


def print_result(as_json: bool, result: dict[str, Any], *shown: RenderableType) -> None:
    """A result for programs, or what is shown of it to people."""
    if as_json:
        print_json(result)
        return
    for part in shown:
        results.print(part, soft_wrap=True)


@contextmanager
def progress_bar() -> Iterator[Tell]:
    """A bar on stderr; it is told how far a job advanced, of how much, and with what."""
    columns = (
        TextColumn("{task.description:20.20}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=messages, transient=True) as progress:
        task = progress.add_task("connecting", total=None)

        def tell(advance: int, total: int, what: str) -> None:
            progress.update(task, advance=advance, total=total, description=what.replace("_", " "))

        yield tell
