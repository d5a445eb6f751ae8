"""Campaigns for tests: the mock plant's, and ones of any shipped machine whose errors the test itself chooses."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calibration.base.frame import Frame, station_frame
from calibration.instruments.station_geometry import StationAccuracy, point_covariances, points_to_polar
from calibration.machine import equilibrium
from calibration.machine.description import Geometry, Machine, load_machine, shipped_machine
from calibration.machine.equilibrium import Conditions
from calibration.machine.inverse import nominal_drives
from calibration.model.parameters import ParameterSet
from calibration.recording.columns import rotary_quantity
from calibration.recording.header import RecordingFile
from calibration.recording.recording import Recording, make_recording
from mock_devices.effects import EffectChoice
from mock_devices.machine_file import read_machine_file
from mock_devices.recordings.design import Design, DesignOptions, draw_design
from mock_devices.recordings.maker import SimulatedCampaign
from mock_devices.settings import InstrumentProfile, MockSettings

PLANAR = shipped_machine("planar4")
STILL = InstrumentProfile(drift_about_vertical_rad=0.0, drift_of_level_rad=0.0, drift_m=0.0)
STATED = StationAccuracy(2.4e-6, 1.0e-4, 1.0e-4, 1.0e-6)
NOTHING = ("t_u_s", "prism_constant_m", "ppm", "payload", "payload_mass_kg", "compensation", "flags")
STATION_M = (0.3, -0.2, 4.0)


def example() -> str:
    """The Python file in docs/reference/effects.md."""
    text = (Path(__file__).parents[3] / "docs" / "reference" / "effects.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    return block


def plant(
    visits: int,
    *effects: EffectChoice,
    seed: int = 1,
    design: DesignOptions | None = None,
    exchange_s: float = Design.exchange_s,
    **settings,
) -> SimulatedCampaign:
    """The mock plant with a drawn campaign; its station does not drift. exchange_s: pauses between its payloads."""
    design = replace(design or DesignOptions(), visits=visits, poses=2 * visits // 3)
    drawn = draw_design(read_machine_file(PLANAR), np.random.default_rng(seed), design)
    drawn = replace(drawn, exchange_s=exchange_s)
    settings = {"instrument": STILL, "seed": seed, "effects": effects} | settings
    return SimulatedCampaign(PLANAR, MockSettings(**settings), drawn)


def recorded(bench: SimulatedCampaign) -> Recording:
    """What the rig would have written."""
    made = bench.record()
    columns = {n: c.astype(str) if c.dtype.kind in "US" else c.astype(np.float64) for n, c in made.columns.items()}
    return Recording(RecordingFile(**made.header), load_machine(PLANAR), columns)


def noise_free_m(bench: SimulatedCampaign) -> np.ndarray:
    """The same readings (n, 3) without noise: what is wrong with the station's ranges is in them."""
    quiet = replace(bench.settings.instrument, angle_sd_rad=1e-15, range_sd_m=1e-12)
    return recorded(SimulatedCampaign(PLANAR, replace(bench.settings, instrument=quiet), bench.timeline)).positions_m


@dataclass(frozen=True)
class Rest:
    """Poses (v) of a machine with some geometry, and where its reflectors are."""

    machine: Machine
    geometry: Geometry
    drives: np.ndarray
    at: Conditions
    rest: equilibrium.Equilibrium

    @classmethod
    def of(cls, machine, geometry, drives, at, start) -> Rest:
        rest = equilibrium.solve(machine, geometry, drives, at, start)
        assert np.all(rest.converged)
        return cls(machine, geometry, drives, at, rest)

    def again(self, geometry: Geometry | None = None, drives: np.ndarray | None = None) -> Rest:
        """The same with another geometry or other drive coordinates."""
        changed = (self.geometry if geometry is None else geometry, self.drives if drives is None else drives)
        return Rest.of(self.machine, *changed, self.at, self.rest.coordinates())

    def places_m(self, mounted_m: np.ndarray) -> np.ndarray:
        """Places (v, smrs, 3) in the machine's frame of reflectors mounted at (smrs, 3)."""
        carriers = equilibrium.carriers_of(self.machine, self.geometry, self.drives, self.at)
        out = np.empty((len(self.drives), len(mounted_m), 3))
        for i, (smr, point) in enumerate(zip(self.machine.smrs, mounted_m, strict=True)):
            if smr.on == "platform":
                lever = self.rest.rotation @ point * self.at.factors["platform"][:, None]
                out[:, i] = self.rest.position_m + lever
            else:
                out[:, i] = carriers[smr.drive].position(point).T if smr.on == "slider" else point
        return out


