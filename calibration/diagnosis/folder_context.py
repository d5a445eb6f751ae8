"""The context of a measurement folder's readings: what its columns say, and why anything else is not known."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.effects.context import ArrivalHistory, ReadingContext, of_sensor
from calibration.instruments.air import refractivity
from calibration.recording.measurement_folder import MeasuredMachine

VISIT_S = 60.0  # between visits whose times are not known: a number for what needs one, and no meaning
AIR = "air"


def context_of_visits(measured: MeasuredMachine, used: NDArray[np.intp], visit: NDArray[np.intp]) -> ReadingContext:
    """The context of readings at visits: used (v,): rows of the folder's visits; visit (n,): rows of these."""
    machine, visits, said = measured.machine, measured.visits.take(used), measured.conditions
    count, drives = len(used), len(machine.drive_names)

    def column(name: str, otherwise: Array) -> Array:
        return said[name][used] if name in said else otherwise

    def by_drive(quantity: str) -> Array:
        names = [f"{drive}_{quantity}" for drive in machine.drive_names]
        return np.column_stack([said[name][used] for name in names]) if names[0] in said else np.zeros((count, drives))

    t_s, dwell_s = column("t_rig_s", np.asarray(VISIT_S * np.arange(count))), column("dwell_s", np.full(count, VISIT_S))
    order = np.argsort(t_s, kind="stable")
    arrival = np.empty(count, dtype=np.intp)
    arrival[order] = np.arange(count)
    loads = visits.payload_kg[order]
    exchanges = np.cumsum(np.diff(loads, prepend=loads[:1]) != 0.0).astype(np.float64)[arrival]
    air_c = np.full(count, machine.reference_temperature_c)
    temperatures = {AIR: air_c, **{name: np.asarray(t) for name, t in visits.temperatures_c.items()}}
    return ReadingContext(
        history=ArrivalHistory((t_s - dwell_s)[order], visits.drives[order]),
        t_s=t_s[visit],
        arrival=arrival[visit],
        drives=visits.drives[visit],
        direction=by_drive("direction")[visit],
        velocity_m_per_s=np.zeros((len(visit), drives)),
        torque=by_drive("torque_ratio")[visit],
        speed_m_per_s=column("speed_m_per_s", np.zeros(count))[visit],
        dwell_s=dwell_s[visit],
        payload_kg=visits.payload_kg[visit],
        payload_com_m=visits.payload_com_m[visit],
        exchanges=exchanges[visit],
        air_refractivity=refractivity(air_c)[visit],
        temperatures_c={name: t[visit] for name, t in temperatures.items()},
        start_s=float(t_s.min()),
        missing=_missing(measured),
    )


def _missing(measured: MeasuredMachine) -> Mapping[str, str]:
    """Fields of the context that the folder does not say, and why; sensors without a column too."""
    said, first = measured.conditions, measured.machine.drive_names[0]
    columns = {
        "t_s": "t_rig_s",
        "history": "t_rig_s",
        "dwell_s": "dwell_s",
        "speed_m_per_s": "speed_m_per_s",
        "direction": f"{first}_direction",
        "torque": f"{first}_torque_ratio",
        "payload_kg": "payload_mass_kg",
    }
    out = {field: _no_column(name) for field, name in columns.items() if name not in said}
    out["velocity_m_per_s"] = "no reading of a measurement folder is taken on the fly"
    varying = [name for name in measured.sensors if np.ptp(measured.visits.temperatures_c[name]) > 0.0]
    sensors = (AIR, *measured.visits.temperatures_c)
    return out | {of_sensor(name): _no_column(f"{name}_temperature_c") for name in sensors if name not in varying}


def _no_column(name: str) -> str:
    return f"coordinates.csv has no column {name}"
