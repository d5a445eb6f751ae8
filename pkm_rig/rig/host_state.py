"""Which correction this computer makes of its targets, as the store knows it: a generation of one accepted campaign."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

from pkm_rig.store.store import Store

HOST = "host"  # key of the steps of a change of tables that say what is left, or tried
ENDED = ("kept", "done")


@dataclass(frozen=True)
class HostState:
    """A generation (counts up), the campaign whose identified model it is, a CRC of its samples, whether it is on."""

    generation: int
    campaign: str
    crc: int
    on: bool = True

    def off(self) -> HostState:
        """The same, not in use."""
        return replace(self, on=False)

    def as_json(self) -> dict[str, Any]:
        """For the store."""
        return asdict(self)

    def in_words(self) -> str:
        """For people."""
        of = f"generation {self.generation} of campaign {self.campaign}"
        return f"the host corrects by {of}" if self.on else f"the host does not correct (it did by {of})"


def state_of(data: dict[str, Any] | None) -> HostState | None:
    """From the store; None where nothing was ever accepted."""
    if data is None:
        return None
    return HostState(int(data["generation"]), str(data["campaign"]), int(data["crc"]), bool(data["on"]))


def host_in_use(store: Store, rig: str, machine: str) -> HostState | None:
    """What the last change that was ended has left; None before the first. One row says it, so it is whole."""
    for step in reversed(store.table_changes(rig)):
        if step.machine == machine and step.kind in ENDED and HOST in step.data:
            return state_of(step.data[HOST])
    return None


def next_generation(store: Store, rig: str) -> int:
    """A generation above all that were ever tried."""
    tried = [
        step.data[HOST] for step in store.table_changes(rig) if step.data.get(HOST) and "generation" in step.data[HOST]
    ]
    return max((int(data["generation"]) for data in tried), default=0) + 1
