"""What a station reads of the places, and the recording folder's files (docs/reference/recording.md)."""

from __future__ import annotations

import io
from collections.abc import Mapping
from csv import writer
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.emergent.campaign import Campaign, timeline
from benchmarks.emergent.disturbances import Levels
from benchmarks.emergent.machines import DRIVES, REFLECTORS, SENSORS
from benchmarks.emergent.strut_model import CENTRES_M, PAYLOADS_KG

Array = NDArray[np.float64]

STATION_M = np.array([0.3, -0.2, 3.0])
ANGLE_SD_RAD, RANGE_SD_M, CONSTANT_U_M, SCALE_U = 1.836e-6, 4.4e-6, 5e-6, 1e-6
RATED_N, TORQUE_NOISE, ENCODER_M, SENSOR_K = 6000.0, 0.003, 3e-7, 0.01
SAMPLES = 64
AIR_C, AIR_HPA, AIR_PERCENT, PPM = 20.0, 1020.9, 50.0, -2.04
LOOKING = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True)
class Station:
    """Where it truly stands: turn (3, 3) from the machine's axes to its own, place in the machine's axes; its range."""

    turn: Array
    place_m: Array
    constant_m: float
    scale: float

    def sees(self, places_m: Array, turns_rad: Array, shifts_m: Array) -> Array:
        """Points (r, 3) in its frame, which has drifted; free of noise."""
        points = (places_m - self.place_m) @ self.turn.T
        points = points + np.cross(turns_rad, points) + shifts_m
        distance = np.linalg.norm(points, axis=1, keepdims=True)
        return np.asarray(points / distance * (distance * self.scale + self.constant_m))


def draw_station(rng: np.random.Generator) -> Station:
    """Set up by hand: a centimetre and some milliradians off, levelled to 20 microradians."""
    heading, tilt = rng.uniform(-5e-3, 5e-3), rng.uniform(-2e-5, 2e-5, 2)
    c, s = np.cos(heading), np.sin(heading)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ LOOKING
    levelled = np.array([[1.0, 0.0, tilt[1]], [0.0, 1.0, -tilt[0]], [-tilt[1], tilt[0], 1.0]])
    constant, scale = CONSTANT_U_M * rng.standard_normal(), 1.0 + SCALE_U * rng.standard_normal()
    return Station(levelled @ turn, STATION_M + rng.uniform(-0.01, 0.01, 3), float(constant), float(scale))


def recording_files(
    name: str,
    campaign: Campaign,
    clean_m: Array,
    motor_n: Array,
    levels: Levels,
    machine: str,
    rng: np.random.Generator,
) -> Mapping[str, bytes]:
    """The three files of a recording folder; clean_m (r, 3): what the station would read without noise."""
    files = {"machine.toml": machine, "recording.toml": _header(name, levels), "readings.csv": ""}
    files["readings.csv"] = _table(_columns(campaign, clean_m, motor_n, rng))
    return {file: text.encode() for file, text in files.items()}


def _columns(campaign: Campaign, clean_m: Array, motor_n: Array, rng: np.random.Generator) -> dict[str, list[object]]:
    visits, reflectors, dwell_s = campaign.of_reading
    t_s, _ = timeline(campaign)
    count, nest = len(visits), reflectors >= 5
    polar, points, covariance = _measured(clean_m, rng)
    checks = np.cumsum(np.diff(nest.astype(int), prepend=0) == 1)
    of_visit = [campaign.visits[v] for v in visits]
    target = np.array([visit.target_m for visit in of_visit])
    columns: dict[str, object] = {
        "uid": [f"r{k + 1}" for k in range(count)],
        "phase": np.where(nest, "nests", "calibration"),
        "smr": [REFLECTORS[j] for j in reflectors],
        "sequence": np.arange(1, count + 1),
        "visit": visits + 1,
        "pose": [-1 if at_nest else visit.pose for at_nest, visit in zip(nest, of_visit, strict=True)],
        "pass": [0 if at_nest else visit.pass_ for at_nest, visit in zip(nest, of_visit, strict=True)],
        "nest_check": checks,
        "t_rig_s": np.round(t_s, 3),
        "t_host_s": np.round(t_s, 3),
        "t_u_s": np.full(count, 0.5),
        "hz_rad": polar[:, 0], "v_rad": polar[:, 1], "slope_distance_m": polar[:, 2],
        "station": np.ones(count, dtype=int), "face": np.zeros(count, dtype=int),
        "prism_constant_m": np.zeros(count), "ppm": np.full(count, PPM),
        "x_m": points[:, 0], "y_m": points[:, 1], "z_m": points[:, 2],
    }  # fmt: skip
    for k, (i, j) in {"xx": (0, 0), "xy": (0, 1), "xz": (0, 2), "yy": (1, 1), "yz": (1, 2), "zz": (2, 2)}.items():
        columns[f"cov_{k}_m2"] = covariance[:, i, j]
    columns |= {"samples": np.full(count, SAMPLES), "target_x_m": target[:, 0], "target_y_m": target[:, 1]}
    columns |= {f"target_{k}": np.zeros(count) for k in ("z_m", "rx_rad", "ry_rad", "rz_rad")}
    columns |= {
        "speed_m_per_s": [visit.speed_m_per_s for visit in of_visit],
        "dwell_s": dwell_s,
        "air_temperature_c": np.round(AIR_C + 0.03 * rng.standard_normal(count), 3),
        "pressure_hpa": np.round(AIR_HPA + 0.03 * rng.standard_normal(count), 2),
        "humidity_percent": np.round(AIR_PERCENT + 0.3 * rng.standard_normal(count), 1),
        "payload": [visit.payload for visit in of_visit],
        "payload_mass_kg": campaign.payload_kg[visits],
        "compensation": np.zeros(count, dtype=int), "flags": np.zeros(count, dtype=int),
    }  # fmt: skip
    for a, drive in enumerate(DRIVES):
        # A drive reports the place that it was sent to once it is within its window, and the encoder's last digit.
        commanded = np.round(campaign.drives_m[visits, a], 7)
        actual = np.round(commanded + ENCODER_M * rng.standard_normal(count), 7)
        columns |= {
            f"{drive}_commanded_m": commanded,
            f"{drive}_actual_m": actual,
            f"{drive}_following_error_m": np.round(commanded - actual, 7),
            f"{drive}_velocity_m_per_s": np.zeros(count),
            f"{drive}_torque_ratio": np.round(motor_n[:, a] / RATED_N + TORQUE_NOISE * rng.standard_normal(count), 6),
            f"{drive}_direction": [visit.directions[a] for visit in of_visit],
        }
    for sensor in SENSORS:
        columns[f"{sensor}_temperature_c"] = np.round(20.0 + SENSOR_K * rng.standard_normal(count), 3)
    return {key: list(np.asarray(values).tolist()) for key, values in columns.items()}


