"""A recording as files: what the station and the sensors read, with noise, and what the header states."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.disturbances import with_outliers
from benchmarks.other_simulator.effects import Effect
from benchmarks.other_simulator.equilibrium import drive_loads_n
from benchmarks.other_simulator.machine import ON_FLOOR
from benchmarks.other_simulator.rig import Rig
from benchmarks.other_simulator.state import Equilibrium
from benchmarks.other_simulator.toml_text import toml_text

Array = NDArray[np.float64]
Columns = dict[str, Any]  # of r readings each, by name

SOFTWARE = "other-simulator 1"
GROUP_OF_SENSOR = {"struts": "struts", "columns": "drives", "base": "base", "platform": "platform"}
MOTOR, WALL = "motor_", "hall_wall"
NEST_LIMIT_M, NEST_LENGTH_U_M = 1e-4, 5e-6
TABLE_M = (1.5e-5, 1e-4)  # largest correction, where tables are only known
# Of recorded values, and of the rated torque over the largest load.
AIR_SD_C, SENSOR_SD_C, TORQUE_SD, RATED = 0.02, 0.008, 0.003, 2.2
WOUND_UP_FRICTION = 2.5  # of friction that winds a drive up, over what it has otherwise
COVARIANCES = (("xx", 0, 0), ("xy", 0, 1), ("xz", 0, 2), ("yy", 1, 1), ("yz", 1, 2), ("zz", 2, 2))


def recording_files(
    rig: Rig, campaign: str, effects: Sequence[tuple[Effect, float]], rng: np.random.Generator
) -> tuple[dict[str, bytes], Array]:
    """Contents of a recording's files by name, and what the station would read without noise (r, 3).

    effects: with their amplitudes.
    """
    seen, state = rig.simulate([part for effect, amplitude in effects for part in effect.sized(amplitude)])
    noise_free = rig.station.with_range_errors(rig.drift.of(seen))
    read, covariances = _read(rig, noise_free, rng)
    header = _header(rig, campaign, effects, rng)
    columns = _columns_of_rows(rig) | _columns_of_station(rig, read, covariances, rng) | _columns_of_target(rig, rng)
    wound_up = {place for effect, _ in effects if effect.name == "friction_windup" for place in effect.places}
    columns |= _columns_of_drives(rig, state, _shown_m(rig, effects), wound_up, rng)
    columns |= _columns_of_sensors(rig, state, header["sensors"], rng)
    files = {
        "machine.toml": f"# nominal machine\n{toml_text(rig.machine.description)}\n",
        "recording.toml": f"{toml_text(header)}\n",
        "readings.csv": _csv(columns),
    }
    return {name: text.encode() for name, text in files.items()}, noise_free


def _read(rig: Rig, noise_free_m: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """What the station reads (r, 3), and the covariances (r, 3, 3) that it states."""
    spread = np.linalg.cholesky(rig.station.covariances_m2(noise_free_m))
    read = noise_free_m + np.einsum("rij,rj->ri", spread, rng.normal(size=noise_free_m.shape))
    if rig.levels.outliers:
        read = with_outliers(read, rng)
    return read, rig.station.covariances_m2(read)


def _shown_m(rig: Rig, effects: Sequence[tuple[Effect, float]]) -> Array:
    """What drives that have not settled yet show of that in their own columns (r, d)."""
    out = np.zeros_like(rig.rows.drives_m)
    for effect, amplitude in effects:
        for contribution, drive, weight in effect.parts:
            if effect.share_shown and contribution.drive_m is not None:
                out[:, drive] += effect.share_shown * amplitude * weight * contribution.drive_m
    return out


def _header(
    rig: Rig, campaign: str, effects: Sequence[tuple[Effect, float]], rng: np.random.Generator
) -> dict[str, Any]:
    machine, station, rows = rig.machine, rig.station, rig.rows
    sensors = list(GROUP_OF_SENSOR)
    if rng.random() < 0.6:
        sensors += [f"{MOTOR}{drive}" for drive in machine.drives]
    if rng.random() < 0.3:
        sensors.append(WALL)
    left_on = [amplitude for effect, amplitude in effects if effect.name == "tables_left_on"]
    table_m = left_on[0] if left_on else float(np.exp(rng.uniform(*np.log(TABLE_M))))
    month, day, hour, minute = (int(rng.integers(*bounds)) for bounds in ((1, 13), (1, 29), (6, 15), (0, 60)))
    header: dict[str, Any] = {
        "format": 1, "campaign": campaign, "rig": machine.description["name"],
        "created": f"2025-{month:02d}-{day:02d}T{hour:02d}:{minute:02d}:00Z",
        "software": SOFTWARE, "drives": machine.drives, "sensors": sensors,
        "nest_limit_m": NEST_LIMIT_M, "simulated": True,
        "station": {
            "name": "tracker", "position_m": station.stated_place_m.tolist(),
            "heading_rad": station.stated_heading_rad,
            "accuracy": {
                "angle_sd_rad": station.angle_sd_rad, "range_sd_m": station.range_sd_m,
                "range_constant_u_m": station.range_constant_u_m, "range_scale_u": station.range_scale_u,
                **rig.levels.stated_drift(),
            },
        },
    }  # fmt: skip
    if rng.random() < 0.5:
        header["nest_length"] = _nest_length(rig, rng)
    header["payloads"] = [
        {
            "name": one.name, "mass_kg": one.mass_kg, "u_mass_kg": one.u_mass_kg,
            "com_m": list(one.centre_m), "u_com_m": one.u_centre_m,
        }
        for one in rows.payloads
    ]  # fmt: skip
    if rig.levels.declared:
        header["nuisance"] = rig.levels.nuisance
    header["known_tables"] = [table.stated(machine, table_m) for table in rig.scene.tables]
    return header


def _nest_length(rig: Rig, rng: np.random.Generator) -> dict[str, Any]:
    """The certified distance of the first two nests."""
    first, second = np.flatnonzero(rig.machine.carriers == ON_FLOOR)[:2]
    places = rig.geometry.smr_position_m
    length_m = np.linalg.norm(places[first] - places[second]) + rng.normal() * NEST_LENGTH_U_M
    names = [rig.machine.reflectors[first], rig.machine.reflectors[second]]
    return {"nests": names, "value_m": round(float(length_m), 7), "u_m": NEST_LENGTH_U_M}


def _columns_of_rows(rig: Rig) -> Columns:
    rows = rig.rows
    return {
        "uid": [f"r{k:05d}" for k in range(len(rows))],
        "phase": rows.phase,
        "smr": np.array(rig.machine.reflectors)[rows.smr],
        "sequence": np.arange(len(rows)),
        "visit": rows.visit,
        "pose": rows.pose_number,
        "pass": rows.run,
        "nest_check": rows.nest_check,
        "t_rig_s": rows.t_s,
    }


def _columns_of_station(rig: Rig, read_m: Array, covariances_m2: Array, rng: np.random.Generator) -> Columns:
    rows, count = rig.rows, len(rig.rows)
    distances = np.linalg.norm(read_m, axis=1)
    return {
        "t_host_s": (rows.t_s + 1.5 + rng.normal(size=count) * 0.004).round(4),
        "t_u_s": np.where(rows.moving, 0.005, rng.uniform(0.6, 0.9, count)).round(4),
        "hz_rad": np.arctan2(read_m[:, 0], read_m[:, 1]),
        "v_rad": np.arccos(read_m[:, 2] / distances),
        "slope_distance_m": distances,
        "station": np.zeros(count, int),
        "face": rows.face,
        "prism_constant_m": np.zeros(count),
        "ppm": np.zeros(count),
        **{f"{axis}_m": read_m[:, k] for k, axis in enumerate("xyz")},
        **{f"cov_{name}_m2": covariances_m2[:, a, b] for name, a, b in COVARIANCES},
        "samples": np.where(rows.moving, 1, 5),
    }


def _columns_of_target(rig: Rig, rng: np.random.Generator) -> Columns:
    rows, weather, count = rig.rows, rig.weather, len(rig.rows)
    names = ("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad")
    return {
        **{f"target_{name}": rows.pose[:, k] for k, name in enumerate(names)},
        "speed_m_per_s": rows.speed_m_per_s,
        "dwell_s": rows.dwell_s,
        "air_temperature_c": (weather.air_c + rng.normal(size=count) * AIR_SD_C).round(2),
        "pressure_hpa": weather.pressure_hpa.round(1),
        "humidity_percent": weather.humidity_percent.round(1),
        "payload": rows.payload,
        "payload_mass_kg": rows.stated_payload_kg,
        "compensation": np.zeros(count, int),
        "flags": np.zeros(count, int),
    }


def _columns_of_drives(
    rig: Rig, state: Equilibrium, shown_m: Array, wound_up: set[str], rng: np.random.Generator
) -> Columns:
    """shown_m (r, d): what drives show of not having settled; wound_up: drives that friction winds up."""
    rows, count, columns = rig.rows, len(rig.rows), Columns()
    following = np.round(rows.following_error_m - shown_m, 9)
    loads, rated = drive_loads_n(rig.machine, state), RATED * np.abs(rig.scene.loads_n).max()
    for k, name in enumerate(rig.machine.drives):
        friction = rng.uniform(0.02, 0.05) * rated * (WOUND_UP_FRICTION if name in wound_up else 1)
        velocity, side = rows.velocity_m_per_s[:, k], rows.side[:, k]
        columns[f"{name}_commanded_m"] = rows.commanded_m[:, k]
        columns[f"{name}_actual_m"] = rows.commanded_m[:, k] - following[:, k]
        columns[f"{name}_following_error_m"] = following[:, k]
        noise = rng.normal(size=count) * 1e-6 * (1 + 300 * rows.moving)
        columns[f"{name}_velocity_m_per_s"] = (velocity + noise).round(7)
        held = np.where(rows.moving, 1.0, 0.6) * friction * side + 0.15 * rated * velocity
        torque = (loads[:, k] + held) / rated + rng.normal(size=count) * TORQUE_SD
        columns[f"{name}_torque_ratio"] = torque.round(4)
        columns[f"{name}_direction"] = side.astype(int)
    return columns


def _columns_of_sensors(rig: Rig, state: Equilibrium, sensors: Sequence[str], rng: np.random.Generator) -> Columns:
    rows, weather, columns = rig.rows, rig.weather, Columns()
    loads, rated = np.abs(drive_loads_n(rig.machine, state)), RATED * np.abs(rig.scene.loads_n).max()
    for name in sensors:
        if name in GROUP_OF_SENSOR:
            shown = weather.part_c[GROUP_OF_SENSOR[name]]
        elif name == WALL:
            shown = weather.lagging_air_c(8) - 0.7
        else:
            drive = rig.machine.drives.index(name.removeprefix(MOTOR))
            shown = weather.air_c + 3 + 9 * rows.warmth_of_motion(drive, 12) + 4 * (loads[:, drive] / rated)
        columns[f"{name}_temperature_c"] = (shown + rng.normal(size=len(rows)) * SENSOR_SD_C).round(3)
    return columns


def _csv(columns: Columns) -> str:
    """The table; numbers so that they are read back as they are."""
    texts = [_texts(values) for values in columns.values()]
    return "\n".join([",".join(columns), *map(",".join, zip(*texts, strict=True)), ""])


def _texts(values: Any) -> list[str]:
    if isinstance(values, list) or values.dtype.kind in "US":
        return [str(value) for value in values]
    if values.dtype.kind in "iub":
        return [str(int(value)) for value in values]
    return [repr(float(value)) for value in values]
