"""Whether drive coordinates fit the machine that they are said to be of: a wrong step size is found and named.

Step counts outlive the settings that give them a length: after a change of microsteps or gearing the stored parameters
miss their own readings by millimetres, and a fit would bend the geometry to close them.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.identification.gate import SUSPECTS
from calibration.instruments.distances import Distances
from calibration.instruments.readings import Readings
from calibration.instruments.tool_coordinates import ToolCoordinates
from calibration.machine.equilibrium import workspace_middle
from calibration.model.model import Model
from calibration.model.parameters import ParameterSet
from calibration.recording.measurement_folder import MeasuredMachine

FACTORS = (1 / 2, 2.0, 1 / 4, 4.0, 1 / 8, 8.0, 1 / 16, 16.0, 1 / 32, 32.0)


def check_step_size(measured: MeasuredMachine) -> dict[str, float]:
    """Raise InputError if the nominal machine misses the measured lengths by more than its previous fit may.

    It names the factor of all drive coordinates that closes the readings, if one of FACTORS does. A few readings may be
    missed, so many as the gate may leave out: returned are their files and lines, with how far they are off in m. It is
    for the gate to say whether they are wrong. Without a previous fit nothing is checked.
    """
    previous_fit = measured.file.former
    if previous_fit is None:
        return {}
    limit = previous_fit.misses_at_most_m
    misses = nominal_misses_m(measured)
    missed = {line: miss for line, miss in misses.items() if not miss <= limit}
    if len(missed) <= np.ceil(SUSPECTS * len(misses)):
        return missed
    miss = max(misses.values())
    by = f"by {1e3 * miss:.3g} mm, more than {1e3 * limit:g} mm"
    if not np.isfinite(miss):
        by = "altogether, with no pose at some drive positions"
    misses_by = f"{measured.file.name}: the stored parameters miss the readings {by}"
    for factor in FACTORS:
        closed = max(nominal_misses_m(measured, factor).values())
        if closed <= limit:
            raise InputError(
                f"{misses_by}; {Fraction(factor)} times the step distance would close them to {1e3 * closed:.2g} mm: "
                "microsteps or gearing have changed since; calibrate the machine again, or correct the step distance"
            )
    raise InputError(
        f"{misses_by}, and no step distance of 1/32 to 32 times closes them: parameters and readings do not "
        "belong to the same calibration; calibrate the machine again"
    )


def nominal_misses_m(measured: MeasuredMachine, factor: float = 1.0) -> dict[str, float]:
    """How far the nominal machine is off each reading, by file and line, with all drive coordinates times a factor.

    In m, infinite without a pose. Only lengths are compared, not coordinates in an unknown frame of an instrument.
    """
    model = Model(ParameterSet(measured.machine, ()))
    start = measured.visits.target_m
    if factor != 1.0:
        start = np.tile(workspace_middle(measured.machine), (len(start), 1))
    poses = model.predict(np.zeros(0), replace(measured.visits, drives=measured.visits.drives * factor), start)
    tool = np.where(poses.equilibrium.converged[:, None], poses.tool_m(), np.inf)
    out = {}
    for readings in measured.readings(instrument_unknowns=False):
        off_m = _misses_m(readings, tool)
        for row, miss in enumerate(np.where(np.isfinite(off_m), off_m, np.inf).tolist()):
            out[measured.line_of(readings, row)[0]] = miss
    return out


def _misses_m(readings: Readings, tool_m: Array) -> Array:
    """Absolute residuals (r,) of the lengths read, the largest of a reading; zero where nothing can be compared."""
    with np.errstate(invalid="ignore"):  # of poses at infinity: infinity less infinity
        if isinstance(readings, Distances):
            second = np.array(readings.centre_m) if readings.second is None else tool_m[readings.second]
            return np.abs(np.linalg.norm(tool_m[readings.first] - second, axis=1) - readings.distance_m)
        if isinstance(readings, ToolCoordinates) and not readings.own_frame:
            lengths = [c for c in readings.coordinates if c < 3]
            shift = (tool_m[readings.visit] - readings.value[:, :3])[:, lengths]
            return np.asarray(np.max(np.abs(shift), axis=1, initial=0.0))
    return np.zeros(len(readings))
