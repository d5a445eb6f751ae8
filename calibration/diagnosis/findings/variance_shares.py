"""Where the gap lies: the share of its variance that each coordinate or place alone accounts for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student_t

from calibration.base.arrays import Array
from calibration.diagnosis.evidence import Readout
from calibration.diagnosis.findings.withheld_blocks import Field, regions
from calibration.diagnosis.periodogram import Periodogram
from calibration.diagnosis.result import Share, Spectrum
from calibration.effects.basis_functions import brownian, products, smooth
from calibration.machine.description import COORDINATES

RIDGES = (1e-3, 1e-1)  # of a column's own square: coordinates with many shapes want more
LONGEST_M, SHORTEST_M = 0.06, 2.0e-5
BLOCKS = 8
MOST_CHANNELS = 4
MORE = 0.03
PICTURED = 400


def shares(
    readout: Readout, truth: Readout, found: Field, acting: Sequence[str], periods: Sequence[Periodogram]
) -> tuple[Share, ...]:
    """All shares of the gap before any effect, kind by kind.

    truth: the readout by which the noise-free readings are estimated; acting: channels at which something acts, the
    strongest first.
    """
    return (*_of_coordinates(readout, truth, acting[:MOST_CHANNELS], periods), *_of_places(readout, found))


def _of_coordinates(
    readout: Readout, truth: Readout, acting: Sequence[str], periods: Sequence[Periodogram]
) -> Iterator[Share]:
    """Form-free functions of one coordinate that act where the gap's cause does, learnt on all regions but one.

    Calibration is fitted again to both, the gap and each function, so that what it takes up counts for neither.
    """
    known = readout.baseline
    rows = np.flatnonzero(known.on_platform)
    region = regions(known)[known.visit[rows]]
    # What the truth has beyond calibration and declared wander, as a refit leaves it: C^-1 (H c).
    gap = (readout.left - truth.left)[rows]
    sides: dict[str, float] = {}
    for kind, name, shapes in _coordinates(readout, periods):
        through = readout.seen_through(acting, shapes, rows)
        through /= np.maximum(np.sqrt(np.mean(through**2, axis=(0, 1))), 1e-300)
        share = _share(kind, name, _learnt(through, gap, region))
        drive = name.rsplit(" ", 1)[-1]
        if kind == "direction":
            sides[drive] = share.share
        # What holds the side of approach as well is listed where it tells more than the side alone.
        if " of " not in name or share.share > sides.get(drive, 0.0) + MORE:
            yield share


def _learnt(columns: Array, gap: Array, region: NDArray[np.intp]) -> Array:
    """(r, 2): what is left of the gap (m, 3) in each region by what the others teach, and what there was."""
    count = int(region.max()) + 1
    parts = [(columns[region == r].reshape(-1, columns.shape[2]), gap[region == r].ravel()) for r in range(count)]
    grams, scores = [x.T @ x for x, _ in parts], [x.T @ y for x, y in parts]
    gram, score = np.sum(grams, axis=0), np.sum(scores, axis=0)
    tried = []
    for ridge in RIDGES:
        held = ridge * np.diag(np.diag(gram) + 1e-300)
        out = np.zeros((count, 2))
        for r, (x, y) in enumerate(parts):
            c = np.linalg.solve(gram - grams[r] + held, score - scores[r])
            out[r] = float(np.sum((y - x @ c) ** 2)), float(y @ y)
        tried.append(out)
    return min(tried, key=lambda out: float(out[:, 0].sum()))


def _share(kind: str, name: str, parts: Array) -> Share:
    """Share with a jackknife interval over blocks; parts (b, 2): what is left, what there was."""
    left, there = parts.sum(axis=0)
    if there <= 0.0:
        return Share(kind, name, 0.0, 0.0, 0.0)
    value = 1.0 - left / there
    without = 1.0 - (left - parts[:, 0]) / np.maximum(there - parts[:, 1], 1e-300)
    count = len(parts)
    u = np.sqrt((count - 1) / count * np.sum((without - without.mean()) ** 2))
    t = float(student_t.ppf(0.975, count - 1))
    low, high = value - t * u, value + t * u
    return Share(
        kind, name, float(np.clip(value, 0.0, 1.0)), float(np.clip(low, 0.0, 1.0)), float(np.clip(high, 0.0, 1.0))
    )


def _coordinates(readout: Readout, periods: Sequence[Periodogram]) -> Iterator[tuple[str, str, Array]]:
    """Kind, name and shapes (n, k) of each coordinate; the side of approach before what holds it too."""
    known = readout.baseline
    m, machine = known.moments, known.machine
    t = m.elapsed_s
    for a, drive in enumerate(machine.drive_names):
        yield "drive", drive, smooth(m.drives[:, a], 12, roughness=0.5)
    target = known.poses.visits.target_m[np.maximum(known.visit, 0)]
    for c in machine.commanded:
        yield "pose", COORDINATES[c], smooth(target[:, c], 6, roughness=0.5)
    places = [smooth(target[:, c], 3, roughness=0.5, constant=True) for c in machine.commanded[:2]]
    yield "region", "tool", (products(places[0], places[1]) if len(places) > 1 else places[0])[:, 1:]
    for a, drive in enumerate(machine.drive_names):
        yield "direction", drive, m.direction[:, a : a + 1]
    load = m.payload_kg / max(float(m.payload_kg.max()), 1.0)
    yield "load", "payload", np.stack([load, load**2], axis=1)
    speed = _steps(m.speed_m_per_s * np.where(m.moving, -1.0, 1.0))
    rest = smooth(np.log(m.dwell_s + 0.3), 5, roughness=0.5, constant=True)
    yield "speed", "approach", speed
    yield "dwell", "rest", rest
    for a, drive in enumerate(machine.drive_names):
        side = m.direction[:, a : a + 1]
        yield "dwell", f"rest after approach of {drive}", products(side, rest)
        yield "speed", f"speed of {drive}", products(side, speed)
    yield "time", "rig", np.concatenate([smooth(t, 6), brownian(t / max(float(t.max()), 1.0), 14)], axis=1)
    for sensor, value in m.temperatures_c.items():
        yield "temperature", sensor, smooth(value, 4, roughness=0.5)
    for a, drive in enumerate(machine.drive_names):
        peaks = periods[a].strongest(SHORTEST_M, LONGEST_M)
        if peaks:
            phase = 2.0 * np.pi * np.outer(m.drives[:, a] / peaks[0][0], [1.0, 2.0])
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
    total = np.asarray(np.bincount(block, np.sum(found.before**2, axis=1), minlength=BLOCKS), dtype=np.float64)
    for strut in machine.strut_names:
        response = readout.channels.shift_m(f"length.{strut}")[found.rows][:, moves]
        yield _share("strut", strut, _explained(response, found.before, visit, total))
    for i in np.unique(known.smr[found.rows]):
        own = np.where((known.smr[found.rows] == i)[:, None], found.before, 0.0)
        mine = np.bincount(block, np.sum(own**2, axis=1), minlength=BLOCKS)
        yield _share("smr", machine.smrs[i].name, np.stack([total - mine, total], axis=1))


def _explained(response: Array, gap: Array, visit: NDArray[np.intp], total: Array) -> Array:
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
