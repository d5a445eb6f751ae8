"""What the views of a page ask of it."""

from __future__ import annotations

from typing import Protocol

from pkm_rig.panel.actions import Action
from pkm_rig.panel.work import Work


class PageOfWork(Protocol):
    """A page, as its views see it."""

    work: Work

    @property
    def has_control(self) -> bool:
        """Whether this page commands."""
        ...

    def press(self, action: Action) -> None:
        """A first press."""
        ...

    def pause(self) -> None:
        """Pause the campaign under way."""
        ...

    def say(self, line: str) -> None:
        """A line to whoever has pressed something."""
        ...
