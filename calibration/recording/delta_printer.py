"""A linear delta of Klipper's as a machine with measurements.

Three carriages hang from their endstops: the drive coordinate is the distance of each below its own, along -z. One
strut per carriage represents its pair of arms; the tool point is the origin of a platform that does not turn. The
nominal geometry is the owner's last fit. Positions of the joints are in the frame of the bed: z is the height above it.
"""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array
from calibration.machine.description import Machine, parse_machine
from calibration.machine.equilibrium import make_conditions, solve, workspace_middle
from calibration.model.visits import Visits
from calibration.recording.klipper import TOWERS, DeltaPrinter
from calibration.recording.measurement_folder import MeasuredMachine
from calibration.recording.measurement_header import (
    BedEntry,
    ColumnEntry,
    DistancesEntry,
    MeasurementFile,
    PreviousFitEntry,
    QuantityEntry,
)

BOWL_U_M = 1e-4  # heated beds and glass on clips bow by as much
BED_SHARE = 0.8  # of the delta radius: as far out as a printer probes, roughly
HEIGHT_SD_M = 3e-5  # a probe repeats to 10 to 20 um, a glass bed is flat to some tens of um
DISTANCE_SD_M = 5e-5  # a calliper on printed edges
LENGTH_U_M = 5e-5  # zero of the calliper, width of the printed line
SCALE_U = 3e-3  # plastic shrinks by some 0.3 %
NOMINAL_MISSES_M = 1e-3  # a stored fit misses its own readings by some 0.1 mm

# Half-widths. The places of the joints, and the arms where distances were measured, come from a fit of these very
# readings: a tight tolerance would let each reading confirm itself. The tolerance is therefore wide enough to constrain
# only what no reading determines (the frame on the bed).
FITTED_M = 0.05
ARM_M = 3e-3  # arms that were cut to length and taken over as they were specified
RAIL_RAD = 5e-3  # a rail leaning by 1 mm in 200 mm
SCALE = 1e-3  # a toothed belt's pitch under tension

_MACHINE = """\
# Linear delta printer: three carriages on vertical rails, each with a pair of arms, here one strut. Exactly
# constrained, and no load is known: stiffness decides nothing. Temperatures were not recorded: nothing expands.
format = 1
name = "{name}"
degrees_of_freedom = ["x", "y", "z"]
gravity_m_per_s2 = [0.0, 0.0, -9.80665]
reference_temperature_c = 20.0

[platform]
tool_point_m = [0.0, 0.0, 0.0]
moving_mass_kg = 0.0
centre_of_mass_m = [0.0, 0.0, 0.0]

[workspace]                        # above the bed
x_m = [{low!r}, {high!r}]
y_m = [{low!r}, {high!r}]
z_m = [0.0, {high!r}]
{drives}{struts}
[tolerances]                       # half-widths
strut_length_m = {arm!r}
platform_joint_m = 1.0e-6          # cannot be told from the base joints: the platform does not turn
base_joint_m = {joint!r}                # fitted to these readings: nothing else is to hold them
axis_tilt_rad = {rail!r}
drive_scale = {scale!r}
ln_stiffness = 0.1
smr_position_m = 1.0e-3
{expansion}"""
_DRIVE = """
[[drives]]
name = "{name}"
kind = "slider"
axis = [0.0, 0.0, -1.0]            # the coordinate is how far the carriage stands below its endstop
branch = -1
travel_m = [-0.01, {travel!r}]
"""
_STRUT = """
[[struts]]
name = "{name}"
drive = "{name}"
platform_joint_m = [0.0, 0.0, 0.0]
base_joint_m = [{x!r}, {y!r}, {z!r}]
length_m = {arm!r}
stiffness_n_per_m = 1.0e6
"""
_PART = """
[expansion.{part}]
coefficient_per_k = 0.0
u_per_k = 0.0
sensor = "{part}"
"""


def machine_with_measurements(printer: DeltaPrinter, name: str, source: str) -> MeasuredMachine:
    """The machine that the stored parameters describe, with its probed heights and measured distances."""
    machine = parse_machine(machine_text(printer, name), f"{source} as a machine")
    heights, distances = len(printer.height_m), len(printer.distance_m)
    drives = np.concatenate([printer.height_steps, printer.first_steps, printer.second_steps]) * printer.step_m
    n = len(drives)
    coordinates = np.full((n, 6), np.nan)
    coordinates[:heights, 2] = printer.height_m
    first = heights + np.arange(distances)
    file = MeasurementFile(
        format=1,
        name=name,
        source=source,
        unknowns=("strut_length", "base_joint", "axis_tilt", "drive_scale"),
        columns={"z_m": ColumnEntry(sd=HEIGHT_SD_M)},
        bed=BedEntry(bowl_u_m=BOWL_U_M, radius_m=BED_SHARE * printer.radius_m),
        distances=DistancesEntry(sd_m=DISTANCE_SD_M, length_u_m=LENGTH_U_M, scale_u=SCALE_U) if distances else None,
        former=PreviousFitEntry(
            parameters=9 if distances else 6,
            unknowns=("base_joint", "strut_length") if distances else ("base_joint",),
            misses_at_most_m=NOMINAL_MISSES_M,
        ),
        quantities=_quantities(printer),
    )
    pairs = np.column_stack([first, first + distances]).astype(np.float64)
    visits = Visits.at_reference_temperature(machine, drives, _targets(machine, drives))
    return MeasuredMachine(
        file, machine, visits, np.arange(n, dtype=np.float64), coordinates, pairs, printer.distance_m
    )


