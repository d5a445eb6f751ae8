"""Whether drive coordinates fit the machine that they are said to be of: a wrong step size is found and named.

Step counts outlive the settings that give them a length: after a change of microsteps or gearing the stored parameters
miss their own readings by millimetres, and a fit would bend the geometry to close them.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np

from calibration.base.errors import InputError
from calibration.instruments.distances import Distances
from calibration.instruments.tool_coordinates import ToolCoordinates
from calibration.machine.equilibrium import workspace_middle
from calibration.model.model import Model
from calibration.model.parameters import ParameterSet
from calibration.recording.measurement_folder import MeasuredMachine

FACTORS = (1 / 2, 2.0, 1 / 4, 4.0, 1 / 8, 8.0, 1 / 16, 16.0, 1 / 32, 32.0)


def check_step_size(measured: MeasuredMachine) -> None:
    """Raise InputError if the nominal machine misses a measured length by more than its previous fit may.

    It names the factor of all drive coordinates that closes the readings, if one of FACTORS does. Without a previous
    fit nothing is checked.
    """
    previous_fit = measured.file.former
    if previous_fit is None:
        return
    limit = previous_fit.misses_at_most_m
    miss = nominal_residual_m(measured)
    if miss <= limit:
        return
    by = f"by {1e3 * miss:.3g} mm, more than {1e3 * limit:g} mm"
    if not np.isfinite(miss):
        by = "altogether, with no pose at some drive positions"
    misses = f"{measured.file.name}: the stored parameters miss the readings {by}"
    for factor in FACTORS:
        closed = nominal_residual_m(measured, factor)
        if closed <= limit:
            raise InputError(
                f"{misses}; {Fraction(factor)} times the step distance would close them to {1e3 * closed:.2g} mm: "
                "microsteps or gearing have changed since; calibrate the machine again, or correct the step distance"
            )
    raise InputError(
        f"{misses}, and no step distance of 1/32 to 32 times closes them: parameters and readings do not "
        "belong to the same calibration; calibrate the machine again"
    )


def nominal_residual_m(measured: MeasuredMachine, factor: float = 1.0) -> float:
    """Largest residual in m of the nominal machine with all drive coordinates times a factor; infinite without a pose.

    Only lengths are compared: coordinates in an unknown frame of an instrument cannot be.
    """
    model = Model(ParameterSet(measured.machine, ()))
    start = measured.visits.target_m
    if factor != 1.0:
        start = np.tile(workspace_middle(measured.machine), (len(start), 1))
    poses = model.predict(np.zeros(0), replace(measured.visits, drives=measured.visits.drives * factor), start)
    if not np.all(poses.equilibrium.converged):
        return float("inf")
    tool = poses.tool_m()
    worst = 0.0
    for readings in measured.readings(instrument_unknowns=False):
        if isinstance(readings, ToolCoordinates) and not readings.own_frame:
            lengths = [c for c in readings.coordinates if c < 3]
            shift = (tool[readings.visit] - readings.value[:, :3])[:, lengths]
            worst = max(worst, float(np.max(np.abs(shift), initial=0.0)))
        elif isinstance(readings, Distances):
            if readings.second is None:
                between = tool[readings.first] - np.array(readings.centre_m)
            else:
                between = tool[readings.first] - tool[readings.second]
            shift = np.sqrt(np.sum(between**2, axis=1)) - readings.distance_m
            worst = max(worst, float(np.max(np.abs(shift), initial=0.0)))
    return worst
