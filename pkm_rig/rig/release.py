"""The PLC's local release: the key switch at the machine by which somebody who is not there may move it."""

from __future__ import annotations

from drivers.errors import InterlockOpen
from drivers.plc.plc_registers import PlcState
from pkm_rig.rig.rig import Rig


def require_release(rig: Rig) -> None:
    """From now on drives have power only while the PLC reports its local release, and a payload is acknowledged.

    InterlockOpen where it is off, or where the PLC has no register of it.
    """
    state = rig.supervisor.look()
    if not state.local_release:
        is_there = state.local_release is not None
        raise InterlockOpen(
            rig.plc.name, rig.plc.where,
            "the local release is off" if is_there else "it has no register 'local_release'",
            "turn the key at the machine" if is_there else "name it in [plc.registers], or use the command line",
        )  # fmt: skip
    rig.needs_release = rig.supervisor.needs_release = True


def missing_to_move(rig: Rig, state: PlcState) -> list[str]:
    """What has to be put right at the machine before it may move."""
    withheld = rig.needs_release and not state.local_release
    return [*state.open_interlocks(), *(["local release"] if withheld else [])]
