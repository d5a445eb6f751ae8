"""Columns and header of a recording (docs/reference/recording.md), written apart from the reader's."""

from __future__ import annotations

from typing import Any

import numpy as np

from mock_devices.effects.base import Array
from mock_devices.machine_file import MachineFile
from mock_devices.plant.thermal import SENSORS
from mock_devices.settings import MockSettings


def column_names(machine: MachineFile) -> tuple[str, ...]:
    """All columns in the order of docs/reference/recording.md."""
    fixed = [
        "uid",
        "phase",
        "smr",
        "sequence",
        "visit",
        "pose",
        "pass",
        "nest_check",
        "t_rig_s",
        "t_host_s",
        "t_u_s",
        "hz_rad",
        "v_rad",
        "slope_distance_m",
        "station",
        "face",
        "prism_constant_m",
        "ppm",
        "x_m",
        "y_m",
        "z_m",
        "cov_xx_m2",
        "cov_xy_m2",
        "cov_xz_m2",
        "cov_yy_m2",
        "cov_yz_m2",
        "cov_zz_m2",
        "samples",
        "target_x_m",
        "target_y_m",
        "target_z_m",
        "target_rx_rad",
        "target_ry_rad",
        "target_rz_rad",
        "speed_m_per_s",
        "dwell_s",
        "air_temperature_c",
        "pressure_hpa",
        "humidity_percent",
        "payload",
        "payload_mass_kg",
        "compensation",
        "flags",
    ]
    each = ("commanded_m", "actual_m", "following_error_m", "velocity_m_per_s", "torque_ratio", "direction")
    drives = (f"{slider.name}_{quantity}" for slider in machine.sliders for quantity in each)
    return (*fixed, *drives, *(f"{sensor}_temperature_c" for sensor in SENSORS))


def points(hz_rad: Array, v_rad: Array, distance_m: Array) -> Array:
    """Points (n, 3) in the station's frame."""
    level = distance_m * np.sin(v_rad)
    return np.stack([level * np.sin(hz_rad), level * np.cos(hz_rad), distance_m * np.cos(v_rad)], axis=1)


def covariances(hz_rad: Array, v_rad: Array, distance_m: Array, angle_sd_rad: float, range_sd_m: float) -> Array:
    """Covariances (n, 3, 3) of single readings: J diag(sd^2) J', J along growing Hz, V and distance."""
    sin_h, cos_h, sin_v, cos_v = np.sin(hz_rad), np.cos(hz_rad), np.sin(v_rad), np.cos(v_rad)
    zero = np.zeros_like(hz_rad)
    across = angle_sd_rad * distance_m
    j = np.empty((len(hz_rad), 3, 3))
    j[:, :, 0] = np.stack([cos_h, -sin_h, zero], axis=1) * (across * sin_v)[:, None]
    j[:, :, 1] = np.stack([cos_v * sin_h, cos_v * cos_h, -sin_v], axis=1) * across[:, None]
    j[:, :, 2] = np.stack([sin_v * sin_h, sin_v * cos_h, cos_v], axis=1) * range_sd_m
    return np.asarray(j @ np.swapaxes(j, 1, 2))


def header_of(machine: MachineFile, settings: MockSettings, name: str) -> dict[str, Any]:
    """What recording.toml says of a campaign."""
    accuracy = settings.instrument
    floor = [smr for smr in machine.smrs if smr.on == "floor"][:2]
    header: dict[str, Any] = {
        "format": 1,
        "campaign": name,
        "rig": "mock",
        "created": "2026-01-01T00:00:00+00:00",
        "software": "mock plant",
        "drives": [slider.name for slider in machine.sliders],
        "sensors": list(SENSORS),
        "nest_limit_m": 8.0e-5,
        "station": {
            "name": "mock station",
            "position_m": list(settings.station_position_m),
            "heading_rad": settings.station_heading_rad,
            "accuracy": {
                "angle_sd_rad": accuracy.angle_sd_rad,
                "range_sd_m": accuracy.range_sd_m,
                "range_constant_u_m": accuracy.range_constant_u_m,
                "range_scale_u": accuracy.range_scale_u,
                "drift_rad_per_sqrt_h": max(accuracy.drift_about_vertical_rad, 1.0e-9),
                "drift_of_level_rad_per_sqrt_h": max(accuracy.drift_of_level_rad, 1.0e-9),
                "drift_m_per_sqrt_h": max(accuracy.drift_m, 1.0e-9),
            },
        },
        "payloads": [
            {
                "name": p.name,
                "mass_kg": p.mass_kg,
                "u_mass_kg": p.u_mass_kg,
                "com_m": list(p.com_m),
                "u_com_m": p.u_com_m,
            }
            for p in settings.payloads
        ],
        "nuisance": {
            "drift_m": settings.nuisance.drift_m,
            "reseat_m": settings.nuisance.reseat_m,
            "reversal_m": settings.nuisance.reversal_m,
            "temperature_k": settings.nuisance.temperature_k,
        },
    }
    if settings.known_tables:
        header["known_tables"] = [table.section() for table in settings.known_tables]
    if len(floor) == 2:
        apart = np.subtract(floor[1].position_m, floor[0].position_m)
        header["nest_length"] = {
            "nests": [floor[0].name, floor[1].name],
            "value_m": float(np.linalg.norm(apart)),
            "u_m": settings.certificate_sd_m,
        }
    return header