def _measured(clean_m: Array, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Angles and distance (r, 3) with noise, the point (r, 3), and its covariance (r, 3, 3)."""
    noise = rng.standard_normal(clean_m.shape)
    distance = np.linalg.norm(clean_m, axis=1)
    v = np.arccos(clean_m[:, 2] / distance) + ANGLE_SD_RAD * noise[:, 1]
    hz = np.arctan2(clean_m[:, 0], clean_m[:, 1]) + ANGLE_SD_RAD * noise[:, 0] / np.sin(v)
    distance = np.round(distance + RANGE_SD_M * noise[:, 2], 10)
    hz, v = np.round(np.mod(hz, 2.0 * np.pi), 12), np.round(v, 12)
    sight = np.stack([np.sin(v) * np.sin(hz), np.sin(v) * np.cos(hz), np.cos(v)], axis=1)
    across = np.stack([np.cos(hz), -np.sin(hz), np.zeros_like(hz)], axis=1)
    up = np.cross(across, sight)
    axes = np.stack([across, up, sight], axis=2)
    wide = (ANGLE_SD_RAD * distance) ** 2
    variance = np.stack([wide, wide, np.full_like(wide, RANGE_SD_M**2)], axis=1)
    covariance = np.einsum("rik,rk,rjk->rij", axes, variance, axes)
    return np.stack([hz, v, distance], axis=1), distance[:, None] * sight, covariance


def _table(columns: Mapping[str, list[object]]) -> str:
    stream = io.StringIO()
    lines = writer(stream, lineterminator="\n")
    lines.writerow(columns)
    lines.writerows(zip(*columns.values(), strict=True))
    return stream.getvalue()


def _header(name: str, levels: Levels) -> str:
    station = ", ".join(repr(float(value)) for value in STATION_M)
    lines = [
        "format = 1", f'campaign = "{name}"', 'rig = "emergent"', 'created = "2026-11-23T08:00:00+00:00"',
        'software = "benchmarks.emergent"', f"drives = {list(DRIVES)!r}", f"sensors = {list(SENSORS)!r}",
        "nest_limit_m = 0.0003", "", "[station]", 'name = "station"', f"position_m = [{station}]", "heading_rad = 0.0",
        "", "[station.accuracy]", f"angle_sd_rad = {ANGLE_SD_RAD}", f"range_sd_m = {RANGE_SD_M}",
        f"range_constant_u_m = {CONSTANT_U_M}", f"range_scale_u = {SCALE_U}", "drift_rad_per_sqrt_h = 1e-07",
        "drift_of_level_rad_per_sqrt_h = 1e-07", "drift_m_per_sqrt_h = 4e-07", "",
    ]  # fmt: skip
    for mass, (x_m, y_m) in zip(PAYLOADS_KG, CENTRES_M, strict=True):
        lines += [
            "[[payloads]]", f'name = "{mass:.0f} kg"', f"mass_kg = {mass}", f"u_mass_kg = {1e-3 * mass}",
            f"com_m = [{x_m}, {y_m}, 0.0]", "u_com_m = 0.002", "",
        ]  # fmt: skip
    lines += ["[nuisance]", *(f"{key} = {value}" for key, value in vars(levels).items()), ""]
    return "\n".join(lines)
