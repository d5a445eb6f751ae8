"""A campaign under way at a terminal, the same as the page shows, as text that is drawn anew in place."""

from __future__ import annotations

import errno
import math
import termios
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol

from rich.console import Group, RenderableType
from rich.live import Live as Display
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from pkm_rig.report.asked import asked_of
from pkm_rig.report.terminal import messages, progress_bar
from pkm_rig.results.callbacks import Progress
from pkm_rig.results.estimate import Estimate
from pkm_rig.rig.live import Live, Snapshot
from pkm_rig.rig.rig import Rig

SHOWN_READINGS = 5
SHOWN_SHARES = 8
PER_SECOND = 4.0
GO_ON = "press Enter"
PAUSING = "pausing after this reading; Ctrl-C again stops"


class Estimates(Protocol):
    """Whoever estimates the model from time to time while it is measured."""

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """Those of the campaign under way, the last one last."""
        ...

    def look(self, campaign: str, readings: int) -> None:
        """A campaign has so many readings; must return at once."""
        ...


@contextmanager
def live_progress(rig: Rig, model: Estimates) -> Iterator[Progress]:
    """Progress of a campaign on a rig with its guards, its last readings, the model so far and what it asks for.

    Drawn in place; one line a minute where that is no terminal. OSError at the next progress if the terminal is gone.
    """
    if not messages.is_terminal:
        with progress_bar() as lines:
            yield lines
        return
    live = Live()
    live.watch(rig)

    def look() -> RenderableType:
        seen = live.snapshot()
        model.look(seen.campaign, seen.done)
        return shown(seen, model.estimates, pausing=rig.operator.asks_to_pause())

    def progress(count: int, total: int, phase: str) -> None:
        _require_terminal()
        live.progress(count, total, phase)

    with Display(get_renderable=look, console=messages, refresh_per_second=PER_SECOND, transient=True):
        yield progress


def _require_terminal() -> None:
    """OSError if the terminal is gone, of which drawing says nothing: rich draws only where a stream still has one."""
    try:
        termios.tcgetattr(messages.file)
    except termios.error as error:
        if error.args[0] == errno.EIO:  # and not where a signal has told of it, and the stream leads nowhere by now
            raise OSError(*error.args) from error


def shown(seen: Snapshot, estimates: Sequence[Estimate] = (), *, pausing: bool = False) -> RenderableType:
    """A snapshot as text: what is asked for first, as one thing to do."""
    parts: list[RenderableType] = []
    asked = asked_of(seen, GO_ON)
    if asked is not None:
        parts.append(Panel(Text(asked.why), title=Text(asked.action), title_align="left", border_style="bold"))
    if pausing:
        parts.append(Text(PAUSING, style="bold"))
    parts += [_progress(seen), _place(seen), _guards(seen)]
    if seen.readings:
        parts.append(_readings(seen))
    if estimates:
        parts.append(_model(estimates))
    return Group(*parts)


def _progress(seen: Snapshot) -> RenderableType:
    line = Table.grid(padding=(0, 1))
    left = "" if seen.left_s is None else f"about {left_in_words(seen.left_s)} left"
    line.add_row(
        Text(seen.phase or "connecting"),
        ProgressBar(total=max(seen.total, 1), completed=seen.done, width=24),
        Text(f"{seen.done} of {seen.total} readings" if seen.total else ""),
        Text(left),
    )
    return line


def _place(seen: Snapshot) -> RenderableType:
    if seen.pose is None:
        return Text("tool: not known yet")
    tool = ", ".join(f"{x * 1e3:.1f}" for x in seen.pose[:3])
    target = "" if seen.target is None else ", ".join(f"{x * 1e3:.1f}" for x in seen.target[:3])
    return Text(f"tool at {tool} mm" + (f", target {seen.target_number} at {target} mm" if target else ""))


def _guards(seen: Snapshot) -> RenderableType:
    """Those that are not good with their values, one a line; the names of all others, and the values of checks."""
    good = [guard for guard in seen.guards if guard.light == "good"]
    lines = [Text(f"! {guard.name}: {guard.value}", style="bold") for guard in seen.guards if guard.light == "bad"]
    lines += [Text(f"- {guard.name}: {guard.value}") for guard in seen.guards if guard.light == "unknown"]
    checks = [f"{guard.name} {guard.value}" for guard in good if " of " in guard.value]
    names = [guard.name for guard in good if " of " not in guard.value]
    lines.append(Text(f"good: {', '.join(names + checks) or 'nothing read yet'}"))
    return Group(*lines)


def _readings(seen: Snapshot) -> RenderableType:
    table = Table(box=None, pad_edge=False, header_style="dim")
    for name in ("number", "phase", "reflector", "pose", "distance / m", "residual / um"):
        table.add_column(name, justify="right")
    for reading in reversed(seen.readings[-SHOWN_READINGS:]):
        away = "" if math.isnan(reading.residual_m) else f"{reading.residual_m * 1e6:.0f}"
        table.add_row(
            str(reading.sequence), reading.phase.replace("_", " "), reading.smr,
            "" if reading.pose < 0 else str(reading.pose), f"{reading.distance_m:.5f}", away,
        )  # fmt: skip
    return table


def _model(estimates: Sequence[Estimate]) -> RenderableType:
    """How the uncertainty of the parameters falls, as shares of that before the campaign, and the last estimate."""
    shares = " ".join(f"{e.share_left:.0%}" for e in estimates[-SHOWN_SHARES:])
    return Text(f"uncertainty of the parameters, of that before: {shares}\n{estimates[-1].line}", style="dim")


def left_in_words(seconds: float) -> str:
    """A duration as it is said."""
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"
