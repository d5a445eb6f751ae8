"""What came of one campaign where a command was run on many."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Done:
    """`result` as the command gives it of this campaign alone; or `failure`, one line. `kept`: of an earlier run."""

    campaign: str
    rig: str
    result: dict[str, Any] | None = None
    failure: str = ""
    kept: bool = False

    def as_dict(self) -> dict[str, Any]:
        """For programs (docs/reference/json.md)."""
        return {**vars(self), "failure": self.failure or None}
