"""What a campaign visits, in which order: decided before the first move, from a seed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from calibration.compensation import nominal_drives
from calibration.machine import Array, Machine
from calibration.toml_file import InputError
from pkm_rig.config import CampaignSettings

POSE_STREAM, ORDER_STREAM, VERIFICATION_STREAM = 1, 2, 3


@dataclass(frozen=True)
class PlannedVisit:
    """One visit: approach the pose from one side, dwell, measure.

    pose: number of the target; pass_: how often it was planned before; target_m (6,) commanded coordinates;
    drives_m (d,) commanded drive positions; direction +1 or -1: the side every drive comes from.
    """

    pose: int
    pass_: int
    target_m: Array
    drives_m: Array
    payload: int
    direction: int
    speed_m_per_s: float
    dwell_s: float


@dataclass(frozen=True)
class Block:
    """Visits at one payload."""

    payload: int
    visits: tuple[PlannedVisit, ...]


def calibration_blocks(machine: Machine, settings: CampaignSettings) -> tuple[Block, ...]:
    """Blocks without, with and again without payload, poses in random order within each.

    Without payload every target is visited three times from the same side, for the noise floor: once in each of the
    two blocks, half of the targets again in the first and half in the last. With payload it is
    approached from the other side. Sides alternate from target to target.
    """
    targets = calibration_targets(machine, settings)
    numbers = list(range(len(targets)))
    half = len(numbers) // 2
    side = {n: 1 if n % 2 else -1 for n in numbers}
    first = [(n, side[n]) for n in numbers + numbers[:half]]
    loaded = [(n, -side[n]) for n in numbers]
    last = [(n, side[n]) for n in numbers + numbers[half:]]
    rng = np.random.default_rng([settings.seed, ORDER_STREAM])
    passes: dict[int, int] = {}
    return tuple(
        _block(machine, settings, targets, payload, wanted, rng, passes)
        for payload, wanted in ((0, first), (settings.loaded_payload, loaded), (0, last))
    )


def verification_block(machine: Machine, settings: CampaignSettings, payload: int) -> Block:
    """Verification poses at one payload: off the calibration targets, a quarter on the workspace's edge.

    They follow from the campaign's seed, which is fixed before the fit.
    """
    rng = np.random.default_rng([settings.seed, VERIFICATION_STREAM])
    count = settings.verification_poses
    unit = rng.uniform(0.0, 1.0, (count, 2))
    on_edge = np.arange(count) % 4 == 0
    edge_axis = rng.integers(0, 2, count)
    edge_side = rng.integers(0, 2, count).astype(float)
    unit[on_edge, edge_axis[on_edge]] = edge_side[on_edge]
    targets = _in_workspace(machine, unit)
    wanted = [(n, 1 if n % 2 else -1) for n in range(count)]
    return _block(machine, settings, targets, payload, wanted, rng, {})


def calibration_targets(machine: Machine, settings: CampaignSettings) -> Array:
    """Targets (n, 6): a Sobol sequence drawn towards the workspace's edges, where poses inform most."""
    sobol = qmc.Sobol(2, seed=np.random.default_rng([settings.seed, POSE_STREAM]))
    count = settings.calibration_poses
    unit = sobol.random_base2(int(np.ceil(np.log2(count))))[:count]
    return _in_workspace(machine, 0.5 - 0.5 * np.cos(np.pi * unit))


def _in_workspace(machine: Machine, unit: Array) -> Array:
    low, high = machine.commanded_limits.T
    targets = np.zeros((len(unit), 6))
    targets[:, machine.commanded] = low + (high - low) * unit
    return targets


def commanded_drives(machine: Machine, targets: Array) -> Array:
    """Commanded drive positions (n, d) of targets (n, 6): the nominal machine's, within the travel."""
    drives = nominal_drives(machine, targets)
    low, high = machine.travel.T
    if not np.all((drives >= low) & (drives <= high)):
        raise InputError(f"machine {machine.name}: its workspace needs more than its drives' travel")
    return drives


def _block(
    machine: Machine,
    settings: CampaignSettings,
    targets: Array,
    payload: int,
    wanted: list[tuple[int, int]],
    rng: np.random.Generator,
    passes: dict[int, int],
) -> Block:
    drives = commanded_drives(machine, targets)
    visits = []
    for i in rng.permutation(len(wanted)):
        pose, direction = wanted[i]
        passes[pose] = passes.get(pose, -1) + 1
        visits.append(
            PlannedVisit(
                pose,
                passes[pose],
                targets[pose],
                drives[pose],
                payload,
                direction,
                float(rng.choice(settings.speeds_m_per_s)),
                float(rng.choice(settings.dwells_s)),
            )
        )
    return Block(payload, tuple(visits))
