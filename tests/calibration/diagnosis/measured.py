"""Measurement folders of shipped machines in memory, with errors in the machine and in its drives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from calibration.base.rotation import rotation_matrix, rotation_vector
from calibration.machine.description import Machine, load_machine, shipped_machine
from calibration.machine.inverse import rigid_drives
from calibration.model.model import Model
from calibration.model.parameters import ParameterSet
from calibration.model.visits import Visits
from calibration.recording.measurement_conditions import CENTRE, FORCE, PAYLOAD, POINT, with_loads
from calibration.recording.measurement_folder import COLUMNS, MeasuredMachine
from calibration.recording.measurement_header import ColumnEntry, DistancesEntry, MeasurementFile

SD = 5e-6
Shift = Callable[[np.ndarray, np.ndarray], np.ndarray]  # of the drives (v, d), by their coordinates and sides


@dataclass(frozen=True)
class Wanted:
    """What is measured of a machine, and what its drives do."""

    machine: str = "delta6"
    columns: Sequence[str] = ()
    pairs: int = 0
    ball_m: tuple[float, float, float] | None = None
    visits: int = 120
    seed: int = 1
    shift: Shift = field(default=lambda drives, sides: np.zeros_like(drives))
    sides: bool = False
    turned: tuple[float, float, float] | None = None  # of the instrument's own frame
    noise: float = 1.0  # over what the folder states
    load: Callable[[Machine, int], dict[str, np.ndarray]] = field(default=lambda machine, count: {})


def made(wanted: Wanted) -> MeasuredMachine:
    """A machine with drawn errors within its tolerances, measured with a deviation of 5 um or urad, times noise."""
    machine, rng = load_machine(shipped_machine(wanted.machine)), np.random.default_rng(wanted.seed)
    count, model = wanted.visits, Model(ParameterSet.of(machine))
    target = rng.uniform(*machine.workspace.T, (2 * count, 6))
    drives = rigid_drives(machine, machine.nominal, target)
    reached = np.flatnonzero(np.all(np.isfinite(drives), axis=1))[:count]  # a corner of the workspace may be too far
    target, drives = target[reached], drives[reached]
    said = wanted.load(machine, len(target))
    visits = with_loads(Visits.at_reference_temperature(machine, drives, target), said)
    errors = model.parameters.sigma * rng.normal(0.0, 1.0, len(model))
    errors[model.parameters.rows("ln_stiffness")] = 0.0
    sides = rng.choice([-1.0, 1.0], drives.shape)
    poses = model.predict(errors, replace(visits, drives=drives + wanted.shift(drives, sides)), target)
    tool, turn = poses.tool_m(), poses.equilibrium.rotation
    if wanted.turned is not None:
        own = rotation_matrix(np.array(wanted.turned))
        tool, turn = tool @ own.T + 0.01, own @ turn
    true = np.concatenate([tool, rotation_vector(turn)], axis=1)
    coordinates = np.full((count, 6), np.nan)
    for column in wanted.columns:
        c = COLUMNS.index(column)
        coordinates[:, c] = true[:, c] + rng.normal(0.0, wanted.noise * SD, count)
    pairs = np.zeros((0, 2))
    second = np.zeros((0, 3))
    if wanted.ball_m is not None:
        pairs, second = np.arange(count, dtype=np.float64)[:, None], np.tile(wanted.ball_m, (count, 1))
    elif wanted.pairs:
        first = rng.integers(0, count, wanted.pairs)
        pairs = np.column_stack([first, (first + rng.integers(1, count, wanted.pairs)) % count]).astype(np.float64)
        second = poses.tool_m()[pairs[:, 1].astype(int)]
    distance = np.linalg.norm(poses.tool_m()[pairs[:, 0].astype(int)] - second, axis=1)
    file = MeasurementFile(
        format=1,
        name="measured",
        own_frame=wanted.turned is not None,
        columns={column: ColumnEntry(sd=SD) for column in wanted.columns},
        distances=DistancesEntry(sd_m=SD, centre_m=wanted.ball_m, centre_u_m=1e-3 if wanted.ball_m else 0.0)
        if len(pairs)
        else None,
    )
    if wanted.sides:
        said |= {f"{name}_direction": sides[:, a] for a, name in enumerate(machine.drive_names)}
    distance = distance + rng.normal(0.0, wanted.noise * SD, len(distance))
    return MeasuredMachine(
        file, machine, visits, np.arange(count, dtype=np.float64), coordinates, pairs, distance, said
    )


def payloads(machine: Machine, count: int) -> dict[str, np.ndarray]:
    """None, or 20 kg beside the tool's point, every other visit."""
    mass = np.where(np.arange(count) % 2, 20.0, 0.0)
    return {PAYLOAD: mass, **{name: np.full(count, 0.01) for name in CENTRE}}


def forces(machine: Machine, count: int) -> dict[str, np.ndarray]:
    """None, or 200 N as by such a weight, every other visit."""
    along = machine.gravity_m_per_s2 / np.linalg.norm(machine.gravity_m_per_s2)
    force = np.where(np.arange(count) % 2, 200.0, 0.0)[:, None] * along
    return {name: force[:, k] for k, name in enumerate(FORCE)} | {name: np.full(count, 0.01) for name in POINT}


def wave(drives: np.ndarray, _: np.ndarray) -> np.ndarray:
    """30 um along the travel of the first drive."""
    way = (drives[:, :1] - drives[:, :1].min()) / np.ptp(drives[:, 0])
    return np.where(np.arange(drives.shape[1]) == 0, 3e-5 * np.sin(2.6 * np.pi * way + 0.4), 0.0)


def play(drives: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """Backlash of 60 um at the second drive; at one of three, 40 um are no more than twice what rigs may well have."""
    return -3e-5 * sides * (np.arange(drives.shape[1]) == 1)
