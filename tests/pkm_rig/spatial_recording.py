"""Recordings straight from the mock plant of any machine, without any wire; its noise-free truth beside them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calibration.base.frame import station_frame
from calibration.instruments import station_geometry
from calibration.recording.columns import column_names, rotary_quantity
from calibration.recording.header import RecordingFile, StationEntry
from calibration.recording.recording import Recording, make_recording
from mock_devices.plant.spatial_plant import SpatialPlant
from pkm_rig.rig.clock import VirtualClock
from pkm_rig.rig.config import demo_rig_path, load_rig, machine_path
from pkm_rig.rig.rig import PART_SENSORS
from pkm_rig.rig.schedule import calibration_blocks
from pkm_rig.virtual.mock_rig import settings_of

TEMPERATURES_C = {"struts": 21.0, "columns": 21.5, "base": 20.7, "platform": 21.2}
REST = {"air_temperature_c": 20.0, "pressure_hpa": 980.0, "humidity_percent": 45.0, "samples": 1.0, "dwell_s": 3.0}


def rig_path_of(machine: str | Path) -> Path:
    """The rig file of a shipped machine's demo, or one of the test's own."""
    return machine if isinstance(machine, Path) else demo_rig_path(machine)


def plant_of(machine: str | Path, seed: int) -> tuple[SpatialPlant, RecordingFile]:
    """The plant of a rig and the header of a recording of it."""
    path = rig_path_of(machine)
    file, described = load_rig(path)
    file = file.model_copy(update={"mock": file.mock.model_copy(update={"seed": seed})})
    plant = SpatialPlant(machine_path(file, path), settings_of(file, path), VirtualClock())
    station = file.station
    header = RecordingFile(
        format=1,
        campaign=f"{described.name}-{seed}",
        rig="plant",
        created="2026-01-01T00:00:00+00:00",
        software="test",
        drives=described.drive_names,
        rotary_drives=described.rotary_drives,
        sensors=PART_SENSORS,
        station=StationEntry(
            name="mock", position_m=station.position_m, heading_rad=station.heading_rad, accuracy=station.accuracy
        ),
        nest_length=file.nest_length,
        nest_limit_m=file.campaign.nest_limit_m,
        payloads=file.payloads,
    )
    return plant, header


def record(machine: str | Path, seed: int, *, poses: int, noise: float = 1.0) -> Recording:
    """A calibration campaign of a rig; `noise` is a factor on the station's stated one."""
    plant, header = plant_of(machine, seed)
    file, described = load_rig(rig_path_of(machine))
    settings = file.campaign.model_copy(update={"calibration_poses": poses})
    rng = np.random.default_rng([seed, 77])
    accuracy = file.station.accuracy.to_station_accuracy()
    sd = file.station.accuracy
    rows: list[dict[str, float | str]] = []
    count = {"check": -1, "visit": -1}

    def read(phase, smr, drives, payload, visit=None):
        point = plant.truth.smr_positions(drives, payload, temperatures_c=TEMPERATURES_C, in_station_frame=True)[smr]
        polar = np.array([float(x[0]) for x in station_geometry.points_to_polar(point[None])])
        polar += noise * rng.normal(size=3) * [sd.angle_sd_rad / np.sin(polar[1]), sd.angle_sd_rad, sd.range_sd_m]
        hz, v, distance = (np.array([x]) for x in polar)
        place = station_geometry.polar_to_points(hz, v, distance)[0]
        covariance = station_geometry.point_covariances(hz, v, distance, accuracy)[0]
        row = dict.fromkeys(column_names(header.drives, header.sensors, rotary=header.rotary_drives), 0.0) | REST
        row |= {f"cov_{'xyz'[i]}{'xyz'[j]}_m2": covariance[i, j] for i in range(3) for j in range(i, 3)}
        row |= dict(zip(("x_m", "y_m", "z_m"), place, strict=True))
        row |= dict(zip(("hz_rad", "v_rad", "slope_distance_m"), polar, strict=True))
        row |= {f"{name}_temperature_c": TEMPERATURES_C[name] for name in header.sensors}
        row |= {
            "uid": f"r{len(rows)}",
            "sequence": len(rows),
            "phase": phase,
            "smr": smr,
            "t_rig_s": 3600.0 + 5.0 * len(rows),
            "nest_check": count["check"],
            "visit": count["visit"],
            "pose": -1 if visit is None else visit.pose,
            "payload": payload,
            "payload_mass_kg": file.payloads[payload].mass_kg,
        }
        for a, name in enumerate(header.drives):
            for quantity in ("commanded_m", "actual_m"):
                key = rotary_quantity(quantity) if name in header.rotary_drives else quantity
                row[f"{name}_{key}"] = drives[a]
            row[f"{name}_direction"] = 0.0 if visit is None else visit.direction[a]
        if visit is not None:
            names = ("target_x_m", "target_y_m", "target_z_m", "target_rx_rad", "target_ry_rad", "target_rz_rad")
            row |= dict(zip(names, visit.target_m, strict=True))
            row |= {"pass": visit.pass_, "speed_m_per_s": visit.speed_m_per_s}
        rows.append(row)

    def nests(drives, payload):
        count["check"] += 1
        for smr in described.smrs:
            if smr.on == "floor":
                read("nests", smr.name, drives, payload)

    for block in calibration_blocks(described, settings):
        nests(block.visits[0].drives_m, block.payload)
        for number, visit in enumerate(block.visits):
            if number % 8 == 7:
                nests(visit.drives_m, block.payload)
            count["visit"] += 1
            for smr in described.smrs:
                if smr.on != "floor":
                    read("calibration", smr.name, visit.drives_m, block.payload, visit)
        nests(block.visits[-1].drives_m, block.payload)
    return make_recording(header, described, rows)


def true_forces_n(plant: SpatialPlant, drives, payload: int) -> np.ndarray:
    """Forces (n, s) of the plant's own struts at drive coordinates (n, d), tension positive."""
    return np.array([plant.truth.forces_n(row, payload, temperatures_c=TEMPERATURES_C) for row in drives])


def true_errors(plant: SpatialPlant, report, drives, target_m, payload: int) -> tuple[np.ndarray, np.ndarray]:
    """Noise-free errors (n, 3), (n, 3) of the tool in a report frame, at drive coordinates (n, d), against targets."""
    names = [report.machine.smrs[i].name for i in report.smrs]
    seen = [
        plant.truth.smr_positions(row, payload, temperatures_c=TEMPERATURES_C, in_station_frame=True) for row in drives
    ]
    points = np.array([[places[name] for name in names] for places in seen])
    return report.tool_error(report.poses(points, target_m), target_m)


def frame_of_rig(machine: str):
    """The rough station frame of a demo rig, and its machine."""
    file, described = load_rig(demo_rig_path(machine))
    station = file.station
    return station_frame(station.position_m, station.heading_rad, described.gravity_m_per_s2), described
