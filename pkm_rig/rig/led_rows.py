"""The rows of a led path: from where the drives are told to be to a target, each corrected for its own pose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.machine.description import Machine
from calibration.machine.inverse import nominal_drives, nominal_poses
from calibration.machine.led_path import forward_pose, require_clear_ways, straight_path

MOST_APART = 3e-3  # of a drive, in m or rad, from where the nominal machine has it: corrections are below it
MOST_FADED = 1e-5  # m or rad by which what fades along a path may change from one SYNC to the next
MOST_SLOWED = 6  # times that a path is planned anew because corrections make a drive too fast
SLOWER = 1.001  # than would just do: rows are whole, and the fastest may be another one then
ROUND_OFF = 1e-6  # share of a speed


@dataclass(frozen=True)
class PathOrder:
    """How a path is to be led: speed and acceleration, a row every period, and what the platform carries.

    corrections: of the drives (n, d) at platform poses (n, 6) on the way; None: none. correction (d,): at its end,
    where that is something else than these say. limits (d, 2): positions within which the drives must stay beside their
    travel (0x607D).
    """

    speed_m_per_s: float
    acceleration_m_per_s2: float
    period_s: float
    payload_kg: float
    payload_com_m: tuple[float, float, float]
    corrections: Callable[[Array], Array] | None = None
    correction: Array | None = None
    limits: Array | None = None

    def at(self, pose: Array, drives: int) -> Array:
        """Corrections (n, d) at platform poses (n, 6)."""
        return np.zeros((len(pose), drives)) if self.corrections is None else self.corrections(pose)


def led_rows(machine: Machine, demand: Array, commanded: Array, order: PathOrder) -> Array:
    """Drive positions (n, d) from where the drives are told to be (d,) to commanded coordinates (k,) of the tool.

    Every row is corrected for its own pose. By what the drives differ from that at the ends (a correction that was
    switched on or off meanwhile, what the brakes left) fades along the path, so that it begins and ends without a step.
    Where its correction would make a drive too fast the path takes longer. Raises InputError where it leaves what is
    permitted, before anything moves.
    """
    start, apart = forward_pose(machine, demand)
    _require_near(machine, apart, "path: ", "stands")
    ways = np.stack([start, commanded])[None]
    require_clear_ways(machine, ways, payload_kg=order.payload_kg, payload_com_m=order.payload_com_m)
    speed = order.speed_m_per_s
    for _ in range(MOST_SLOWED):
        rows = _rows_at(machine, start, apart, commanded, order, speed)
        too_fast = _fastest(machine, rows) / (order.speed_m_per_s * order.period_s)
        if too_fast <= 1.0 + ROUND_OFF:
            _require_within(machine, rows, order)
            return rows
        speed /= too_fast * SLOWER
    raise InputError(
        f"path: with its correction a drive would be {too_fast:.2f} times as fast as {order.speed_m_per_s:g} m/s; "
        "choose another way, or a lower speed"
    )


def require_drives_agree(machine: Machine, drives: Array) -> None:
    """Raise InputError where drives at (d,) would strain the machine, as only more drives than coordinates can."""
    if machine.redundantly_actuated:
        _require_near(machine, forward_pose(machine, drives)[1], "", "would stand")


def _rows_at(
    machine: Machine, start: Array, apart: Array, commanded: Array, order: PathOrder, speed_m_per_s: float
) -> Array:
    path = straight_path(machine, start, commanded, speed_m_per_s, order.acceleration_m_per_s2, order.period_s)
    share, pose, drives = path.share, path.pose, path.drives
    corrections = order.at(pose, drives.shape[1])
    at_start = apart - corrections[0]
    at_end = np.zeros_like(apart) if order.correction is None else order.correction - corrections[-1]
    _require_near(machine, corrections[-1] + at_end, "path: ", "would stand")
    change = float(np.max(np.abs(at_end - at_start)))
    if change * float(np.max(np.diff(share))) > MOST_FADED:  # hardly any way, but another correction: slower
        share = _smooth(int(np.ceil(1.5 * change / MOST_FADED * order.speed_m_per_s / speed_m_per_s)) + 2)
        pose = nominal_poses(machine, start + share[:, None] * (commanded - start))
        drives, corrections = nominal_drives(machine, pose), order.at(pose, drives.shape[1])
    return np.asarray(drives + corrections + (1.0 - share)[:, None] * at_start + share[:, None] * at_end)


def _smooth(rows: int) -> Array:
    """Shares (n,) from 0 to 1 that begin and end at rest; the steepest is 1.5 times the mean."""
    t = np.linspace(0.0, 1.0, rows)
    return np.asarray(t**2 * (3.0 - 2.0 * t))


def _fastest(machine: Machine, rows: Array) -> float:
    """Longest step of a slider or leg in m; cranks follow the platform, whose speed the path keeps."""
    linear = [a for a, kind in enumerate(machine.drive_kinds) if kind != "crank"]
    return float(np.abs(np.diff(rows[:, linear], axis=0)).max(initial=0.0))


def _require_near(machine: Machine, offset: Array, where: str, what: str) -> None:
    worst = int(np.argmax(np.abs(offset)))
    if abs(offset[worst]) > MOST_APART:
        raise InputError(
            f"{where}drive {machine.drive_names[worst]} {what} {offset[worst] * 1e3:.2f} mm or mrad from where the "
            f"others have it, {MOST_APART * 1e3:g} is permitted: they strain the machine; check references and release "
            "it by hand"
        )


def _require_within(machine: Machine, rows: Array, order: PathOrder) -> None:
    """Travel and software limits, corrections included."""
    parts = [("its travel", machine.travel)]
    parts += [] if order.limits is None else [("its software limits (0x607D)", order.limits)]
    for what, (low, high) in ((words, limits.T) for words, limits in parts):
        for row, a in np.argwhere((rows < low) | (rows > high))[:1]:
            raise InputError(
                f"path: corrected, drive {machine.drive_names[a]} would be at {rows[row, a]:.5f}, {what} are "
                f"{low[a]:g} to {high[a]:g}; keep off it, or make the workspace smaller"
            )
