"""Starts a mock rig in this process; `served_rig` starts one for others. No other modules import `mock_devices`.

What comes out is a rig file with the mock's addresses filled in; everything after that is the same as on hardware.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import can

from calibration.base.errors import InputError
from calibration.machine.description import load_machine
from calibration.recording.header import AccuracyEntry
from mock_devices.can.faulty_bus import FaultyBus
from mock_devices.effects import EffectChoice
from mock_devices.faults import FAULTS, FaultPlan, parse_fault
from mock_devices.plant.any_plant import is_planar_slider_machine, parse_effect
from mock_devices.plant.history_plant import HistoryPlant
from mock_devices.plant.plant import Plant, Sighting
from mock_devices.plant.spatial_plant import SpatialPlant
from mock_devices.plant.thermal import SENSORS
from mock_devices.plc.plc_registers import check_readings
from mock_devices.rig import MockRig
from mock_devices.settings import DisturbanceLevels, InstrumentProfile, MockSettings, Payload, PlcReading
from mock_devices.stepped_clock import SteppedClock
from pkm_rig.rig.clock import RigClock, ScaledClock, VirtualClock
from pkm_rig.rig.config import MockSection, RigFile, embedded_rig_path, machine_path
from pkm_rig.rig.device_sections import ReadingEntry
from pkm_rig.virtual.embedded_bus import EmbeddedBus
from pkm_rig.virtual.twin_files import MACHINE_NAME, read_twin
from pkm_rig.virtual.twin_rig import InstantState, ReflectorModel, RunningTwin

_channels = itertools.count()


@dataclass
class Embedded:
    """A mock rig in this process: connect to `file` with `bus_factory`, on `clock`."""

    file: RigFile
    clock: RigClock
    bus_factory: Callable[[], can.BusABC]
    mock: MockRig


def with_mock_options(file: RigFile, seed: int | None, effects: Sequence[str]) -> RigFile:
    """The rig file with another mock machine, if a seed is given, and with more effects."""
    section = file.mock or MockSection()
    changed: dict[str, object] = {"effects": (*section.effects, *effects)}
    if seed is not None:
        changed["seed"] = seed
    return file.model_copy(update={"mock": section.model_copy(update=changed)})


def settings_of(file: RigFile, rig_path: Path | None = None) -> MockSettings:
    """What the mock may know of the rig file: payloads, the station's stated accuracy, its place, seed and effects.

    InputError in one line if an effect cannot be; a machine file of the rig's own needs `rig_path`.
    """
    mock = file.mock or MockSection()
    accuracy = file.station.accuracy
    try:
        return _settings(file, mock, accuracy, chosen_effects(file, rig_path))
    except ValueError as error:  # EffectError is one
        raise InputError(f"mock: {error}") from None


def chosen_effects(file: RigFile, rig_path: Path | None) -> tuple[EffectChoice, ...]:
    """The effects of the rig file as the mock plant takes them; raises ValueError in one line."""
    texts = (file.mock or MockSection()).effects
    if not texts:
        return ()
    machine = machine_path(file, rig_path or embedded_rig_path())
    return tuple(parse_effect(text, machine) for text in texts)


def _settings(
    file: RigFile, mock: MockSection, accuracy: AccuracyEntry, effects: tuple[EffectChoice, ...]
) -> MockSettings:
    return MockSettings(
        effects=effects,
        nuisance=DisturbanceLevels(**mock.nuisance.model_dump()),
        noise_tails=mock.noise_tails,
        temperature_sensor_bias_k=mock.temperature_sensor_bias_k,
        temperature_programme=mock.temperature_programme,
        steady_temperatures=mock.steady_temperatures,
        plc_readings=_plc_readings(file.plc.readings),
        absolute_encoders=mock.encoders == "absolute",
        seed=mock.seed,
        error_scale=mock.error_scale,
        payloads=tuple(
            Payload(name=p.name, mass_kg=p.mass_kg, com_m=p.com_m, u_mass_kg=p.u_mass_kg, u_com_m=p.u_com_m)
            for p in file.payloads
        ),
        instrument=InstrumentProfile(
            angle_sd_rad=accuracy.angle_sd_rad,
            range_sd_m=accuracy.range_sd_m,
            range_constant_u_m=accuracy.range_constant_u_m,
            range_scale_u=accuracy.range_scale_u,
            drift_about_vertical_rad=accuracy.drift_rad_per_sqrt_h,
            drift_of_level_rad=accuracy.drift_of_level_rad_per_sqrt_h,
            drift_m=accuracy.drift_m_per_sqrt_h,
        ),
        station_position_m=file.station.position_m,
        station_heading_rad=file.station.heading_rad,
    )


def _plc_readings(entries: Sequence[ReadingEntry]) -> tuple[PlcReading, ...]:
    readings = tuple(_plc_reading(entry) for entry in entries)
    check_readings(readings)
    return readings


def _plc_reading(entry: ReadingEntry) -> PlcReading:
    """A further register of the PLC as the mock serves it: a temperature of the base."""
    if entry.type not in ("f32", "i16") or entry.order != "ABCD":
        raise ValueError(f"plc.readings: {entry.name}: the mock PLC has f32 and i16, high word first, only")
    return PlcReading(entry.name, entry.address, type=entry.type, scale=entry.scale)


@contextmanager
def embedded_mock_rig(
    file: RigFile,
    rig_path: Path,
    *,
    real_time: bool = False,
    start_s: float = 0.0,
    faults: FaultPlan | None = None,
    without_blocks: tuple[int, ...] = (),
    twin: TwinFiles | None = None,
) -> Iterator[Embedded]:
    """Start the embedded mock rig: virtual time, or time scale 1 with `real_time`; `twin`: one to serve.

    It begins at rig time `start_s`: temperatures and drift are those of the same machine at that time.
    With `faults` the host's bus and clock can be struck as well. The nodes in `without_blocks` know no block transfer.
    """
    clock: RigClock = ScaledClock(1.0, start_s) if real_time else VirtualClock(start_s)
    channel = f"embedded-{next(_channels)}"

    def bus() -> can.BusABC:
        return EmbeddedBus(channel, clock)

    def host_bus() -> can.BusABC:
        return bus() if faults is None else FaultyBus(bus(), faults)

    try:
        with MockRig(
            machine_path(file, rig_path),
            replace(settings_of(file, rig_path), start_s=start_s),
            clock,
            bus,
            without_blocks=without_blocks,
            faults=faults or FaultPlan(),
            plant=None if twin is None else twin_plant(file, rig_path, twin, clock),
        ) as mock:
            host, port = mock.plc_address
            rig_file = file.model_copy(
                update={
                    "station": file.station.model_copy(update={"port": mock.station_url}),
                    "plc": file.plc.model_copy(update={"host": host, "port": port}),
                }
            )
            yield Embedded(rig_file, clock if faults is None else SteppedClock(clock, faults), host_bus, mock)
    finally:
        clock.close()


@dataclass(frozen=True)
class TwinFiles:
    """A twin's folder, and files of the user-defined effects that it needs."""

    folder: Path
    effects: tuple[Path, ...] = ()


