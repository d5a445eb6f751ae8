"""Whoever operates a rig: asked to go on when a campaign waits."""

from __future__ import annotations

from typing import Protocol


class Operator(Protocol):
    """Whoever may be at a terminal, or at a page; `hint` says how they have a campaign go on."""

    hint: str

    def asks_to_pause(self) -> bool:
        """Whether a pause was asked for and has not begun."""
        ...

    def begin_wait(self) -> None:
        """A wait begins: what was typed before counts no more."""
        ...

    def acknowledges(self) -> bool:
        """Whether somebody has said since that it may go on; at once."""
        ...

    def end_wait(self) -> None:
        """The campaign goes on."""
        ...


class Nobody:
    """No terminal: only the PLC can acknowledge."""

    hint = "press Enter"

    def asks_to_pause(self) -> bool:
        """Never."""
        return False

    def begin_wait(self) -> None:
        """Nothing to do."""

    def acknowledges(self) -> bool:
        """Never."""
        return False

    def end_wait(self) -> None:
        """Nothing to do."""
