"""Registers of the PLC that only we write, and the one that only answers us: whether another client has used them."""

from __future__ import annotations

from collections.abc import Sequence

from drivers.plc.plc_registers import RegisterMap


class OwnWords:
    """What we have written to one PLC, compared with what a block of its registers says.

    Our heartbeat is compared where it lies in the block and has once been read back as it was written: some PLCs keep
    what they are told in registers that cannot be read. The number of the last accepted command may change to that of
    our own command only.
    """

    def __init__(self, registers: RegisterMap) -> None:
        self._map = registers
        self._beats: tuple[int, ...] = ()
        self._reads_back = False
        self._taken: tuple[int, ...] = ()

    def beat(self, number: int) -> None:
        """Our heartbeat is about to be written; the one before may still be read."""
        self._beats = (number, *self._beats[:1])

    def command(self, taken: int, sequence: int) -> None:
        """A command with this number is about to be written, after the one accepted last."""
        self._taken = (*(self._taken or (taken,)), sequence)

    def foreign(self, words: Sequence[int]) -> str | None:
        """What another client has written, None where nothing tells of one."""
        beat = self._word(words, self._map.master_heartbeat)
        self._reads_back |= beat in self._beats
        if self._reads_back and beat not in self._beats:
            return f"register {self._map.master_heartbeat} holds {beat}, not our heartbeat: another client writes it"
        taken = self._word(words, self._map.sequence_taken)
        if taken is None:
            return None
        self._taken = self._taken or (taken,)
        if taken not in self._taken:
            return f"command {taken} was accepted, which is not ours: another client commands the PLC, or it restarted"
        self._taken = self._taken[self._taken.index(taken) :]
        return None

    def _word(self, words: Sequence[int], address: int | None) -> int | None:
        at = -1 if address is None else address - self._map.first
        return words[at] if 0 <= at < len(words) else None
