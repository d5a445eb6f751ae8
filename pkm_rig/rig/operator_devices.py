"""Bluesky's view of whoever operates the rig: a payload is asked for, a campaign that waits is acknowledged."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from drivers.errors import UNSEEN
from pkm_rig.rig.devices import ReadingTags
from pkm_rig.rig.observer import Request
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.waiting import Waiting
from pkm_rig.rig.worker import Worker, WorkStatus

PAYLOAD_ASKED, PAYLOAD_ON = "payload_asked", "payload_on"  # events of the campaign


class PayloadDevice:
    """`set(number)`: ask the PLC for a payload and wait until it reports that it is on; both are in the record."""

    name = "payload"
    parent = None

    def __init__(
        self,
        rig: Rig,
        worker: Worker,
        say: Callable[[str], None],
        note: Callable[[str, dict[str, Any]], None],
        progress: Callable[[int, str], None],
        hold: Callable[[Request], None] = lambda _request: None,
    ) -> None:
        self._rig, self._worker, self._say, self._note, self._progress = rig, worker, say, note, progress
        self._hold = hold

    def set(self, number: int) -> WorkStatus:
        """Have a payload put on, or taken off; the PLC is told, and whoever stands at the terminal or reads the log."""
        return self._worker.submit(f"payload {number}", lambda: self._put_on(number))

    def _put_on(self, number: int) -> None:
        state = self._rig.supervisor.state()
        if state.payload == number:
            return
        load = self._rig.file.payloads[number]
        what, text = _asked_for(load.name, load.mass_kg, simulated=state.simulated)
        self._say(text)
        self._rig.observer.asks(Request("payload", text, what))
        self._note(PAYLOAD_ASKED, {"payload": number, "name": load.name, "mass_kg": load.mass_kg})
        self._progress(0, "payload exchange")
        try:  # the PLC acknowledges the payload; who stands at the PLC it does not say
            self._rig.change_payload(number, enable=False)
        finally:
            self._rig.observer.asks(None)
        by = {"acknowledged_by": f"{self._rig.plc.name} ({self._rig.plc.where})", "simulated": state.simulated}
        self._note(PAYLOAD_ON, {"payload": number, "name": load.name, **by})
        if self._rig.needs_release:  # a guard that closes behind the payload must set nothing going
            self._hold(Request("go on", f"the payload is {'on' if load.mass_kg else 'off'}"))
        else:
            self._rig.enable()


def _asked_for(name: str, mass_kg: float, *, simulated: bool) -> tuple[str, str]:
    """The payload in words, empty where none is to be on, and what is asked for."""
    if mass_kg == 0.0:
        who = "the simulated PLC has it taken off" if simulated else "take it off and acknowledge at the PLC"
        return "", f"no payload needed: {who}"
    who = "the simulated PLC has it put on" if simulated else "put it on and acknowledge at the PLC"
    what = f"'{name}' ({mass_kg:g} kg)"
    return what, f"payload needed: {what}; {who}"


class WaitingDevice:
    """`set(why)`: have the campaign wait, without power, until it is acknowledged."""

    name = "waiting"
    parent = None

    def __init__(self, worker: Worker, waiting: Waiting, tags: ReadingTags) -> None:
        self._worker, self._waiting, self._tags = worker, waiting, tags

    def broken(self) -> bool:
        """Whether an interlock, or a reflector that was not seen, has broken what was done last."""
        return self._worker.pardoned is not None

    def asked(self) -> bool:
        """Whether it has to wait: the operator has asked for a pause, or something has broken what was done."""
        return self.broken() or self._waiting.asked()

    def set(self, _why: object = None) -> WorkStatus:
        """Wait for the operator."""
        error, self._worker.pardoned = self._worker.pardoned, None
        why = "paused" if error is None else f"suspended: {error}"
        request = Request("go on", why)
        if isinstance(error, UNSEEN):
            request = Request("reflector", why, self._tags.smr)
        return self._worker.submit(why, lambda: self._waiting.hold(request))
