"""Plausibility checks of readings before any fit."""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.instruments.smr_positions import ReflectorObservations
from calibration.machine.description import COORDINATES, Machine

LEAST_VISITS = 20  # of a diagnosis
MIN_SPREAD = 0.25  # of the workspace, in every commanded coordinate
SPACING_ERROR = 0.05  # relative, between reflectors; mountings err by millimetres at most
THOUSANDS = {1e3: "in millimetres", 1e-3: "in kilometres"}


def check_units(machine: Machine, observations: ReflectorObservations) -> None:
    """Refuse wrong units of drives and positions and mixed up reflectors; InputError in one line."""
    _check_drives(machine, observations.visits.drives)
    _check_spacing(machine, observations)


def _check_drives(machine: Machine, drives: Array) -> None:
    """Within the travel, with a tenth of it to spare."""
    low, high = machine.travel.T
    spare = 0.1 * (high - low)
    outside = np.argwhere((drives < low - spare) | (drives > high + spare))
    if not outside.size:
        return
    visit, drive = outside[0]
    middle = float(np.median(np.abs(drives[:, drive])) / np.mean(np.abs(machine.travel[drive])))
    unit = "rad" if machine.drive_kinds[drive] == "crank" else "m"
    guess = next((f"; it looks as if it were {what}" for k, what in THOUSANDS.items() if 0.3 < middle / k < 3.0), "")
    raise InputError(
        f"drive {machine.drive_names[drive]}: {drives[visit, drive]:g} {unit} at visit {visit} is beyond its travel "
        f"{low[drive]:g} to {high[drive]:g} {unit}{guess}; check its unit and sign"
    )


def _check_spacing(machine: Machine, observations: ReflectorObservations) -> None:
    """Distances between the platform's reflectors, measured in one visit, against the machine file."""
    on_platform = [i for i, s in enumerate(machine.smrs) if s.on == "platform" and np.any(observations.smr == i)]
    place = {i: np.full((len(observations.visits), 3), np.nan) for i in on_platform}
    for i in on_platform:
        rows = observations.smr == i
        place[i][observations.visit[rows]] = observations.position_m[rows]
    for k, i in enumerate(on_platform):
        for j in on_platform[k + 1 :]:
            apart = np.linalg.norm(place[i] - place[j], axis=1)
            apart = apart[np.isfinite(apart)]
            nominal = float(np.linalg.norm(machine.smrs[i].position_m - machine.smrs[j].position_m))
            if not apart.size or nominal == 0.0:
                continue
            ratio = float(np.median(apart)) / nominal
            names = f"reflectors {machine.smrs[i].name} and {machine.smrs[j].name}"
            for factor, what in THOUSANDS.items():
                if abs(ratio / factor - 1.0) < SPACING_ERROR:
                    raise InputError(f"{names} are {ratio * nominal:g} m apart: positions are {what}; state metres")
            if abs(ratio - 1.0) > SPACING_ERROR:
                raise InputError(
                    f"{names} are {ratio * nominal:.4g} m apart, {nominal:.4g} m in the machine file; "
                    "check which reflector is which and where they are mounted"
                )


def require_enough_poses(machine: Machine, target_m: Array) -> None:
    """Refuse too few different poses (v, 6)."""
    n_required = 2 * machine.dof.size
    n_poses = len(np.unique(np.round(target_m, 9), axis=0))
    if n_poses < n_required:
        raise InputError(
            f"{n_poses} different poses are too few for machine {machine.name}; measure {n_required} or more"
        )


def require_enough_visits(machine: Machine, target_m: Array) -> None:
    """Refuse too few poses, and too few visits (v, 6) for a diagnosis."""
    require_enough_poses(machine, target_m)
    if len(target_m) < LEAST_VISITS:
        raise InputError(f"{len(target_m)} visits are too few for a diagnosis; measure {LEAST_VISITS} or more")


def require_spread_poses(machine: Machine, target_m: Array) -> None:
    """Refuse too few poses (v, 6), and poses from one corner: elsewhere in the workspace a fit would extrapolate."""
    require_enough_poses(machine, target_m)
    for c in machine.commanded:
        width = float(np.ptp(machine.workspace[c]))
        covered = float(np.ptp(target_m[:, c])) / width if width > 0.0 else 1.0
        if covered < MIN_SPREAD:
            raise InputError(
                f"all poses lie in one corner: {COORDINATES[c]} covers {100.0 * covered:.0f} % of the workspace; "
                "measure over all of it, or narrow [workspace] in the machine file"
            )