def drawn_geometry(machine: Machine, rng: np.random.Generator, share: float = 1.0) -> Geometry:
    """A machine within its tolerances."""
    parameters = ParameterSet.of(machine)
    return parameters.geometry(
        share * np.array([p.sigma for p in parameters.parameters]) * rng.standard_normal(len(parameters))
    )


def drawn_poses(machine: Machine, rng: np.random.Generator, visits: int) -> tuple[np.ndarray, np.ndarray]:
    """Commanded poses (v, 6) within four fifths of the workspace, and their drive coordinates (v, d)."""
    middle, half = machine.workspace.mean(axis=1), 0.4 * np.ptp(machine.workspace, axis=1)
    target = np.tile(middle, (visits, 1))
    c = machine.commanded
    target[:, c] += half[c] * rng.uniform(-1.0, 1.0, (visits, len(c)))
    return target, nominal_drives(machine, target)


@dataclass(frozen=True)
class Arrivals:
    """What a departure of the true machine may depend on: drives, sides and ways (v, d), dwell_s, speed (v,)."""

    drives: np.ndarray
    sides: np.ndarray
    travelled_m: np.ndarray
    dwell_s: np.ndarray
    speed_m_per_s: np.ndarray


def simulated(
    name: str,
    visits: int,
    travel_m: Callable[[Arrivals], np.ndarray] | None = None,
    *,
    seed: int = 1,
    noise: float = 1.0,
    grid_m: float | None = None,
    times_tolerances: float = 1.0,
) -> Recording:
    """A recording of any shipped machine, whose drives stand off by travel_m (v, d), without payload.

    noise: over what is stated of the readings. grid_m: drives stand at multiples of that only.
    """
    machine, rng = load_machine(shipped_machine(name)), np.random.default_rng(seed)
    target, drives = drawn_poses(machine, rng, visits)
    drives = drives if grid_m is None else grid_m * np.round(drives / grid_m)
    sides = rng.choice([-1.0, 1.0], drives.shape)
    dwell, speed = rng.choice([0.5, 2.0, 8.0, 16.0], visits), rng.choice([0.1, 0.25, 0.5], visits)
    way = np.abs(np.diff(drives, axis=0, prepend=drives[:1]))
    arrivals = Arrivals(drives, sides, way, dwell, speed)
    off = np.zeros_like(drives) if travel_m is None else travel_m(arrivals)
    temperatures = {s: np.full(visits, machine.reference_temperature_c) for s in machine.sensors.values()}
    at = equilibrium.make_conditions(machine, visits, temperatures, np.zeros(visits), np.zeros((visits, 3)))
    true = Rest.of(machine, drawn_geometry(machine, rng, times_tolerances), drives + off, at, target)
    mounted = np.array([s.position_m for s in machine.smrs]) + 1e-4 * rng.standard_normal((len(machine.smrs), 3))
    mounted[:, 2] -= 0.0 if not machine.planar else mounted[:, 2] - [s.position_m[2] for s in machine.smrs]
    places = true.places_m(mounted)
    frame = station_frame(STATION_M, 0.0)
    rows = []
    arrived = 3600.0 + np.cumsum(dwell + 20.0)
    for v in range(visits):
        for i, smr in enumerate(machine.smrs):
            if smr.on == "floor" and v % 5:
                continue
            context = {
                "uid": f"{len(rows):06d}", "phase": "nests" if smr.on == "floor" else "calibration", "smr": smr.name,
                "sequence": len(rows), "visit": v, "pose": v, "pass": 0, "nest_check": v // 5,
                "t_rig_s": arrived[v] + dwell[v] + i, "t_host_s": arrived[v] + dwell[v] + i, "dwell_s": dwell[v] + i,
                "speed_m_per_s": speed[v],
            }  # fmt: skip
            row = context | _reading(frame, places[v, i], rng, noise) | _fixed(machine)
            for a, drive in enumerate(machine.drive_names):
                at = {"commanded_m": drives[v, a], "actual_m": drives[v, a]}
                row |= {f"{drive}_{_quantity(machine, drive, name)}": value for name, value in at.items()}
                row |= {f"{drive}_direction": 0.0 if smr.on == "floor" else sides[v, a]}
            coordinates = ("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad")
            rows.append(row | {f"target_{c}": target[v, k] for k, c in enumerate(coordinates)})
    return make_recording(_header(machine), machine, rows)


