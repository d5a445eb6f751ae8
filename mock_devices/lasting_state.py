"""What of a mock rig outlives it: a file from which a mock that was killed comes back as hardware would.

Banks, limits and positions of the drives, the payload on the platform, the station's place and settings, and the time.
What a device forgets without power is not in it: the drives' mode, the reference of incremental encoders, operating
states. Nor are the histories of effects with a memory: they begin anew.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from mock_devices.clock import RigClock

MOST_BYTES = 10_000_000
Increments = Annotated[float, Field(allow_inf_nan=False, ge=-(2**40), le=2**40)]
Metres = Annotated[float, Field(allow_inf_nan=False, ge=-1000.0, le=1000.0)]
Hex = Annotated[str, Field(pattern="^([0-9a-f]{2})*$", max_length=1_000_000)]
Number = Annotated[float, Field(allow_inf_nan=False)]
Seconds = Annotated[float, Field(allow_inf_nan=False, ge=0.0, le=1e12)]


class LastingStateError(ValueError):
    """The file is not the state of this mock rig; one line."""


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class DriveState(_Part):
    """A drive: what its encoder counts and how far that is from the true position, banks, limits, in increments."""

    count_inc: Increments
    shift_inc: Increments = 0.0
    referenced: bool = True
    active_bank: Annotated[int, Field(ge=0, le=2)] = 0
    images: tuple[Hex, Hex] = ("", "")
    limits: dict[str, int] = {}
    swaps: Annotated[int, Field(ge=0, le=10_000)] = 0


class StationState(_Part):
    """The station's settings, and how it was moved since it was set up: metres in the machine's frame, radians."""

    prism_type: int = 0
    prism_constant_m: Metres = 0.0
    edm_mode: int = 2
    wavelength_m: Number = 0.658e-6
    pressure_hpa: Number = 1013.25
    dry_c: Number = 12.0
    wet_c: Number = 8.0


class Knock(_Part):
    """What a column has suffered: radians by which it leans, metres by which it stands farther along x."""

    drive: Annotated[str, Field(max_length=100)]
    lean_rad: Annotated[float, Field(allow_inf_nan=False, ge=-0.1, le=0.1)]
    shift_m: Annotated[float, Field(allow_inf_nan=False, ge=-0.1, le=0.1)] = 0.0


class PlantState(_Part):
    """What is on the platform, how often each pair of targets was measured at (by which noise is drawn), knocks."""

    payload: Annotated[int, Field(ge=0)] = 0
    exchanges: Annotated[int, Field(ge=0)] = 0
    visits: tuple[tuple[tuple[int, ...], int], ...] = ()
    station_moved_m: tuple[Metres, Metres, Metres] = (0.0, 0.0, 0.0)
    station_turned_rad: Number = 0.0
    knocks: tuple[Knock, ...] = ()


class RigState(_Part):
    """A mock rig. `t_utc_s` is the Unix time at which its rig time was `t_rig_s`."""

    format: Literal[1] = 1
    machine: str
    seed: int
    t_rig_s: Seconds = 0.0
    t_utc_s: Seconds = 0.0
    drives: dict[int, DriveState] = {}
    plant: PlantState | None = None
    station: StationState | None = None

    def time_now_s(self, t_utc_s: float, time_scale: float) -> float:
        """Rig time at a later Unix time; it never goes back."""
        return self.t_rig_s + max(0.0, t_utc_s - self.t_utc_s) * time_scale


def read_state(path: Path) -> RigState | None:
    """The state in a file, None if there is no such file. Raises LastingStateError in one line, or OSError."""
    if not path.exists():
        return None
    if not path.is_file() or path.stat().st_size > MOST_BYTES:
        raise LastingStateError(f"{path}: not a state file of ours; name another one")
    try:
        return RigState.model_validate_json(path.read_bytes())
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise LastingStateError(
            f"{path}: not a state of a mock rig: {f'{where}: ' if where else ''}{first['msg']}; name another file"
        ) from None


class StateFile:
    """Keeps the state of a running mock rig in a file: whole at any time, whatever ends the process.

    Parts are told by `keep`; it takes no other lock, so that a device may call it with its own held.
    """

    def __init__(self, path: Path, state: RigState, clock: RigClock, utc_s: Callable[[], float]) -> None:
        self.path = path
        self._state = state
        self._clock = clock
        self._utc_s = utc_s
        self._lock = threading.Lock()

    @property
    def state(self) -> RigState:
        """What was told last."""
        return self._state

    def keep_drive(self, node_id: int, drive: DriveState) -> None:
        """A drive's part."""
        with self._lock:
            self._state = self._state.model_copy(update={"drives": {**self._state.drives, node_id: drive}})

    def keep(self, **parts: Any) -> None:
        """Other parts by name: `plant`, `station`."""
        with self._lock:
            self._state = self._state.model_copy(update=parts)

    def write(self) -> None:
        """Write all that was told, durable when this returns. Raises OSError."""
        with self._lock:
            now = {"t_rig_s": self._clock.now_s(), "t_utc_s": self._utc_s()}
            self._state = self._state.model_copy(update=now)
            beside = self.path.with_name(f"{self.path.name}.new")
            with beside.open("wb") as file:
                file.write(self._state.model_dump_json().encode())
                file.flush()
                os.fsync(file.fileno())
            os.replace(beside, self.path)
            folder = os.open(self.path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)
