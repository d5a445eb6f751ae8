"""What a campaign visits, in which order: decided before the first move, from a seed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.instruments.visibility import hides_reflectors, visible
from calibration.machine.description import Machine
from calibration.machine.inverse import nominal_drives, nominal_poses
from calibration.machine.measured_poses import held_poses, measured_box
from calibration.model.payload import PayloadEntry
from pkm_rig.rig.campaign_sections import CampaignSettings
from pkm_rig.rig.led_motion import is_led, led_sides, require_clear_campaign

LEAST_TARGETS, LEAST_VISITS = 6, 2
MOST_DRAWS = 6
Point = tuple[float, float, float]
POSE_STREAM, ORDER_STREAM, VERIFICATION_STREAM = 1, 2, 3


@dataclass(frozen=True)
class PlannedVisit:
    """One visit: approach the pose from one side, dwell, measure.

    pose: number of the target; pass_: how often it was planned before; target_m (6,) commanded coordinates;
    drives_m (d,) commanded drive positions; direction (d,) +1 or -1: the side each drive comes from.
    """

    pose: int
    pass_: int
    target_m: Array
    drives_m: Array
    payload: int
    direction: tuple[int, ...]
    speed_m_per_s: float
    dwell_s: float


@dataclass(frozen=True)
class Block:
    """Visits at one payload."""

    payload: int
    visits: tuple[PlannedVisit, ...]


def calibration_blocks(
    machine: Machine, settings: CampaignSettings, station_m: Point | None = None
) -> tuple[Block, ...]:
    """Blocks without, with and again without payload, poses in random order within each.

    Without payload every target is visited three times from the same side, for the noise floor: once in each of the
    two blocks, half of the targets again in the first and half in the last. With payload it is
    approached from the other side. Sides alternate from target to target. Visits that the settings give one by one are
    made in their order instead.
    """
    if settings.visits:
        return _blocks_of_listed_visits(machine, settings)
    targets = calibration_targets(machine, settings, station_m)
    numbers = list(range(len(targets)))
    half = len(numbers) // 2
    side = {n: 1 if n % 2 else -1 for n in numbers}
    first = [(n, side[n]) for n in numbers + numbers[:half]]
    loaded = [(n, -side[n]) for n in numbers]
    last = [(n, side[n]) for n in numbers + numbers[half:]]
    rng = np.random.default_rng([settings.seed, ORDER_STREAM])
    passes: dict[int, int] = {}
    return tuple(
        _block(machine, settings, targets, payload, pose_directions, rng, passes)
        for payload, pose_directions in ((0, first), (settings.loaded_payload, loaded), (0, last))
    )


def verification_block(
    machine: Machine, settings: CampaignSettings, payload: int, station_m: Point | None = None
) -> Block:
    """Verification poses at one payload: off the calibration targets, a quarter on the workspace's faces.

    Poses that the drives do not reach are drawn again. All follow from the campaign's seed, which is fixed before the
    fit.
    """
    rng = np.random.default_rng([settings.seed, VERIFICATION_STREAM])
    count = settings.verification_poses
    parts: list[Array] = []
    while sum(len(part) for part in parts) < count:
        if len(parts) == MOST_DRAWS:
            raise _hardly_reachable(machine)
        unit = rng.uniform(0.0, 1.0, (count, machine.commanded.size))
        on_edge = np.arange(count) % 4 == 0
        edge_axis = rng.integers(0, machine.commanded.size, count)
        edge_side = rng.integers(0, 2, count).astype(float)
        unit[on_edge, edge_axis[on_edge]] = edge_side[on_edge]
        parts.append(usable_targets(machine, _in_workspace(machine, unit), settings.approach_m, station_m))
    targets = np.concatenate(parts)[:count]
    pose_directions = [(n, 1 if n % 2 else -1) for n in range(count)]
    return _block(machine, settings, targets, payload, pose_directions, rng, {})


def calibration_targets(machine: Machine, settings: CampaignSettings, station_m: Point | None = None) -> Array:
    """Targets (n, 6): those of the settings, else a Sobol sequence drawn towards the edges, where poses inform most."""
    if settings.targets:
        return _listed_targets(machine, settings.targets)
    from scipy.stats import qmc  # noqa: PLC0415  # slow to load, and a rig may be refused before poses are drawn

    count = settings.calibration_poses
    exponent = int(np.ceil(np.log2(count)))
    for more in range(MOST_DRAWS):
        sobol = qmc.Sobol(machine.commanded.size, seed=np.random.default_rng([settings.seed, POSE_STREAM]))
        unit = sobol.random_base2(exponent + more)
        targets = _in_workspace(machine, 0.5 - 0.5 * np.cos(np.pi * unit))
        targets = usable_targets(machine, targets, settings.approach_m, station_m)
        if len(targets) >= count:
            return targets[:count]
    raise _hardly_reachable(machine)


def require_reachable_poses(
    machine: Machine, settings: CampaignSettings, payloads: Sequence[PayloadEntry], station_m: Point
) -> None:
    """Raise InputError unless calibration and verification have poses that the drives reach, by ways that are clear."""
    blocks = [*calibration_blocks(machine, settings, station_m)]
    blocks += [verification_block(machine, settings, payload, station_m) for payload in settings.verification_payloads]
    for block in blocks:
        load = payloads[block.payload]
        require_clear_campaign(
            machine,
            settings,
            [(visit.target_m, visit.direction[0], load.mass_kg, load.com_m) for visit in block.visits],
        )


def require_measured_verification(machine: Machine, settings: CampaignSettings, station_m: Point) -> None:
    """Raise InputError where verification would ask for a correction beyond the poses that calibration measures."""
    if settings.visits or not settings.verification_payloads:
        return
    measured = measured_box(machine, calibration_targets(machine, settings, station_m))
    wanted = verification_block(machine, settings, settings.verification_payloads[0], station_m)
    try:
        held_poses(machine, measured, np.array([visit.target_m for visit in wanted.visits]))
    except InputError as error:
        raise InputError(
            f"campaign: verification poses lie beyond its calibration_poses; give more of these ({error})"
        ) from error


def usable_targets(machine: Machine, targets: Array, margin: float, station_m: Point | None = None) -> Array:
    """Those of the targets (n, 6) that the drives reach and at which a station at a point sees all reflectors.

    InputError where it never sees one of them.
    """
    reached = _reached(machine, targets, margin)
    if station_m is None or not hides_reflectors(machine) or not len(reached):
        return reached
    seen = visible(machine, np.array(station_m), reached, nominal_drives(machine, reached))
    never = np.flatnonzero(~seen.any(axis=0))
    if never.size:
        raise InputError(
            f"station: from its place it never sees reflector {machine.smrs[never[0]].name} of {machine.name}, which "
            "looks elsewhere or is behind a strut; move the station, or the reflector"
        )
    return np.asarray(reached[seen.all(axis=1)])


def _reached(machine: Machine, targets: Array, margin: float) -> Array:
    """Those of the targets (n, 6) that all drives reach, and `margin` (m or rad) beyond, within their travel.

    All of them where tables compensate: the whole workspace must then be within the travel.
    """
    if machine.drive_kinds == ("slider", "slider"):
        return targets
    drives = nominal_drives(machine, targets)
    low, high = machine.travel.T
    return targets[np.all((drives >= low + margin) & (drives <= high - margin), axis=1)]


def _hardly_reachable(machine: Machine) -> InputError:
    return InputError(
        f"machine {machine.name}: hardly any of its workspace is within the travel of its drives and in the station's "
        "sight; make [workspace] smaller or the travel longer, or move the station"
    )


def _listed_targets(machine: Machine, chosen: tuple[tuple[float, ...], ...]) -> Array:
    """Platform poses (n, 6) of tool poses given by their commanded coordinates; InputError outside the workspace."""
    poses = _inside(machine, chosen, "campaign.targets: row")
    if len(chosen) < LEAST_TARGETS:
        raise InputError(f"campaign.targets: {len(chosen)} poses; give {LEAST_TARGETS} or more")
    return poses


def _inside(machine: Machine, rows: Sequence[tuple[float, ...]], what: str) -> Array:
    size = machine.commanded.size
    for number, row in enumerate(rows, start=1):
        if len(row) != size:
            raise InputError(f"{what} {number} has {len(row)} numbers; the machine commands {size}")
    low, high = machine.commanded_limits.T
    values = np.array(rows)
    outside = np.flatnonzero(~np.all((values >= low - 1e-9) & (values <= high + 1e-9), axis=1))
    if outside.size:
        raise InputError(f"{what} {outside[0] + 1} lies outside the workspace of {machine.name}")
    return nominal_poses(machine, values)


def _blocks_of_listed_visits(machine: Machine, settings: CampaignSettings) -> tuple[Block, ...]:
    """Visits as they are given, a block wherever the payload changes; equal targets are one pose."""
    visits, count = settings.visits, len(machine.drive_names)
    if len(visits) < LEAST_VISITS:
        raise InputError(f"campaign.visits: {len(visits)} visit; give {LEAST_VISITS} or more")
    for number, visit in enumerate(visits, start=1):
        one_side = is_led(machine, settings) and len(visit.direction) == 1
        if visit.direction and len(visit.direction) != count and not one_side:
            raise InputError(f"campaign.visits: visit {number} has {len(visit.direction)} sides for {count} drives")
    targets = _inside(machine, [visit.target for visit in visits], "campaign.visits: visit")
    drives = commanded_drives(machine, targets)
    poses: dict[tuple[float, ...], int] = {}
    passes: dict[int, int] = {}
    blocks: list[tuple[int, list[PlannedVisit]]] = []
    for number, visit in enumerate(visits):
        pose = poses.setdefault(visit.target, len(poses))
        passes[pose] = passes.get(pose, -1) + 1
        if not blocks or blocks[-1][0] != visit.payload:
            blocks.append((visit.payload, []))
        blocks[-1][1].append(
            PlannedVisit(
                pose=pose,
                pass_=passes[pose],
                target_m=targets[number],
                drives_m=drives[number],
                payload=visit.payload,
                direction=_listed_sides(machine, settings, targets[number], visit.direction, number),
                speed_m_per_s=settings.speeds_m_per_s[0] if visit.speed_m_per_s is None else visit.speed_m_per_s,
                dwell_s=settings.dwells_s[0] if visit.dwell_s is None else visit.dwell_s,
            )
        )
    return tuple(Block(payload, tuple(planned)) for payload, planned in blocks)


def sides(machine: Machine, settings: CampaignSettings, target_m: Array, side: int) -> tuple[int, ...]:
    """Side that each drive comes from on an approach to a pose (6,) from a side: led drives follow the tool."""
    if is_led(machine, settings):
        return led_sides(machine, target_m, side, settings.approach_m)
    return (side,) * len(machine.drive_names)


def _listed_sides(
    machine: Machine, settings: CampaignSettings, target_m: Array, given: tuple[int, ...], number: int
) -> tuple[int, ...]:
    if not is_led(machine, settings):
        return given or (1,) * len(machine.drive_names)
    if len(set(given)) > 1 and tuple(given) not in (sides(machine, settings, target_m, side) for side in (1, -1)):
        raise InputError(
            f"campaign.visits: visit {number + 1}: led drives come from where the tool comes from: give all 1 or all -1"
        )
    return given if len(set(given)) > 1 else sides(machine, settings, target_m, given[0] if given else 1)


def _in_workspace(machine: Machine, unit: Array) -> Array:
    low, high = machine.commanded_limits.T
    return nominal_poses(machine, low + (high - low) * unit)


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
    pose_directions: list[tuple[int, int]],
    rng: np.random.Generator,
    passes: dict[int, int],
) -> Block:
    drives = commanded_drives(machine, targets)
    visits = []
    for i in rng.permutation(len(pose_directions)):
        pose, direction = pose_directions[i]
        passes[pose] = passes.get(pose, -1) + 1
        visits.append(
            PlannedVisit(
                pose=pose,
                pass_=passes[pose],
                target_m=targets[pose],
                drives_m=drives[pose],
                payload=payload,
                direction=sides(machine, settings, targets[pose], direction),
                speed_m_per_s=float(rng.choice(settings.speeds_m_per_s)),
                dwell_s=float(rng.choice(settings.dwells_s)),
            )
        )
    return Block(payload, tuple(visits))
