"""Where the gap lies: the share of its variance that each coordinate or place alone accounts for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from calibration.gap.evidence import Readout
from calibration.gap.periods import Periodogram
from calibration.gap.result import Share, Spectrum
from calibration.gap.shapes import brownian, products, smooth
from calibration.gap.shrink import Field
from calibration.machine import COORDINATES, Array

RIDGE = 1e-3
LONGEST_M, SHORTEST_M = 0.06, 2.0e-5
BLOCKS = 8
MORE = 0.03
PICTURED = 400


def shares(readout: Readout, found: Field, periods: Sequence[Periodogram]) -> tuple[Share, ...]:
    """All shares of the gap before any effect, kind by kind."""
    return (*_of_coordinates(readout, found, periods), *_of_places(readout, found))


def _of_coordinates(readout: Readout, found: Field, periods: Sequence[Periodogram]) -> Iterator[Share]:
    """Form-free functions of one coordinate, learnt on some blocks and judged on the others.

    Blocks are drawn visit by visit: every region, day and load is in each. The gap is that of withheld regions already,
    so the function predicts what no reading of the visit's region has told.
    """
    known = readout.baseline
    smr, visit = known.smr[found.rows], known.visit[found.rows]
    sides: dict[str, Share] = {}
    block = np.random.default_rng(BLOCKS).permutation(int(visit.max()) + 1)[visit] % BLOCKS
    for kind, name, shapes in _coordinates(readout, found, periods):
        parts = np.zeros((BLOCKS, 2))
        for one in np.unique(smr):
            rows = np.flatnonzero(smr == one)
            x = np.concatenate([np.ones((len(rows), 1)), shapes[rows]], axis=1)
            y = found.before[rows]
            for b in range(BLOCKS):
                out = block[rows] == b
                learn = x[~out]
                ridge = RIDGE * np.eye(x.shape[1]) * len(learn)
                ridge[0, 0] = 1e-9
                c = np.linalg.solve(learn.T @ learn + ridge, learn.T @ y[~out])
                parts[b] += np.sum((y[out] - x[out] @ c) ** 2), np.sum(y[out] ** 2)
        share = _share(kind, name, parts)
        plain = sides.setdefault(name.rsplit(" ", 1)[-1], share) if kind in ("direction", "speed", "dwell") else None
        # What holds the side of approach too is listed where it tells more than the side alone.
        if plain is None or plain is share or " of " not in name or share.share > plain.share + MORE:
            yield share


def _share(kind: str, name: str, parts: Array) -> Share:
    """Share with a jackknife interval over blocks; parts (b, 2): what is left, what there was."""
    left, there = parts.sum(axis=0)
    if there <= 0.0:
        return Share(kind, name, 0.0, 0.0, 0.0)
    value = 1.0 - left / there
    without = 1.0 - (left - parts[:, 0]) / np.maximum(there - parts[:, 1], 1e-300)
    count = len(parts)
    u = np.sqrt((count - 1) / count * np.sum((without - without.mean()) ** 2))
    low, high = value - 2.36 * u, value + 2.36 * u  # Student's t, 7 degrees of freedom
    return Share(
        kind, name, float(np.clip(value, 0.0, 1.0)), float(np.clip(low, 0.0, 1.0)), float(np.clip(high, 0.0, 1.0))
    )


def _coordinates(readout: Readout, found: Field, periods: Sequence[Periodogram]) -> Iterator[tuple[str, str, Array]]:
    known, rows = readout.baseline, found.rows
    m, machine = known.moments, known.machine
    t = m.elapsed_s[rows]
    for a, drive in enumerate(machine.drive_names):
        yield "drive", drive, smooth(m.drives[rows, a], 16, roughness=0.5)
    target = known.poses.visits.target_m[known.visit[rows]]
    for c in machine.commanded:
        yield "pose", COORDINATES[c], smooth(target[:, c], 8, roughness=0.5)
    places = [smooth(target[:, c], 4, roughness=0.5, constant=True) for c in machine.commanded[:2]]
    yield "region", "tool", (products(places[0], places[1]) if len(places) > 1 else places[0])[:, 1:]
    for a, drive in enumerate(machine.drive_names):
        yield "direction", drive, m.direction[rows, a : a + 1]
    load = m.payload_kg[rows]
    yield (
        "load",
        "payload",
        np.stack([load, load**2], axis=1) / max(float(load.max()), 1.0) if load.any() else load[:, None],
    )
    yield "speed", "approach", _steps(m.speed_m_per_s[rows] * np.where(m.moving[rows], -1.0, 1.0))
    yield "dwell", "rest", smooth(np.log(m.dwell_s[rows] + 0.3), 6, roughness=0.5)
    # Signed by the side of approach: the speed with which a drive came, and the rest after it.
    for a, drive in enumerate(machine.drive_names):
        side = m.direction[rows, a : a + 1]
        yield (
            "dwell",
            f"rest of {drive}",
            products(side, smooth(np.log(m.dwell_s[rows] + 0.3), 6, roughness=0.5, constant=True)),
        )
        yield (
            "speed",
            f"approach of {drive}",
            products(side, _steps(m.speed_m_per_s[rows] * np.where(m.moving[rows], -1.0, 1.0))),
        )
    yield (
        "time",
        "rig",
        np.concatenate([smooth(t, 16, roughness=0.5), brownian(t / max(float(t.max()), 1.0), 16)], axis=1),
    )
    for sensor, value in m.temperatures_c.items():
        yield "temperature", sensor, smooth(value[rows], 5, roughness=0.5)
    for a, drive in enumerate(machine.drive_names):
        peaks = periods[a].strongest(SHORTEST_M, LONGEST_M)
        if peaks:
            phase = 2.0 * np.pi * np.outer(m.drives[rows, a] / peaks[0][0], [1.0, 2.0])
            yield "period", drive, np.concatenate([np.sin(phase), np.cos(phase)], axis=1)


def _steps(x: Array) -> Array:
    """A column for each value, or a smooth curve where there are many."""
    values = np.unique(np.round(x, 9))
    if len(values) > 12:
        return smooth(x, 8, roughness=0.5)
    return (np.round(x, 9)[:, None] == values).astype(np.float64)


def _of_places(readout: Readout, found: Field) -> Iterator[Share]:
    """What any change at one place alone could account for, visit by visit: struts, and each reflector's own part."""
    known = readout.baseline
    machine = known.machine
    moves = machine.dof[machine.dof < 3]
    visit = known.visit[found.rows]
    block = visit % BLOCKS
    total = np.bincount(block, np.sum(found.before**2, axis=1), minlength=BLOCKS)
    for strut in machine.strut_names:
        response = readout.channels.shift_m(f"length.{strut}")[found.rows][:, moves]
        yield _share("strut", strut, _explained(response, found.before, visit, block, total))
    for i in np.unique(known.smr[found.rows]):
        own = np.where((known.smr[found.rows] == i)[:, None], found.before, 0.0)
        mine = np.bincount(block, np.sum(own**2, axis=1), minlength=BLOCKS)
        yield _share("smr", machine.smrs[i].name, np.stack([total - mine, total], axis=1))


def _explained(response: Array, gap: Array, visit: NDArray[np.intp], block: NDArray[np.intp], total: Array) -> Array:
    along = np.bincount(visit, np.sum(response * gap, axis=1))
    square = np.bincount(visit, np.sum(response**2, axis=1))
    explained = along**2 / np.maximum(square, 1e-300)
    of_block = np.zeros(BLOCKS)
    np.add.at(of_block, np.arange(len(along)) % BLOCKS, explained)
    return np.stack([total - of_block, total], axis=1)


def spectra(readout: Readout, periods: Sequence[Periodogram]) -> tuple[Spectrum, ...]:
    """Power along each drive by period, the highest of each stretch of the logarithm."""
    out = []
    for drive, found in zip(readout.baseline.machine.drive_names, periods, strict=True):
        edges = np.geomspace(1.0 / LONGEST_M, 1.0 / SHORTEST_M, PICTURED + 1)
        first = np.searchsorted(found.frequency, edges)
        first = np.unique(first)
        top = np.array([i + int(np.argmax(found.power[i:j])) for i, j in pairwise(first.tolist())])
        out.append(Spectrum(drive, 1.0 / found.frequency[top], found.power[top]))
    return tuple(out)
