"""Whoever watches a rig at work: told what happens, asked nothing, and never a reason for a campaign to end."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from calibration.base.arrays import Array


@dataclass(frozen=True)
class Request:
    """What a campaign waits for somebody to do: one thing.

    `of`: the payload in words, empty where none is to be on, or the reflector's name.
    """

    kind: Literal["payload", "reflector", "go on"]
    text: str
    of: str = ""


class Observer(Protocol):
    """Told from the threads of the campaign, at once after each event; must return at once."""

    def campaign(self, campaign: str) -> None:
        """A session of this campaign begins."""
        ...

    def going_to(self, target_m: Array, pose: int) -> None:
        """The drives begin to move to a platform pose (6,), m and rad, by its number."""
        ...

    def aiming_at(self, smr: str) -> None:
        """The station turns to a reflector."""
        ...

    def reading(self, row: Mapping[str, Any], deviation_m: Array) -> None:
        """A reading is stored: its row, and (3,) from where the nominal machine has it (NaN: not known)."""
        ...

    def checked(self, what: str, value: float, limit: float, unit: str) -> None:
        """A check of the campaign was made: its value and the limit that it must not exceed, in `unit`."""
        ...

    def asks(self, request: Request | None) -> None:
        """The campaign waits for somebody; None: no more."""
        ...


class Unobserved:
    """Nobody watches."""

    def campaign(self, campaign: str) -> None:
        """Nothing to do."""

    def going_to(self, target_m: Array, pose: int) -> None:
        """Nothing to do."""

    def aiming_at(self, smr: str) -> None:
        """Nothing to do."""

    def reading(self, row: Mapping[str, Any], deviation_m: Array) -> None:
        """Nothing to do."""

    def checked(self, what: str, value: float, limit: float, unit: str) -> None:
        """Nothing to do."""

    def asks(self, request: Request | None) -> None:
        """Nothing to do."""
