"""How a job reports its progress to whoever shows it."""

from __future__ import annotations

from collections.abc import Callable

Notify = Callable[[str], None]  # one line of text
Progress = Callable[[int, int, str], None]  # readings advanced, readings in total, phase
