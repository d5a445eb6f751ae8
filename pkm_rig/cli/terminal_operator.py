"""The operator at the terminal: Ctrl-C pauses, Enter goes on, a second Ctrl-C stops."""

from __future__ import annotations

import os
import select
import sys
import termios
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pkm_rig.rig.rig import Rig

PAUSING = b"\npausing after this reading; Ctrl-C again stops\n"


class TerminalOperator:
    """Asked from the signal's handler and from the rig's worker."""

    hint = "press Enter"

    def __init__(self, keyboard: int, screen: int) -> None:
        self._keyboard, self._screen = keyboard, screen
        self._asked = self._waits = False

    def ask(self) -> bool:
        """Ask for a pause; False if one is asked for or under way, and nobody is to be asked any more."""
        if self._asked or self._waits:
            return False
        self._asked = True
        os.write(self._screen, PAUSING)
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
def operated_from_terminal(rig: Rig) -> Iterator[None]:
    """Have the rig's campaign paused and acknowledged from this terminal; without one nothing changes."""
    global _at_work  # noqa: PLW0603  # a signal's handler has no other way to it
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        yield
        return
    _at_work = TerminalOperator(sys.stdin.fileno(), sys.stderr.fileno())
    rig.operator = _at_work
    try:
        yield
    finally:
        _at_work = None