def machine_text(printer: DeltaPrinter, name: str) -> str:
    """The machine file of a printer."""
    steps = np.concatenate([printer.height_steps, printer.first_steps, printer.second_steps])
    lowest = np.max(steps * printer.step_m, axis=0)
    drives, struts = "", ""
    for i, tower in enumerate(printer.towers):
        x, y = printer.radius_m * np.cos(tower.angle_rad), printer.radius_m * np.sin(tower.angle_rad)
        z = printer.endstop_height_m[i]
        travel = round(max(float(z), float(lowest[i])) + 0.01, 3)
        drives += _DRIVE.format(name=TOWERS[i], travel=travel)
        struts += _STRUT.format(name=TOWERS[i], x=float(x), y=float(y), z=float(z), arm=tower.arm_m)
    return _MACHINE.format(
        name=name,
        low=-printer.probed_radius_m,
        high=printer.probed_radius_m,
        drives=drives,
        struts=struts,
        arm=FITTED_M if len(printer.distance_m) else ARM_M,
        joint=FITTED_M,
        rail=RAIL_RAD,
        scale=SCALE,
        expansion="".join(_PART.format(part=part) for part in ("struts", "drives", "base", "platform")),
    )


def _targets(machine: Machine, drives: Array) -> Array:
    """Nominal poses (n, 6), where there is one: searches start there."""
    at = solve(machine, machine.nominal, drives, make_conditions(machine, len(drives)).without_loads())
    return np.where(at.converged[:, None], np.nan_to_num(at.coordinates()), workspace_middle(machine))


def _quantities(printer: DeltaPrinter) -> tuple[QuantityEntry, ...]:
    """The owner's parameters and their derivatives with the joints' places.

    Tower i at R (cos a, sin a) moves by d: its distance from the centre m by u.(d - m), across by v.(d - m). The
    centre follows so that all distances stay equal, u_i.(d_i - m) = dR; the third tower keeps its angle by a turn of
    the frame.
    """
    angles = np.array([t.angle_rad for t in printer.towers])
    u = np.column_stack([np.cos(angles), np.sin(angles)])
    v = np.column_stack([-np.sin(angles), np.cos(angles)])
    # Unknown (dR, m_x, m_y) = solve(A) (u_i.d_i): rows are derivatives with u_i.d_i.
    centre = np.linalg.inv(np.column_stack([np.ones(3), u]))
    radius = centre[0]
    turn = np.zeros((3, 6))  # of each tower about the centre, by the six coordinates d
    for i in range(3):
        turn[i, 2 * i : 2 * i + 2] += v[i]
        for k in range(3):
            turn[i, 2 * k : 2 * k + 2] -= (v[i] @ centre[1:, k]) * u[k]
    turn /= printer.radius_m
    places = [f"base_joint.{name}.{axis}" for name in TOWERS for axis in "xy"]
    by_radius = {places[2 * k + c]: float(radius[k] * u[k, c]) for k in range(3) for c in range(2)}
    out = [QuantityEntry(name="delta_radius", unit="m", nominal=printer.radius_m, of=by_radius)]
    for i, tower in enumerate(printer.towers):
        name, arm = TOWERS[i], tower.arm_m
        rise = float(np.sqrt(arm**2 - printer.radius_m**2))
        # endstop = E - sqrt(arm^2 - R^2)
        of = {f"base_joint.{name}.z": 1.0, f"strut_length.{name}": -arm / rise}
        of |= {place: w * printer.radius_m / rise for place, w in by_radius.items()}
        out.append(QuantityEntry(name=f"stepper_{name} position_endstop", unit="m", nominal=tower.endstop_m, of=of))
        if i < 2:
            swing = turn[i] - turn[2]
            turned = {p: float(w) for p, w in zip(places, swing, strict=True)}
            out.append(QuantityEntry(name=f"stepper_{name} angle", unit="rad", nominal=tower.angle_rad, of=turned))
        if len(printer.distance_m):
            of = {f"strut_length.{name}": 1.0}
            out.append(QuantityEntry(name=f"stepper_{name} arm_length", unit="m", nominal=arm, of=of))
    return tuple(out)