def _reading(frame: Frame, place_m: np.ndarray, rng: np.random.Generator, noise: float) -> dict[str, float]:
    point = frame.to_station(place_m[None])
    covariance = point_covariances(*points_to_polar(point), STATED)[0]
    point = point[0] + noise * np.linalg.cholesky(covariance) @ rng.standard_normal(3)
    hz, v, distance = (float(x[0]) for x in points_to_polar(point[None]))
    upper = {f"cov_{'xyz'[i]}{'xyz'[j]}_m2": covariance[i, j] for i in range(3) for j in range(i, 3)}
    return dict(zip(("x_m", "y_m", "z_m"), point, strict=True)) | upper | {
        "hz_rad": hz, "v_rad": v, "slope_distance_m": distance,
    }  # fmt: skip


def _fixed(machine: Machine) -> dict[str, float]:
    by_drive = ("following_error_m", "velocity_m_per_s", "torque_ratio")
    warm = {f"{s}_temperature_c": machine.reference_temperature_c for s in _sensors(machine)}
    plain = dict.fromkeys(
        ("t_u_s", "prism_constant_m", "ppm", "payload", "payload_mass_kg", "compensation", "flags"), 0.0
    )
    return plain | warm | {f"{d}_{_quantity(machine, d, q)}": 0.0 for d in machine.drive_names for q in by_drive} | {
        "station": 1.0, "face": 1.0, "samples": 1.0, "air_temperature_c": 20.0, "pressure_hpa": 1013.0,
        "humidity_percent": 50.0,
    }  # fmt: skip


def _quantity(machine: Machine, drive: str, name: str) -> str:
    """Name of a column of a drive: those of a crank are in radians."""
    return rotary_quantity(name) if drive in machine.rotary_drives else name


def _sensors(machine: Machine) -> Sequence[str]:
    return tuple(sorted(set(machine.sensors.values())))


def _header(machine: Machine) -> RecordingFile:
    accuracy = {"angle_sd_rad": 2.4e-6, "range_sd_m": 1e-4, "range_constant_u_m": 1e-4, "range_scale_u": 1e-6}
    payload = {"name": "none", "mass_kg": 0.0}
    return RecordingFile(
        format=1, campaign="simulated", rig="thought-of", created="2025-01-01T00:00:00Z", software="test",
        drives=machine.drive_names, rotary_drives=machine.rotary_drives, sensors=_sensors(machine),
        nest_limit_m=1e-3, payloads=(payload,),
        station={"position_m": STATION_M, "accuracy": accuracy},
    )  # fmt: skip


def changed(recording: Recording, **columns: np.ndarray) -> Recording:
    """A recording with other columns."""
    return replace(recording, columns={**recording.columns, **columns})


def standing_off(recording: Recording, sd_m: float, seed: int) -> Recording:
    """The recording with drives that stand off anew at each visit from what they report."""
    rng, visit = np.random.default_rng(seed), recording["visit"].astype(np.intp)
    columns: dict[str, np.ndarray] = {}
    for drive in recording.machine.drive_names:
        off_m = sd_m * rng.standard_normal(int(visit.max()) + 1)[visit]
        for quantity in ("commanded_m", "actual_m"):
            name = f"{drive}_{_quantity(recording.machine, drive, quantity)}"
            columns[name] = recording[name] - off_m
    return changed(recording, **columns)


def sensed(
    recording: Recording, seed: int, *, scatter_k: float = 0.0, step_k: float = 0.0, elsewhere: int = 0
) -> Recording:
    """The recording with sensors of part temperatures that scatter, that round to steps, of which one read 85 degC at
    some visits as a common one does after each start."""
    rng, visit = np.random.default_rng(seed), recording["visit"].astype(np.intp)
    columns: dict[str, np.ndarray] = {}
    for name in recording.file.sensors:
        value_c = recording[f"{name}_temperature_c"] + scatter_k * rng.standard_normal(int(visit.max()) + 1)[visit]
        columns[f"{name}_temperature_c"] = step_k * np.round(value_c / step_k) if step_k else value_c
    if elsewhere:
        one = str(rng.choice(recording.file.sensors))
        wrong = rng.choice(int(visit.max()), elsewhere, replace=False)
        columns[f"{one}_temperature_c"] = np.where(np.isin(visit, wrong), 85.0, columns[f"{one}_temperature_c"])
    return changed(recording, **columns)


def moved(recording: Recording, rows: np.ndarray, by_m: float) -> Recording:
    """The recording with readings along the station's first axis off."""
    position = recording.positions_m.copy()
    position[rows, 0] += by_m
    return replace(recording, columns=dict(recording.columns) | {"x_m": position[:, 0]})
