"""Recordings straight from the mock plant, without any wire: an independent source of data for analyses."""

from __future__ import annotations

import numpy as np

from calibration.instruments import station_geometry
from calibration.recording.columns import column_names
from calibration.recording.header import RecordingFile, StationEntry
from calibration.recording.recording import Recording, make_recording
from mock_devices.plant.plant import Plant
from pkm_rig.rig.clock import VirtualClock
from pkm_rig.rig.config import embedded_rig_path, load_rig, machine_path
from pkm_rig.rig.rig import PART_SENSORS
from pkm_rig.rig.schedule import calibration_blocks, verification_block
from pkm_rig.virtual.mock_rig import settings_of
from tests.pkm_rig.conftest import SHORT


def plant_of(seed: int) -> tuple[Plant, RecordingFile]:
    """The plant of a seed and the header of a recording of it."""
    file, _ = load_rig(embedded_rig_path())
    file = file.model_copy(update={"mock": file.mock.model_copy(update={"seed": seed})})
    plant = Plant(machine_path(file, embedded_rig_path()), settings_of(file), VirtualClock())
    entry = StationEntry(
        name="mock",
        position_m=file.station.position_m,
        heading_rad=file.station.heading_rad,
        accuracy=file.station.accuracy,
    )
    header = RecordingFile(
        format=1,
        campaign=f"plant-{seed}",
        rig="plant",
        created="2026-01-01T00:00:00+00:00",
        software="test",
        drives=("left", "right"),
        sensors=PART_SENSORS,
        station=entry,
        nest_length=file.nest_length,
        nest_limit_m=file.campaign.nest_limit_m,
        payloads=file.payloads,
    )
    return plant, header


def record(
    seed: int, *, bump_m: float = 0.0, bump_at_check: int = 10**6, spoil=None, correct=None, noise=99, **changes
) -> Recording:
    """A short campaign with verification before; the station is bumped sideways from some nest check on.

    `spoil(row)` may change rows (dictionaries) before they are collected. `correct(drives, payload)` says where a
    control's correction has the drives stand that are commanded somewhere; `noise` is a seed of its own.
    """
    plant, header = plant_of(seed)
    file, machine = load_rig(embedded_rig_path())
    settings = file.campaign.model_copy(update={**SHORT, **changes})
    rng = np.random.default_rng([seed, noise])
    stated = file.station.accuracy.to_station_accuracy()
    rows: list[dict[str, float | str]] = []
    state = {"t": 3600.0, "check": -1, "visit": -1}

    def read(phase, smr, drives, payload, visit=None):
        stands = drives if correct is None else correct(drives, payload)
        truth = plant.truth.smr_positions(stands, payload, state["t"])[smr]
        seen = plant.view.polar(tuple(truth), state["t"])
        hz, v, d = (np.array([x]) for x in (seen.hz_rad, seen.v_rad, seen.distance_m))
        covariance = station_geometry.point_covariances(hz, v, d, stated)[0]
        hz = hz + rng.normal(0.0, stated.angle_sd_rad)
        v = v + rng.normal(0.0, stated.angle_sd_rad)
        d = d + plant.view.range_constant_m + rng.normal(0.0, stated.range_sd_m)
        point = station_geometry.polar_to_points(hz, v, d)[0]
        point[0] += bump_m if state["check"] >= bump_at_check else 0.0
        row: dict[str, float | str] = dict.fromkeys(column_names(header.drives, header.sensors), 0.0)
        row |= {"uid": f"{len(rows)}", "phase": phase, "smr": smr, "sequence": float(len(rows))}
        row |= {"visit": float(state["visit"]), "nest_check": float(state["check"]), "t_rig_s": state["t"]}
        row |= dict(zip(("x_m", "y_m", "z_m"), point.tolist(), strict=True))
        row |= {f"cov_{'xyz'[i]}{'xyz'[j]}_m2": float(covariance[i, j]) for i in range(3) for j in range(i, 3)}
        row |= {"samples": 1.0, "payload": float(payload), "payload_mass_kg": header.payloads[payload].mass_kg}
        row |= {"left_actual_m": drives[0], "right_actual_m": drives[1]}
        row |= {f"{name}_temperature_c": plant.thermal.part_c(name, state["t"]) for name in header.sensors}
        if visit is not None:
            row |= {"pose": float(visit.pose), "pass": float(visit.pass_)}
            row |= {"target_x_m": float(visit.target_m[0]), "target_y_m": float(visit.target_m[1])}
            sides = zip(header.drives, visit.direction, strict=True)
            row |= {f"{drive}_direction": float(side) for drive, side in sides}
        if spoil is not None:
            spoil(row)
        rows.append(row)
        state["t"] += 3.0

    def nests(drives, payload):
        state["check"] += 1
        for nest in ("N1", "N2"):
            read("nests", nest, drives, payload)

    def block(visits, phase, smrs):
        for number, visit in enumerate(visits):
            drives = tuple(float(q) for q in visit.drives_m)
            if number % settings.nest_every_visits == 0:
                nests(drives, visit.payload)
            state["visit"] += 1
            for smr in smrs:
                read(phase, smr, drives, visit.payload, visit)
        nests(drives, visit.payload)

    for planned in calibration_blocks(machine, settings):
        block(planned.visits, "calibration", ("P1", "P2", "P3", "SL", "SR"))
    for payload in (0, 1):
        block(verification_block(machine, settings, payload).visits, "verification_before", ("P1", "P2", "P3"))
    return make_recording(header, machine, rows)