class TwinSight(HistoryPlant):
    """A plant whose reflectors are where a twin places them; the rest is the mock rig's.

    Its `truth` is that of the mock machine, not the twin's: it must not be used for scoring.
    """

    twin: RunningTwin

    def sightings(self, t_s: float) -> list[Sighting]:
        """All reflectors as the station sees them at rig time `t_s`, in the order of the machine file."""
        with self._lock:
            places = self.twin.places_m(self._instant_state(t_s))
        return [
            Sighting(i, smr.name, self.view.polar((float(x), float(y), float(z)), t_s))
            for i, (smr, (x, y, z)) in enumerate(zip(self.machine.smrs, places, strict=True))
        ]

    def _instant_state(self, t_s: float) -> InstantState:
        now = self.motion_state(t_s)
        load = self.settings.payloads[self.payload]
        return InstantState(
            t_s=t_s,
            drives_m=now.q_m[0],
            velocity_m_per_s=now.velocity_m_per_s[0],
            direction=now.direction[0],
            torque=self.torque_at_rest(),
            highest_speed_since=self._highest_speed_since,
            arrived_s=float(now.leg_end_s.max()),
            moving=self.is_moving(),
            payload_kg=load.mass_kg,
            payload_com_m=load.com_m,
            exchanges=int(now.exchanges[0]),
        )

    def _highest_speed_since(self, t_s: float) -> float:
        legs = [leg for a in range(len(self.parts)) for leg in self.legs(a) if leg.start_s > t_s]
        return max((leg.speed_m_per_s for leg in legs), default=0.0)


class TwinPlant(TwinSight, Plant):
    """That of a planar machine with two sliders."""

    def __init__(self, machine: Path, settings: MockSettings, clock: RigClock, twin: ReflectorModel) -> None:
        super().__init__(machine, settings, clock)
        self.twin = RunningTwin(twin, SENSORS, self.thermal.sensor_series_c)


class SpatialTwinPlant(TwinSight, SpatialPlant):
    """That of any other machine; its reflectors are seen from everywhere, and cranks keep their unit, the radian."""

    def __init__(self, machine: Path, settings: MockSettings, clock: RigClock, twin: ReflectorModel) -> None:
        super().__init__(machine, settings, clock)
        self.twin = RunningTwin(twin, SENSORS, self.thermal.sensor_series_c)

    @property
    def metres(self) -> float:
        """Drives in their own units: a twin asks for these."""
        return 1.0


def twin_plant(file: RigFile, rig_path: Path, files: TwinFiles, clock: RigClock) -> TwinSight:
    """The plant of a twin's folder in place of the rig file's mock machine; InputError if it is of another machine."""
    folder = files.folder
    twin, machine = read_twin(folder, files.effects), machine_path(file, rig_path)
    ours, theirs = load_machine(machine), load_machine(folder / MACHINE_NAME)
    for what, here, there in (
        ("drives", ours.drive_names, theirs.drive_names),
        ("reflectors", tuple(s.name for s in ours.smrs), tuple(s.name for s in theirs.smrs)),
    ):
        if here != there:
            raise InputError(
                f"{folder}: its {what} {', '.join(there)} are not the rig file's {', '.join(here)}; give its own --rig"
            )
    if (file.mock or MockSection()).effects:
        raise InputError(f"{folder}: a twin has its own effects; leave out --effect and [mock] effects")
    kind = TwinPlant if is_planar_slider_machine(machine) else SpatialTwinPlant
    return kind(machine, settings_of(file, rig_path), clock, twin)


def fault_plan(faults: Sequence[str]) -> FaultPlan:
    """Faults by NAME@N. Raises InputError in one line."""
    try:
        return FaultPlan(parse_fault(text) for text in faults)
    except ValueError as error:
        raise InputError(f"--fault: {error}") from error


def fault_list() -> list[str]:
    """Each fault's name, what counts as its operations and what it does."""
    width = max(len(name) for name in FAULTS)
    return [
        f"{name:{width}}  at the Nth {kind.operation}{' and from then on' if kind.lasting else ''}: {kind.what}"
        for name, kind in FAULTS.items()
    ]
