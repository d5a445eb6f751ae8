"""One connected rig: station, drives and PLC behind one set of verbs, mock or real alike."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from calibration.base.arrays import Array
from calibration.base.frame import Frame, station_frame
from calibration.compensation.tables import CompensationTable
from calibration.machine.description import Machine
from drivers.drives.cia402 import CYCLIC_POSITION
from drivers.drives.drive_group import DriveGroup
from drivers.drives.table_bank import CompensationMode, CompensationState, TableBank
from drivers.drives.table_group import bring_to, switch_off, use_on_trial
from drivers.drives.table_image import TableImage, encode_table
from drivers.errors import DeviceError, PlcError, Stopped, TableError
from drivers.plc.plc import Plc
from drivers.station.laser_tracker import LaserTracker
from pkm_rig.rig.clock import RigClock
from pkm_rig.rig.config import PART_SENSORS, RigFile
from pkm_rig.rig.led_motion import is_led
from pkm_rig.rig.led_rows import ROUND_OFF, PathOrder, led_rows
from pkm_rig.rig.observer import Observer, Unobserved
from pkm_rig.rig.operator import Nobody, Operator
from pkm_rig.rig.station_air import StationAir
from pkm_rig.rig.supervision import Supervisor
from pkm_rig.rig.table_images import table_images
from pkm_rig.rig.unread_drives import UnreadDrives

PLC_POLL_S = 1.0


class Rig:
    """Everything that is connected, and what a campaign asks of it.

    All methods that move or write need supervision to be good and raise its trip otherwise.
    """

    def __init__(
        self,
        file: RigFile,
        machine: Machine,
        clock: RigClock,
        station: LaserTracker,
        drives: DriveGroup,
        banks: Sequence[TableBank],
        plc: Plc,
        poll_period_s: float | None = None,
    ) -> None:
        self.file = file
        self.machine = machine
        self.clock = clock
        self.station = station
        self.drives = drives
        self.banks = tuple(banks)
        self.plc = plc
        self.sensors = PART_SENSORS
        self.extra_columns = file.plc.extra_columns()
        self.compensation = 0
        self.host: Callable[[Array], Array] | None = None  # corrections (n, d) at platform poses (n, 6), of its targets
        self.path: Path | None = None  # of its rig file, where there is one
        self._poll_period_s = poll_period_s
        self._air = StationAir(station, clock, file.limits.atmosphere_age_s, file.limits.atmosphere_ppm)
        self.needs_release = False
        self._stop_order: Stopped | None = None
        self.supervisor = self.new_supervisor()
        self.operator: Operator = Nobody()
        self.observer: Observer = Unobserved()

    def new_supervisor(self) -> Supervisor:
        """Supervision that has not been started: one that has tripped stays so."""
        file, drives = self.file, self.drives
        supervisor = Supervisor(
            self.plc,
            drives,
            self.clock,
            file.limits.interlocks,
            self._payload_changed,
            file.time_scale,
            beat=lambda: drives.line.send_heartbeat(file.can.master_node_id),
            poll_period_s=self._poll_period_s,
        )
        supervisor.needs_release = self.needs_release
        if self._stop_order is not None:
            supervisor.order_stop(self._stop_order)
        return supervisor

    def order_stop(self, why: str) -> None:
        """Stop all drives now, for good: whatever this connection is used for ends with Stopped. From any thread."""
        self._stop_order = Stopped("drives", self.drives.line.name, why, "go on when the machine may move again")
        with self.clock.activity():
            self.supervisor.order_stop(self._stop_order)

    @property
    def simulated_devices(self) -> tuple[str, ...]:
        """Names of the devices that say by their identity that they are simulated."""
        station, drives = self.station, self.drives.drives
        out = [station.name] if station.identity is not None and station.identity.simulated else []
        out += [f"drive {drive.name}" for drive in drives if drive.identity is not None and drive.identity.simulated]
        return (*out, *([self.plc.name] if self.supervisor.state().simulated else []))

    @contextlib.contextmanager
    def supervised_without_power(self) -> Iterator[int | None]:
        """The drives stand without power, and interlocks may be open meanwhile; gives the payload that is on.

        Supervision that has tripped begins anew. Raises what it finds beside interlocks.
        """
        before = self.supervisor
        if before.trip is not None:
            before.stop()
            self.supervisor = self.new_supervisor()
        with self.supervisor.during_payload_change():
            if self.supervisor is not before:
                self.supervisor.start()
            self.drives.disable()
            yield self.supervisor.state().payload

    # --- motion

    @property
    def moved_by_control(self) -> bool:
        """Whether the machine's own control moves it: nothing is commanded then, and no drive is read."""
        return isinstance(self.drives, UnreadDrives)

    @property
    def led(self) -> bool:
        """Whether its drives are led along paths by SYNC."""
        return is_led(self.machine, self.file.campaign)

    def enable(self) -> None:
        """Power the drives; supervision must be good. Led ones are set to cyclic synchronous position mode before."""
        self.supervisor.require_good()
        if self.led and any(drive.mode != CYCLIC_POSITION for drive in self.drives.drives):
            for drive, entry in zip(self.drives.drives, self.file.drives, strict=True):
                if entry.torque_limit_ratio is not None:
                    drive.set_torque_limit(entry.torque_limit_ratio)
            self.drives.disable()
            self.drives.set_cyclic_position(self.file.can.sync_period_s)
        self.drives.enable()

    def stop(self, reason: str) -> None:
        """Stop all drives together, now."""
        self.drives.stop_all(reason)

    def move(self, drives_m: Array, speed_m_per_s: float) -> None:
        """Move all drives together to commanded positions (d,) and wait until they have settled."""
        self.require_one_correction()
        with self.supervisor.during_motion():
            self.drives.move_to([float(q) for q in drives_m], speed_m_per_s, self.file.campaign.acceleration_m_per_s2)

    def lead(self, commanded: Array, speed_m_per_s: float, correction: Array | None = None) -> None:
        """Lead all drives along a path to commanded coordinates (k,) of the tool and wait until they have settled.

        correction (d,): what is added to the nominal drive coordinates there, if not what the host's correction says.
        Raises InputError before anything moves.
        """
        campaign, payload = self.file.campaign, self.supervisor.state().payload
        load = self.file.payloads[payload or 0]
        order = PathOrder(
            speed_m_per_s=speed_m_per_s,
            acceleration_m_per_s2=campaign.acceleration_m_per_s2,
            period_s=self.file.can.sync_period_s,
            payload_kg=load.mass_kg,
            payload_com_m=load.com_m,
            corrections=self.host,
            correction=correction,
            limits=np.array([drive.limits_m for drive in self.drives.drives]),
        )
        self.require_one_correction()
        with self.supervisor.during_motion():
            demand = np.array([sample.demand_m for sample in self.drives.sample()])
            rows = led_rows(self.machine, demand, commanded, order)
            fastest = float(np.abs(np.diff(rows, axis=0)).max(initial=0.0)) / order.period_s
            cranks = bool(self.machine.rotary_drives)  # in rad/s: not the speed's unit
            self.drives.follow(rows.tolist(), (fastest if cranks else speed_m_per_s) * (1.0 + 2.0 * ROUND_OFF))
            self.clock.sleep_s(self.drives.rest.hold_s)

    def require_one_correction(self) -> None:
        """Raise TableError where the host corrects and a drive has a table of its own on: both would act."""
        if self.host is None:
            return
        for bank in self.banks:
            if bank.mode() is not CompensationMode.OFF:
                raise TableError(
                    bank.drive.name, bank.drive.where, "its own table is on: both would correct",
                    "switch it off with `pkm-rig tables off`",
                )  # fmt: skip

    def positions_m(self) -> Array:
        """Actual drive positions (d,), sampled at one SYNC."""
        return np.array([sample.position_m for sample in self.drives.sample()])

    def wait(self, duration_s: float) -> None:
        """Let rig time pass; raises as soon as supervision has stopped the drives."""
        end_s = self.clock.now_s() + duration_s
        while (left_s := end_s - self.clock.now_s()) > 0.0:
            self.supervisor.require_good()
            self.clock.sleep_s(min(left_s, PLC_POLL_S))
        self.supervisor.require_good()

    # --- payload

    def change_payload(self, number: int, *, enable: bool = True) -> None:
        """Ask for a payload and wait until the PLC reports it and all interlocks are good again.

        The drives are without power meanwhile, so that whoever loads the platform may open the guard; they stay so
        without `enable`.
        """
        if self.supervisor.state().payload == number:
            return
        self.drives.disable()
        end_s = self.clock.now_s() + self.file.campaign.payload_timeout_s
        with self.supervisor.during_payload_change():
            self.plc.request_payload(number, self.file.campaign.payload_timeout_s, watch=self.supervisor.require_good)
            while self.supervisor.state().payload != number or not self.supervisor.interlocks_good():
                if self.clock.now_s() > end_s:
                    raise PlcError(
                        "PLC", "interlocks", "not all good again after the payload was changed", "close the guard"
                    )
                self.clock.sleep_s(PLC_POLL_S)
        if enable:
            self.enable()

    def payload_mass_kg(self, number: int | None) -> float | None:
        """Mass of a payload of the rig's list; None while it is unknown."""
        if number is None:
            return None
        if number >= len(self.file.payloads):
            raise PlcError(
                "PLC", "payload", f"payload {number} is reported, the rig file lists {len(self.file.payloads)}",
                "correct [[payloads]] or the PLC",
            )  # fmt: skip
        return self.file.payloads[number].mass_kg

    def _payload_changed(self, number: int | None) -> None:
        """Tell the drives at once: a table for another payload is then invalid and motion refused."""
        mass_kg = self.payload_mass_kg(number)
        for bank in self.banks:
            bank.set_payload(mass_kg)

    # --- compensation

    def compensate(self, images: Sequence[TableImage] | None) -> list[CompensationState]:
        """Use these tables on trial, or none, and power the drives again.

        Raises TableError, after switching off again, if a table does not fit the payload that is on.
        """
        self.switch_compensation(images)
        states = [bank.state() for bank in self.banks]
        for bank, state in zip(self.banks, states, strict=True):
            if images is not None and not state.valid:
                self.switch_compensation(None)
                raise TableError(
                    bank.drive.name, bank.drive.where, "the active table does not fit the payload that is on",
                    "compute a table for this payload",
                )  # fmt: skip
        self.enable()
        return states

    def switch_compensation(self, images: Sequence[TableImage] | None) -> None:
        """Write tables into all drives and use them on trial together, or switch compensation off (None).

        Leaves the drives without power. A table becomes active whole and read back, on all drives or on
        none: after any failure compensation is off everywhere and the cause is raised.
        """
        self.compensation, self.host = 0, None
        try:
            self.drives.disable()
        finally:
            switch_off(self.banks)
        if images is None:
            return
        if not self.banks:
            raise TableError("drives", "profile", "these drives have no table bank", "measure and identify only")
        use_on_trial(self.banks, [encode_table(image) for image in images], self.trial_timeout_s)
        self.compensation = images[0].generation

    def bring_tables_to(self, images: Sequence[bytes | None], *, on: bool) -> None:
        """Have these images active on the drives, used for good or not at all; leaves the drives without power.

        After any failure compensation is off on every drive that can be reached, and the cause is raised.
        """
        self.compensation, self.host = 0, None
        try:
            self.drives.disable()
            bring_to(self.banks, images, self.trial_timeout_s, on=on)
        except BaseException:
            with contextlib.suppress(DeviceError):
                switch_off(self.banks)
            raise

    @property
    def trial_timeout_s(self) -> float:
        """For how long we may stay away from drives with tables on trial; rig time."""
        return self.file.limits.trial_timeout_s * (self.file.time_scale or 1.0)

    def next_generation(self) -> int:
        """A generation above that of every bank."""
        return max((bank.state().next_generation for bank in self.banks), default=1)

    def images(self, table: CompensationTable, generation: int) -> list[TableImage]:
        """A table as images, one a drive."""
        return table_images(self.file, self.machine, table, generation)

    # --- context

    def rough_frame(self) -> Frame:
        """The station's frame from its rough place in the rig file."""
        entry = self.file.station
        return station_frame(entry.position_m, entry.heading_rad, self.machine.gravity_m_per_s2)

    def temperatures_c(self) -> dict[str, float]:
        """Temperatures of the machine's sensors, now."""
        state = self.supervisor.state()
        return {name: state.temperatures_c[name] for name in self.machine.sensors.values()}

    def refresh_atmosphere(self) -> None:
        """Give the PLC's air to the station now.

        Raises what the station raises, and supervision's trip rather than use a stale value.
        """
        self._air.apply(self.supervisor.state())

    def refresh_atmosphere_if_stale(self) -> None:
        """The same, but only where what the station holds is old or not the air any more (`[limits]`)."""
        self._air.apply_if_stale(self.supervisor.state())
