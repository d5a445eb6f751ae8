"""A campaign at the terminal: what it shows while it is under way; Ctrl-C pauses, Enter goes on, a second one stops."""

from __future__ import annotations

import os
import select
import sys
import termios
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pkm_rig.results.callbacks import Progress
    from pkm_rig.rig.rig import Rig


class TerminalOperator:
    """Asked from the signal's handler and from the rig's worker."""

    hint = "press Enter"

    def __init__(self, keyboard: int) -> None:
        self._keyboard = keyboard
        self._asked = self._waits = False

    def ask(self) -> bool:
        """Ask for a pause; False if one is asked for or under way, and nobody is to be asked any more."""
        if self._asked or self._waits:
            return False
        self._asked = True
        return True

    def asks_to_pause(self) -> bool:
        """Whether a pause was asked for and has not begun."""
        return self._asked

    def begin_wait(self) -> None:
        """What was typed before counts no more."""
        self._asked, self._waits = False, True
        termios.tcflush(self._keyboard, termios.TCIFLUSH)

    def acknowledges(self) -> bool:
        """Whether Enter was pressed."""
        ready, _, _ = select.select([self._keyboard], [], [], 0.0)
        return bool(ready) and b"\n" in os.read(self._keyboard, 4096)

    def end_wait(self) -> None:
        """The campaign goes on; the next Ctrl-C pauses it again."""
        self._waits = False


_at_work: TerminalOperator | None = None


def ask_for_pause() -> bool:
    """Ask the campaign under way for a pause; False if there is none, or nobody who could have it go on."""
    return _at_work is not None and _at_work.ask()


@contextmanager
def at_terminal(rig: Rig, out: Path) -> Iterator[Progress]:
    """Show the rig's campaign in the store below `out` at this terminal, and have it operated from there."""
    from pkm_rig.jobs.running_follower import Follower
    from pkm_rig.report.terminal_live import live_progress

    with _operated_from_terminal(rig), closing(Follower(out)) as follower, live_progress(rig, follower) as progress:
        yield progress


@contextmanager
def _operated_from_terminal(rig: Rig) -> Iterator[None]:
    """Have the rig's campaign paused and acknowledged from this terminal; without one nothing changes.

    What is typed is not shown meanwhile: it would tear what is drawn there in place.
    """
    global _at_work  # noqa: PLW0603  # a signal's handler has no other way to it
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        yield
        return
    _at_work = TerminalOperator(sys.stdin.fileno())
    rig.operator = _at_work
    try:
        with _nothing_echoed(sys.stdin.fileno()):
            yield
    finally:
        _at_work = None


@contextmanager
def _nothing_echoed(keyboard: int) -> Iterator[None]:
    if _is_in_background(keyboard):  # where a change would stop this process
        yield
        return
    before = termios.tcgetattr(keyboard)
    silent = [*before[:3], before[3] & ~termios.ECHO, *before[4:]]
    termios.tcsetattr(keyboard, termios.TCSADRAIN, silent)
    try:
        yield
    finally:
        with suppress(termios.error):  # the terminal may be gone
            termios.tcsetattr(keyboard, termios.TCSADRAIN, before)


def _is_in_background(keyboard: int) -> bool:
    try:
        return os.tcgetpgrp(keyboard) != os.getpgrp()
    except OSError:  # it controls nobody
        return False
