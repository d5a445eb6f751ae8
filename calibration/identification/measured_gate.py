"""Wrong readings of a measurement folder, named by their file and line."""

from __future__ import annotations

import numpy as np

from calibration.base.errors import InputError
from calibration.identification.gate import GatedReadings, gate_readings
from calibration.identification.problem import LeastSquaresProblem
from calibration.identification.step_size import check_step_size
from calibration.instruments.readings import Readings
from calibration.instruments.tool_coordinates import ToolCoordinates
from calibration.model.model import Model
from calibration.recording.measurement_folder import MeasuredMachine
from calibration.reduction.left_out import MODEL, LeftOutReading


def without_wrong_readings(measured: MeasuredMachine) -> tuple[MeasuredMachine, tuple[LeftOutReading, ...]]:
    """The machine without the readings that do not fit what the others say of it, and these.

    Raises InputError if the readings are not of the machine (`check_step_size`), also where one that its stored
    parameters miss is none that the others disown.
    """
    missed = check_step_size(measured)
    readings = measured.readings()
    problem = LeastSquaresProblem(Model(measured.parameters()), measured.visits, readings)
    gated = gate_readings(problem, [np.zeros(len(part), dtype=np.intp) for part in readings])
    wrong = [np.flatnonzero(~judged.keep) for judged in gated]
    left_out = tuple(
        _named(measured, part, judged, int(row))
        for part, judged, rows in zip(readings, gated, wrong, strict=True)
        for row in rows
    )
    for line, miss in missed.items():
        if line not in {reading.name for reading in left_out}:
            raise InputError(
                f"{measured.file.name}: {line}: the stored parameters miss it by {1e3 * miss:.3g} mm, and the other "
                "readings do not agree without it: parameters and readings do not belong to the same calibration; "
                "correct the line, or calibrate the machine again"
            )
    return (measured.without(wrong), left_out) if left_out else (measured, ())


def _named(measured: MeasuredMachine, readings: Readings, judged: GatedReadings, row: int) -> LeftOutReading:
    """A wrong reading, its size that of the number that is off by the most standard deviations."""
    worst = int(np.argmax(np.abs(judged.deviation[row])))
    white, sigmas = float(np.abs(judged.deviation[row, worst])), float(judged.sigmas[row])
    name, of = measured.line_of(readings, row)
    if isinstance(readings, ToolCoordinates):
        size, visit = white * float(readings.sigma[row, worst]), int(readings.visit[row])
        times = measured.conditions.get("t_rig_s")
        return LeftOutReading(
            name, of, size, "rad" if readings.coordinates[worst] > 2 else "m", sigmas, MODEL,
            int(measured.number[visit]), None if times is None else float(times[visit]),
        )  # fmt: skip
    return LeftOutReading(name, of, white * float(readings.sigma_m[row]), "m", sigmas, MODEL)  # type: ignore[attr-defined]
