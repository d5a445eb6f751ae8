"""The tables that were active before a job, kept to be written back."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from drivers.errors import DeviceError
from pkm_rig.rig.rig import Rig


class PreviousTables:
    """The images that were active on all drives when this was made; None on a rig without."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        states = [bank.state() for bank in rig.banks]
        self._images = (
            [bank.read_image(state.active) for bank, state in zip(rig.banks, states, strict=True)]
            if states and all(state.on and state.active for state in states)
            else None
        )
        self.description = "no compensation, as before" if self._images is None else "the former tables"

    def restore(self) -> None:
        """Back to what was active before, on all drives; they are left without power."""
        self._rig.switch_compensation(self._images)


@contextlib.contextmanager
def keep_previous_tables(rig: Rig) -> Iterator[PreviousTables]:
    """Keep the active tables; they are restored if anything fails, as far as the drives can be reached."""
    previous = PreviousTables(rig)
    try:
        yield previous
    except BaseException:
        with contextlib.suppress(DeviceError):
            previous.restore()
        raise
