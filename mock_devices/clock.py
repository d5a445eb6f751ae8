"""The time that the mock devices live in. Whoever starts them injects it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol


class RigClock(Protocol):
    """Rig time in seconds. Nothing in this package reads any other clock."""

    def now_s(self) -> float:
        """Rig time."""
        ...

    def sleep_s(self, duration_s: float) -> None:
        """Block the calling thread for rig time; a server thread lends its waiting client's turn."""
        ...

    def call_at(self, t_s: float, callback: Callable[[], None]) -> Callable[[], None]:
        """Call back once at rig time `t_s` from a thread of the clock; returns a function that cancels."""
        ...
