"""Supervision: the PLC's interlocks, the heartbeats and the payload, polled for as long as a rig is connected.

Safety itself belongs to the PLC and the drives. Here is the procedure: any doubt stops all drives together and
says why; no motion starts unless the interlocks are fresh and good.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace

from drivers.drives.drive_group import DriveGroup
from drivers.errors import DeviceError, InterlockOpen, PlcError, StaleData
from drivers.plc.plc import Plc
from drivers.plc.plc_registers import PlcState
from pkm_rig.rig.clock import RigClock

REST_PERIOD_S = 0.5
MOTION_PERIOD_S = 0.05
LEAST_HOST_PERIOD_S = 0.01
BEAT_PERIOD_S = 0.25
LEAST_HOST_STALE_S = 2.0  # a momentarily busy computer is not a reason to distrust the rig
STALE_POLLS = 6  # polls that may be missed before a value counts as old


class Supervisor:
    """Polls on the rig clock's own thread: every `poll_period_s` where one is given (time scale 1), else 2 Hz at rest
    and 20 Hz while anything moves.

    With scaled time a period is never shorter than 10 ms of host time, and what was read counts as old only
    after 2 s of it. `beat` sends our heartbeat, by which the drives watch us: it comes from here because a program
    that does not supervise any more must not keep the drives going.
    """

    def __init__(
        self,
        plc: Plc,
        drives: DriveGroup,
        clock: RigClock,
        required: tuple[str, ...],
        on_payload: Callable[[int | None], None],
        time_scale: float | None = None,
        beat: Callable[[], None] = lambda: None,
        poll_period_s: float | None = None,
    ) -> None:
        self._plc = plc
        self._drives = drives
        self._clock = clock
        self._required = required
        self._on_payload = on_payload
        self._slow = time_scale or 1.0
        self._poll_period_s = poll_period_s
        self._least_s = LEAST_HOST_PERIOD_S * time_scale if time_scale else 0.0
        self._least_stale_s = LEAST_HOST_STALE_S * (time_scale or 1.0)
        self._lock = threading.Lock()
        self._chain = 0
        self._running = False
        self._moving = False
        self._state: PlcState | None = None
        self._payload: int | None = None
        self._trip: DeviceError | None = None
        self._loading = False
        self.needs_release = False
        self._beat = beat
        self._beaten_s = -math.inf
        self.polls = 0

    @property
    def trip(self) -> DeviceError | None:
        """What stopped the drives, if anything did."""
        return self._trip

    @property
    def last_state(self) -> PlcState | None:
        """What the PLC said last, however old, also after a trip: to be shown, not to act on."""
        return self._state

    def look(self) -> PlcState:
        """Poll now, and the PLC's values of this poll; raises what it found."""
        self._poll()
        return self.state()

    def order_stop(self, error: DeviceError) -> None:
        """Stop all drives because somebody wants it, from any thread, without waiting for a poll under way."""
        self._stop_all(error)

    def start(self) -> None:
        """Poll once, then keep polling; raises what the first poll found."""
        self._running = True
        self._poll()
        if self._trip is not None:
            raise self._trip
        self._schedule()

    def stop(self) -> None:
        """Poll no more."""
        self._running = False

    def state(self) -> PlcState:
        """The PLC's values of the last poll; raises the trip, so that no stale value is ever used."""
        if self._trip is not None:
            raise self._trip
        state = self._state
        if state is None:
            raise InterlockOpen("PLC", "supervision", "nothing read yet", "start supervision first")
        age_s = self._clock.now_s() - state.t_rig_s
        if not 0.0 <= age_s <= max(STALE_POLLS * self._period_s(), self._least_stale_s):
            raise StaleData("PLC", "supervision", f"last read {age_s:.1f} s ago", "check the PLC's connection")
        return state

    def require_good(self) -> None:
        """Raise if the drives were stopped, nothing has been read yet or what was read is old."""
        self.state()

    @contextmanager
    def during_motion(self) -> Iterator[None]:
        """A motion: interlocks are read afresh before it and polled fast during it."""
        self._poll()
        self.require_good()
        if self._payload is None:
            raise InterlockOpen("PLC", "payload", "it is being changed", "wait until the PLC reports it")
        self._moving = True
        self._schedule()
        try:
            yield
        finally:
            self._moving = False

    @contextmanager
    def during_payload_change(self) -> Iterator[None]:
        """The payload is being changed; the caller has taken the power off the drives.

        Interlocks may be open meanwhile, heartbeats must be alive.
        """
        self._loading = True
        try:
            yield
        finally:
            self._loading = False

    def interlocks_good(self) -> bool:
        """Whether all interlocks were good at the last poll; raises the trip."""
        return not self.state().open_interlocks()

    def _schedule(self) -> None:
        """Start a new chain of polls; one that is under way ends at its next tick."""
        self._chain += 1
        chain = self._chain

        def tick(due_s: float) -> None:
            if self._running and chain == self._chain:
                self._poll()
                if chain == self._chain:
                    wait_for(max(due_s + self._period_s(), self._clock.now_s()))

        def wait_for(due_s: float) -> None:
            self._clock.call_at(due_s, lambda: tick(due_s))

        wait_for(self._clock.now_s() + self._period_s())

    def _period_s(self) -> float:
        if self._poll_period_s is not None:
            return self._poll_period_s
        return max(MOTION_PERIOD_S if self._moving else REST_PERIOD_S, self._least_s)

    def _poll(self) -> None:
        with self._lock:
            self._send_heartbeat()
            if self._trip is not None:
                return
            try:
                self._check()
            except DeviceError as error:
                self._stop_all(error)
            except Exception as error:  # whatever it is: supervision must not end in silence
                self._stop_all(
                    DeviceError(
                        "supervision", "poll", f"{type(error).__name__}: {error}", "report it; then start again"
                    )
                )

    def _send_heartbeat(self) -> None:
        """Also after a trip: the drives stand already, and their own alarm would hide its cause."""
        now_s = self._clock.now_s()
        if not 0.0 <= now_s - self._beaten_s < BEAT_PERIOD_S * self._slow:
            self._beaten_s = now_s
            with suppress(DeviceError):  # the poll that follows finds the lost line
                self._beat()

    def _check(self) -> None:
        self.polls += 1
        self._drives.line.require_only_master()
        state = self._plc.read()
        if self._loading:  # the drives are without power: whoever loads the platform may open the guard
            replace(state, interlocks={}).require_safe()
        else:
            state.require_safe()
            self._require_release(state)
        missing = [name for name in self._required if name not in state.interlocks]
        if missing:
            raise PlcError("PLC", "register map", f"no interlock '{missing[0]}'", "correct the rig file")
        for drive in self._drives.drives:
            drive.check()
        if self._state is None or state.payload != self._payload:
            if self._moving and self._state is not None:
                raise PlcError("PLC", "payload", "the payload changed during a motion", "check the platform")
            self._payload = state.payload
            self._on_payload(state.payload)
        self._state = state

    def _require_release(self, state: PlcState) -> None:
        if self.needs_release and not state.local_release:
            raise InterlockOpen(
                self._plc.name, state.where, "the local release is withdrawn", "turn the key at the machine, then start"
            )

    def _stop_all(self, error: DeviceError) -> None:
        self._trip = self._trip or error  # a stop that somebody ordered stays the cause
        with suppress(DeviceError):
            self._drives.stop_all(str(error))
