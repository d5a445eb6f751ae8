"""A campaign that waits for its operator between two readings, the drives without power: paused, or suspended.

It goes on when it is acknowledged, at the terminal, the page or the PLC, and all interlocks are good.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from drivers.errors import UNSEEN, InterlockOpen, PlcError, Stopped
from pkm_rig.rig.observer import Request
from pkm_rig.rig.release import missing_to_move
from pkm_rig.rig.rig import Rig

LOOK_S = 0.1  # of rig time, and as much of host time


class VisitBroken(Exception):
    """The campaign has to wait; what it was at is made anew afterwards."""


class Waiting:
    """Pauses and suspensions of one campaign; `hold` runs on the rig's worker, `end` may come from any thread."""

    def __init__(
        self,
        rig: Rig,
        say: Callable[[str], None],
        note: Callable[[str, dict[str, Any]], None],
        host_sleep_s: Callable[[float], None] = time.sleep,
    ) -> None:
        self._rig, self._operator, self._say, self._note = rig, rig.operator, say, note
        self._host_sleep_s = host_sleep_s
        self._ended = threading.Event()
        campaign = rig.file.campaign
        self._suspends, self._suspends_unseen = campaign.on_interlock == "suspend", campaign.on_unseen == "suspend"

    def asked(self) -> bool:
        """Whether a pause is to begin."""
        return self._operator.asks_to_pause()

    def end(self) -> None:
        """The campaign ends: whoever waits is let go, with Stopped."""
        self._ended.set()

    def suspends_at(self, error: BaseException) -> bool:
        """Whether an error suspends the campaign instead of ending it: an interlock that opened, or a reflector that
        the station does not see, where the rig file says so; nothing else.
        """
        if self._ended.is_set():
            return False
        trip = self._rig.supervisor.trip
        if trip is None and isinstance(error, UNSEEN):
            return self._suspends_unseen
        return self._suspends and type(error if trip is None else trip) is InterlockOpen

    def hold(self, request: Request) -> None:
        """Take the power off and wait until it is acknowledged with all interlocks good; then power the drives.

        Raises Stopped if the campaign ends meanwhile, and what else supervision finds.
        """
        rig, why = self._rig, request.text
        self._note("held", {"reason": why})
        with rig.supervised_without_power() as payload:
            where = self._operator.hint + ("" if rig.plc.map.acknowledge is None else ", or acknowledge at the PLC")
            self._operator.begin_wait()
            rig.observer.asks(request)
            self._say(f"{why}; the drives are without power: {where} to go on")
            try:
                self._wait_for_acknowledgement()
            finally:
                rig.observer.asks(None)
            if rig.supervisor.state().payload != payload:
                raise PlcError("PLC", "payload", "it was changed while the campaign waited", "go on with --resume")
        rig.drives.clear_stop()
        rig.enable()
        self._note("gone_on", {})
        self._say("going on")

    def _wait_for_acknowledgement(self) -> None:
        supervisor = self._rig.supervisor
        at_begin = supervisor.state().acknowledge
        while True:
            if self._ended.is_set():
                raise Stopped("campaign", "operator", "ended while it waited", "go on with --resume")
            state = supervisor.state()
            if self._operator.acknowledges() or state.acknowledge != at_begin:
                missing = missing_to_move(self._rig, state)
                if not missing:
                    self._operator.end_wait()
                    return
                at_begin = state.acknowledge
                self._say(f"interlock still open: {', '.join(missing)}; close it and acknowledge again")
            self._rig.clock.sleep_s(LOOK_S)
            self._host_sleep_s(LOOK_S)
