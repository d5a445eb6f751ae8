"""Where commands print: results on stdout, messages and progress on stderr."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.segment import Segment
from rich.text import Text

from calibration.base.errors import printable
from pkm_rig.report.notation import with_symbols
from pkm_rig.results.callbacks import Progress as ReportProgress

if TYPE_CHECKING:
    from calibration.recording.recording import Recording


class PeopleConsole(Console):
    """A console that shows the symbols of units if its stream's encoding has them, and obeys nothing in a text.

    Brackets are brackets, and control characters of names are shown as escapes.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(**{"highlight": False, "markup": False, "emoji": False} | options)

    def render_str(self, text: str, **options: Any) -> Text:
        """A string as Text, with symbols; cells of tables are rendered and measured by this."""
        return super().render_str(with_symbols(_lines(text), self.encoding), **options)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Segments of a renderable, Text with symbols."""
        if isinstance(renderable, Text):
            renderable = renderable.copy()
            renderable.plain = with_symbols(_lines(renderable.plain), self.encoding)
        return super().render(renderable, options)


def _lines(text: str) -> str:
    """A text of several lines without anything that a terminal would obey."""
    return "\n".join(printable(line) for line in text.split("\n"))


messages = PeopleConsole(stderr=True)
results = PeopleConsole()


LINE_PERIOD_S = 60.0
LOOK_S = 1.0
SIMULATED = "SIMULATED: by simulated devices, not on a machine"


def print_simulated(simulated: bool) -> None:
    """A line for people before a result that does not come from a machine."""
    if simulated:
        results.print(SIMULATED, style="bold")


def print_json(result: dict[str, Any]) -> None:
    """One machine-readable object on stdout."""
    print(json.dumps(result, allow_nan=False))


def print_result(as_json: bool, result: dict[str, Any], *parts: RenderableType) -> None:
    """A result for programs, or parts of it for people."""
    if as_json:
        print_json(result)
        return
    print_simulated(result.get("simulated", False))
    for part in parts:
        results.print(part, soft_wrap=True)


def print_either(as_json: bool, result: dict[str, Any], print_for_people: Callable[[dict[str, Any]], None]) -> None:
    """A result for programs, or as its own function prints it for people."""
    if as_json:
        print_json(result)
    else:
        print_simulated(result.get("simulated", False))
        print_for_people(result)


def print_message(line: str) -> None:
    """A line on stderr."""
    messages.print(printable(line), soft_wrap=True)


def say_repaired(recording: Recording) -> dict[str, str]:
    """Say on stderr if the times of a recording are not those that were measured; the same for a JSON result."""
    from calibration.recording.sessions import repaired_text  # noqa: PLC0415

    text = repaired_text(recording)
    if text is None:
        return {}
    print_message(text)
    return {"repaired": text}


class ProgressLines:
    """Progress where nobody watches: one line a minute, and one for each phase. Safe to use from several threads."""

    def __init__(
        self, say: Callable[[str], None], host_s: Callable[[], float] = time.monotonic, counted: str = "readings"
    ) -> None:
        self._say, self._host_s, self._counted = say, host_s, counted
        self._done, self._total, self._phase, self._said_s = 0, 0, "", host_s()
        self._lock = threading.Lock()

    def advance(self, count: int, total: int, phase: str) -> None:
        """Count readings."""
        with self._lock:
            self._done, self._total = self._done + count, total
            if self._is_due() or phase not in (self._phase, "nests"):  # nests come between all others
                self._phase = phase
                self._say_phase()

    def remind(self) -> None:
        """Say where it is, if nothing was said for a minute: something takes long that counts no readings."""
        with self._lock:
            if self._phase and self._is_due():
                self._say_phase()

    def _is_due(self) -> bool:
        return self._host_s() - self._said_s >= LINE_PERIOD_S

    def _say_phase(self) -> None:
        self._said_s = self._host_s()
        self._say(f"{self._done} of {self._total} {self._counted}: {self._phase.replace('_', ' ')}")


@contextmanager
def _progress_lines(counted: str) -> Iterator[ReportProgress]:
    lines, ended = ProgressLines(print_message, counted=counted), threading.Event()

    def watch() -> None:
        with suppress(OSError):  # nobody reads it any more
            while not ended.wait(LOOK_S):
                lines.remind()

    watching = threading.Thread(target=watch, name="progress", daemon=True)
    watching.start()
    try:
        yield lines.advance
    finally:  # nothing may follow the last line of a command
        ended.set()
        watching.join()


@contextmanager
def progress_bar(counted: str = "readings") -> Iterator[ReportProgress]:
    """A progress bar on stderr; one line a minute, which says what is counted, where that is no terminal."""
    if not messages.is_terminal:
        with _progress_lines(counted) as lines:
            yield lines
        return
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

        def advance(count: int, total: int, phase: str) -> None:
            progress.update(task, advance=count, total=total, description=phase.replace("_", " "))

        yield advance
