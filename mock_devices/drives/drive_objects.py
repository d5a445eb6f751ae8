"""The object dictionary of a mock drive: what each CiA 402 and compensation object reads and writes.

Objects that are only stored (identity, factors, PDO descriptions) are left to canopen and the EDS.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

from mock_devices.can.node_watch import ErrorHistory, HeartbeatConsumer, error_register
from mock_devices.can.sdo_abort import STATE_FORBIDS, VALUE_RANGE, RefusedWrite
from mock_devices.drives.drive_axis import CYCLIC_POSITION, DriveAxis
from mock_devices.drives.table_bank import Bank
from mock_devices.drives.trial import Trial

METRES_PER_INCREMENT = 1.0e-8
# Objects that outlive a restart: limits of the axis, banks and which of them is chosen.
LASTING = frozenset({0x2100, 0x2101, 0x2102, 0x6065, 0x6067, 0x607D, *range(0x6081, 0x6086)})
STORE_SIGNATURE, RESTORE_SIGNATURE = 0x65766173, 0x64616F6C  # "save" and "load"

_FEED_M = 0.010
_RATED_TORQUE_NM = 10.0
_FRICTION_N = 60.0
_GRAVITY_M_PER_S2 = 9.80665

Readers = dict[tuple[int, int], Callable[[], int | bytes]]


class DriveObjects:
    """Reads and writes by index and sub-index. `load_kg` is the mass that this drive carries."""

    def __init__(
        self,
        axis: DriveAxis,
        now_s: Callable[[], float],
        load_kg: Callable[[], float],
        set_heartbeat: Callable[[float], None],
        watch: HeartbeatConsumer,
        history: ErrorHistory,
        trial: Trial,
    ) -> None:
        self._axis = axis
        self._now_s = now_s
        self._load_kg = load_kg
        self._set_heartbeat = set_heartbeat
        self._watch = watch
        self._history = history
        self._trial = trial
        self._readers = self._make_readers()
        self._writers = self._make_writers()

    def read(self, index: int, subindex: int) -> int | bytes | None:
        """Value of an object, None if it is not one of these."""
        self._axis.refresh()
        reader = self._readers.get((index, subindex))
        return None if reader is None else reader()

    def write(self, index: int, subindex: int, value: Any) -> None:
        """Act on a written value. Raises RefusedWrite."""
        writer = self._writers.get((index, subindex))
        if writer is not None:
            writer(value)

    def _make_readers(self) -> Readers:
        axis, limits, comp, now = self._axis, self._axis.limits, self._axis.compensation, self._now_s
        homing = axis.homing
        readers: Readers = {
            (0x1001, 0): lambda: error_register(axis.error_code),
            (0x1003, 0): self._history.count,
            (0x1016, 1): lambda: self._watch.value,
            (0x6007, 0): lambda: axis.abort_connection_option,
            (0x603F, 0): lambda: axis.error_code,
            (0x6040, 0): lambda: axis.controlword,
            (0x6041, 0): axis.statusword,
            (0x6061, 0): lambda: axis.mode,
            (0x6062, 0): lambda: round(axis.demand_inc()),
            (0x6063, 0): lambda: round(axis.encoder_inc(now())),
            (0x6064, 0): lambda: round(axis.actual_inc()),
            (0x6065, 0): lambda: limits.following_error_window_inc,
            (0x606C, 0): lambda: round(axis.motion.command(now())[1]),
            (0x6072, 0): lambda: limits.max_torque_permille,
            (0x6077, 0): self._torque_permille,
            (0x607A, 0): lambda: axis.target_inc,
            (0x607D, 1): lambda: limits.low_inc,
            (0x607D, 2): lambda: limits.high_inc,
            (0x6081, 0): lambda: limits.speed,
            (0x6083, 0): lambda: limits.acceleration,
            (0x6084, 0): lambda: limits.deceleration,
            (0x6085, 0): lambda: limits.quick_stop_deceleration,
            (0x6067, 0): lambda: limits.position_window_inc,
            (0x60C2, 1): lambda: axis.cyclic.units,
            (0x60C2, 2): lambda: axis.cyclic.exponent,
            (0x60F4, 0): lambda: round(axis.motion.following_error(now())),
            (0x607C, 0): lambda: homing.offset_inc,
            (0x6098, 0): lambda: homing.method,
            (0x6099, 1): lambda: homing.speed,
            (0x6099, 2): lambda: homing.zero_speed,
            (0x609A, 0): lambda: homing.acceleration,
            (0x2103, 1): lambda: int(homing.referenced),
            (0x2100, 1): lambda: comp.mode,
            (0x2100, 3): lambda: comp.active_bank,
            (0x2100, 4): lambda: comp.table.crc if comp.table else 0,
            (0x2100, 5): lambda: comp.table.generation if comp.table else 0,
            (0x2100, 6): lambda: int(comp.valid),
            (0x2100, 7): lambda: comp.payload_g,
            (0x2100, 8): lambda: comp.partner.command_inc or 0,
            (0x2100, 12): lambda: comp.trial_ms,
        }
        for number in range(1, 9):
            readers[0x1003, number] = partial(self._history.code, number)
        for number, bank in comp.banks.items():
            readers |= _bank_readers(0x2100 + number, bank)
        return readers

    def _make_writers(self) -> dict[tuple[int, int], Callable[[Any], None]]:
        axis, comp, limits, homing = self._axis, self._axis.compensation, self._axis.limits, self._axis.homing
        return {
            (0x1003, 0): self._history.write_count,
            (0x1010, 1): _only_signature(STORE_SIGNATURE),
            (0x1011, 1): _only_signature(RESTORE_SIGNATURE),
            (0x1016, 1): self._watch.configure,
            (0x1017, 0): lambda ms: self._set_heartbeat(ms * 1.0e-3),
            (0x6007, 0): self._set_abort_connection_option,
            (0x6040, 0): axis.control,
            (0x6060, 0): axis.set_mode,
            (0x6065, 0): _make_setter(limits, "following_error_window_inc"),
            (0x6067, 0): _make_setter(limits, "position_window_inc"),
            (0x6072, 0): _make_setter(limits, "max_torque_permille"),
            (0x60C2, 1): axis.cyclic.set_units,
            (0x60C2, 2): axis.cyclic.set_exponent,
            (0x607A, 0): axis.set_target,
            (0x607D, 1): _make_setter(limits, "low_inc", positive=False),
            (0x607D, 2): _make_setter(limits, "high_inc", positive=False),
            (0x6081, 0): _make_setter(limits, "speed"),
            (0x6083, 0): _make_setter(limits, "acceleration"),
            (0x6084, 0): _make_setter(limits, "deceleration"),
            (0x6085, 0): _make_setter(limits, "quick_stop_deceleration"),
            (0x607C, 0): _make_setter(homing, "offset_inc", positive=False),
            (0x6098, 0): homing.set_method,
            (0x6099, 1): _make_setter(homing, "speed"),
            (0x6099, 2): _make_setter(homing, "zero_speed"),
            (0x609A, 0): _make_setter(homing, "acceleration"),
            (0x2100, 1): self._trial.set_mode,
            (0x2100, 2): lambda bank: comp.activate(bank, axis.powered),
            (0x2100, 7): self._set_payload,
            (0x2100, 8): comp.partner.hear,
            (0x2100, 12): comp.set_trial_ms,
            (0x2101, 1): lambda image: comp.write_bank(1, image),
            (0x2102, 1): lambda image: comp.write_bank(2, image),
        }

    def _set_abort_connection_option(self, option: int) -> None:
        if option not in (0, 1, 2, 3):
            raise RefusedWrite(VALUE_RANGE)
        self._axis.abort_connection_option = option

    def _set_payload(self, payload_g: int) -> None:
        self._axis.compensation.payload_g = payload_g
        self._axis.watch_motion()

    def beyond_torque(self) -> bool:
        """Whether the motor would have to give more torque than 0x6072 permits: it does not follow then."""
        return abs(self._torque_permille()) > self._axis.limits.max_torque_permille

    def _torque_permille(self) -> int:
        """Share of the weight, friction and acceleration, through a ball screw; in cyclic mode without acceleration,
        of which the steps from SYNC to SYNC say nothing."""
        if not self._axis.powered:
            return 0
        _, velocity, acceleration = self._axis.motion.command(self._now_s())
        if self._axis.mode == CYCLIC_POSITION:
            acceleration = 0.0
        load_kg = self._load_kg()
        force_n = load_kg * (_GRAVITY_M_PER_S2 + acceleration * METRES_PER_INCREMENT)
        force_n += math.copysign(_FRICTION_N, velocity) if velocity else 0.0
        torque_nm = force_n * _FEED_M / (2.0 * math.pi)
        return max(-32768, min(32767, round(1000.0 * torque_nm / _RATED_TORQUE_NM)))


def _bank_readers(index: int, bank: Bank) -> Readers:
    return {
        (index, 1): lambda: bank.image,
        (index, 2): lambda: bank.crc,
        (index, 3): lambda: bank.table.generation if bank.table else 0,
        (index, 4): lambda: bank.table.payload_g if bank.table else 0,
        (index, 5): lambda: int(bank.status),
    }


def _make_setter(settings: object, name: str, *, positive: bool = True) -> Callable[[int], None]:
    """What keeps a written value; one that has to be positive is refused otherwise."""

    def write(value: int) -> None:
        if positive and value <= 0:
            raise RefusedWrite(VALUE_RANGE)
        setattr(settings, name, value)

    return write


def _only_signature(signature: int) -> Callable[[int], None]:
    def write(value: int) -> None:
        if value != signature:
            raise RefusedWrite(STATE_FORBIDS)

    return write
