"""What a campaign on the mock plant visits: designs, as plain data, without any wire."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mock_devices.machine_file import MachineFile


@dataclass(frozen=True)
class Visit:
    """One arrival: target of the tool in the plane, the side that each drive comes from, and how it is measured.

    `on_the_fly`: every reflector is measured while the drives run through the target at `speed_m_per_s`.
    """

    target_m: complex
    direction: tuple[int, ...]
    payload: int = 0
    speed_m_per_s: float = 0.5
    dwell_s: float = 2.0
    on_the_fly: bool = False
    pose: int = 0
    pass_: int = 0


@dataclass(frozen=True)
class StationMove:
    """The station is set up anew before a visit (counted from 0): moved in the machine's frame, turned clockwise seen
    from above. It takes a while, and nests are measured before and after."""

    before_visit: int
    by_m: tuple[float, float, float]
    turn_rad: float
    takes_s: float = 1800.0


@dataclass(frozen=True)
class Design:
    """A campaign: visits in their order, what is measured at each, and the times in between.

    `smrs` are names; floor nests are measured at the start, every `nest_every` visits, at exchanges of payload
    and at the end, as means of `nest_samples`; without `nests` never. `moves` of the station are in order.
    """

    visits: tuple[Visit, ...]
    smrs: tuple[str, ...]
    nests: tuple[str, ...] = ()
    nest_every: int = 5
    nest_samples: int = 5
    start_s: float = 3600.0
    exchange_s: float = 240.0
    approach_m: float = 0.010
    acceleration_m_per_s2: float = 2.0
    aim_s: float = 1.5
    measure_s: float = 1.0
    moves: tuple[StationMove, ...] = ()


@dataclass(frozen=True)
class DesignOptions:
    """What a drawn design varies. The defaults vary everything; a field shop's raster varies little.

    `platform_only` leaves the reflectors on sliders and the nests out. `payload_blocks` are payload numbers, visited in
    blocks of equal size; `fly_share` is the share of visits that are measured on the fly.
    """

    visits: int = 240
    poses: int = 160
    randomised: bool = True
    both_directions: bool = True
    payload_blocks: tuple[int, ...] = (0, 2, 0, 2)
    speeds_m_per_s: tuple[float, ...] = (0.1, 0.25, 0.5)
    dwells_s: tuple[float, ...] = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
    fly_share: float = 0.0
    platform_only: bool = False


def draw_design(machine: MachineFile, rng: np.random.Generator, options: DesignOptions | None = None) -> Design:
    """Visits drawn over the workspace, a tenth of them on its edge; each block of payload sees all of it."""
    options = options or DesignOptions()
    poses = _poses(machine, rng, options)
    order = [k % len(poses) for k in range(options.visits)]
    if options.randomised:
        order = [int(k) for k in rng.permutation(order)]
    blocks = len(options.payload_blocks)
    passes: dict[int, int] = {}
    visits = []
    for number, pose in enumerate(order):
        passes[pose] = passes.get(pose, -1) + 1
        sides = rng.choice([-1, 1], len(machine.sliders)) if options.both_directions else np.ones(len(machine.sliders))
        visits.append(
            Visit(
                target_m=poses[pose],
                direction=tuple(int(side) for side in sides),
                payload=options.payload_blocks[number * blocks // options.visits],
                speed_m_per_s=float(rng.choice(options.speeds_m_per_s)),
                dwell_s=float(rng.choice(options.dwells_s)),
                on_the_fly=bool(rng.random() < options.fly_share),
                pose=pose,
                pass_=passes[pose],
            )
        )
    on_platform = tuple(smr.name for smr in machine.smrs if smr.on == "platform")
    on_sliders = tuple(smr.name for smr in machine.smrs if smr.on not in ("platform", "floor"))
    nests = tuple(smr.name for smr in machine.smrs if smr.on == "floor")
    if options.platform_only:
        return Design(tuple(visits), on_platform)
    return Design(tuple(visits), (*on_platform, *on_sliders), nests)


def draw_programme(rng: np.random.Generator, swing_k: float, start_s: float, duration_s: float) -> tuple[
    tuple[float, float], ...
]:  # fmt: skip
    """Corners of a swing of the shop's temperature: up, down and back to the middle, in a drawn order of signs."""
    sign = float(rng.choice([-1.0, 1.0]))
    shares, levels = (0.0, 0.3, 0.65, 1.0), (0.0, 1.0, -0.6, 0.2)
    return tuple((start_s + s * duration_s, sign * swing_k * v) for s, v in zip(shares, levels, strict=True))


def nominal_drives(machine: MachineFile, target_m: complex) -> tuple[float, ...]:
    """Drive coordinates of a tool target by the nominal geometry, first struts (docs/reference/machine.md)."""
    drives = []
    for index, slider in enumerate(machine.sliders):
        strut = next(s for s in machine.struts if s.drive == index)
        w = (target_m - machine.tool_point + strut.platform_joint - strut.base_joint) * slider.axis.conjugate()
        drives.append(w.real + slider.branch * math.sqrt(strut.length_m**2 - w.imag**2))
    return tuple(drives)


def _poses(machine: MachineFile, rng: np.random.Generator, options: DesignOptions) -> list[complex]:
    (x_low, x_high), (y_low, y_high) = machine.workspace_m
    if not options.randomised:
        side = math.ceil(math.sqrt(options.poses))
        grid = [(i / (side - 1), j / (side - 1)) for j in range(side) for i in range(side)]
        unit = np.array(grid[: options.poses])
    else:
        unit = 0.5 - 0.5 * np.cos(np.pi * rng.uniform(0.0, 1.0, (options.poses, 2)))
        edge = rng.random(options.poses) < 0.1
        unit[edge, rng.integers(0, 2, int(edge.sum()))] = 1.0
    x, y = x_low + (x_high - x_low) * unit[:, 0], y_low + (y_high - y_low) * unit[:, 1]
    return [complex(a, b) for a, b in zip(x, y, strict=True)]
