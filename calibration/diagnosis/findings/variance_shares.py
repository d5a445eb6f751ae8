"""Shares of the gap's variance that single coordinates or single parts of the machine explain."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student_t

from calibration.base.arrays import Array
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.findings.withheld_blocks import GapField, regions
from calibration.diagnosis.linearised_readings import LinearisedReadings
from calibration.diagnosis.observed_model import TOOL
from calibration.diagnosis.periodogram import Periodogram
from calibration.diagnosis.result import Share, Spectrum
from calibration.effects.basis_functions import cosine_basis, random_walk_basis, tensor_product
from calibration.effects.context import of_sensor
from calibration.machine.description import COORDINATES

RIDGE_FACTORS = (1e-3, 1e-1)  # of a column's own square; coordinates with many basis functions need the larger one
LONGEST_M, SHORTEST_M = 0.06, 2.0e-5
BLOCKS = 8
MOST_CHANNELS = 4
LEAST_ADDITIONAL_SHARE = 0.03
SPECTRUM_POINTS = 400
ASK_FOR = {
    "direction": "direction",
    "speed": "speed_m_per_s",
    "dwell": "dwell_s",
    "time": "t_s",
}  # fields of the context


def variance_shares(
    likelihood: MarginalLikelihood,
    truth_likelihood: MarginalLikelihood,
    field: GapField,
    acting: Sequence[str],
    periodograms: Sequence[Periodogram],
) -> tuple[Share, ...]:
    """All shares of the gap before any effect, kind by kind.

    truth_likelihood: the model by which the noise-free readings are estimated; acting: channels of the cause, the
    strongest first.
    """
    by_coordinate = _coordinate_shares(likelihood, truth_likelihood, acting[:MOST_CHANNELS], periodograms)
    return (*by_coordinate, *_place_shares(likelihood, field))


def _coordinate_shares(
    likelihood: MarginalLikelihood,
    truth_likelihood: MarginalLikelihood,
    acting: Sequence[str],
    periodograms: Sequence[Periodogram],
) -> Iterator[Share]:
    """Non-parametric functions of one coordinate acting through the channels of the cause, by cross-validation.

    The calibration is refitted to the gap and to each function, so that what it can absorb counts in neither.
    """
    linear = likelihood.linear
    rows = np.flatnonzero(linear.on_platform)
    region = regions(linear)[linear.home_visit[rows]]
    # What the noise-free readings contain beyond calibration and disturbances, after a refit: C^-1 (H c).
    gap = (likelihood.weighted_residual - truth_likelihood.weighted_residual)[rows]
    coordinates = [c for c in _coordinates(linear, periodograms) if ASK_FOR.get(c[0]) not in linear.context.missing]
    every = np.concatenate([shapes for _, _, shapes in coordinates], axis=1)
    columns = likelihood.observable_columns(acting, every, rows).reshape(*gap.shape, len(acting), -1)
    by_direction: dict[str, float] = {}
    last = 0
    for kind, name, shapes in coordinates:
        first, last = last, last + shapes.shape[1]
        own = columns[:, :, :, first:last].reshape(*gap.shape, -1)
        share = _share(kind, name, _cross_validated_squares(own, gap, region))
        drive = name.rsplit(" ", 1)[-1]
        if kind == "direction":
            by_direction[drive] = share.share
        # A product with the approach direction is listed only if it explains more than the direction alone.
        if " of " not in name or share.share > by_direction.get(drive, 0.0) + LEAST_ADDITIONAL_SHARE:
            yield share


def _cross_validated_squares(columns: Array, gap: Array, region: NDArray[np.intp]) -> Array:
    """(r, 2): sum of squares of the gap (m, w) in each region after a prediction from all others, and in total."""
    count = int(region.max()) + 1
    parts = [(columns[region == r].reshape(-1, columns.shape[2]), gap[region == r].ravel()) for r in range(count)]
    grams, scores = [x.T @ x for x, _ in parts], [x.T @ y for x, y in parts]
    gram, score = np.sum(grams, axis=0), np.sum(scores, axis=0)
    results = []
    for factor in RIDGE_FACTORS:
        ridge = factor * np.diag(np.diag(gram) + 1e-300)
        squares = np.zeros((count, 2))
        for r, (x, y) in enumerate(parts):
            coefficients = np.linalg.solve(gram - grams[r] + ridge, score - scores[r])
            squares[r] = float(np.sum((y - x @ coefficients) ** 2)), float(y @ y)
        results.append(squares)
    return min(results, key=lambda squares: float(squares[:, 0].sum()))


def _share(kind: str, name: str, squares: Array) -> Share:
    """Share with a jackknife interval over blocks; squares (b, 2): remaining and total sum of squares of each."""
    remaining, total = squares.sum(axis=0)
    if total <= 0.0:
        return Share(kind, name, 0.0, 0.0, 0.0)
    value = 1.0 - remaining / total
    leave_one_out = 1.0 - (remaining - squares[:, 0]) / np.maximum(total - squares[:, 1], 1e-300)
    count = len(squares)
    u = np.sqrt((count - 1) / count * np.sum((leave_one_out - leave_one_out.mean()) ** 2))
    half_width = float(student_t.ppf(0.975, count - 1)) * u
    value, low, high = (float(np.clip(x, 0.0, 1.0)) for x in (value, value - half_width, value + half_width))
    return Share(kind, name, value, low, high)


def _coordinates(linear: LinearisedReadings, periodograms: Sequence[Periodogram]) -> Iterator[tuple[str, str, Array]]:
    """Kind, name and shapes (n, k) of each coordinate; the approach direction before its products."""
    context, machine = linear.context, linear.machine
    t = context.elapsed_s
    for a, drive in enumerate(machine.drive_names):
        yield "drive", drive, cosine_basis(context.drives[:, a], 12, roughness=0.5)
    at = linear.places()[np.maximum(linear.visit, 0)]
    for k, c in enumerate(machine.commanded):
        yield "pose", COORDINATES[c], cosine_basis(at[:, k], 6, roughness=0.5)
    places = [cosine_basis(x, 3, roughness=0.5, constant=True) for x in at.T[:2]]
    yield "region", "tool", (tensor_product(places[0], places[1]) if len(places) > 1 else places[0])[:, 1:]
    for a, drive in enumerate(machine.drive_names):
        yield "direction", drive, context.direction[:, a : a + 1]
    load = context.payload_kg / max(float(context.payload_kg.max()), 1.0)
    yield "load", "payload", np.stack([load, load**2], axis=1)
    speed = _indicator_or_smooth(context.speed_m_per_s * np.where(context.moving, -1.0, 1.0))
    dwell = cosine_basis(np.log(context.dwell_s + 0.3), 5, roughness=0.5, constant=True)
    yield "speed", "approach", speed
    yield "dwell", "rest", dwell
    for a, drive in enumerate(machine.drive_names):
        side = context.direction[:, a : a + 1]
        yield "dwell", f"rest after approach of {drive}", tensor_product(side, dwell)
        yield "speed", f"speed of {drive}", tensor_product(side, speed)
    walk = random_walk_basis(t / max(float(t.max()), 1.0), 14)
    yield "time", "rig", np.concatenate([cosine_basis(t, 6), walk], axis=1)
    for sensor, value in context.temperatures_c.items():
        if of_sensor(sensor) in context.missing:
            continue
        yield "temperature", sensor, cosine_basis(value, 4, roughness=0.5)
    for a, drive in enumerate(machine.drive_names):
        peaks = periodograms[a].strongest_periods(SHORTEST_M, LONGEST_M)
        if peaks:
            phase = 2.0 * np.pi * np.outer(context.drives[:, a] / peaks[0][0], [1.0, 2.0])
            yield "period", drive, np.concatenate([np.sin(phase), np.cos(phase)], axis=1)


def _indicator_or_smooth(x: Array) -> Array:
    """An indicator column for each value (n,), or a smooth basis if there are many values."""
    values = np.unique(np.round(x, 9))
    if len(values) > 12:
        return cosine_basis(x, 8, roughness=0.5)
    return (np.round(x, 9)[:, None] == values).astype(np.float64)


def _place_shares(likelihood: MarginalLikelihood, field: GapField) -> Iterator[Share]:
    """Shares that arbitrary shifts per visit at a single strut, or of a single reflector, could explain."""
    linear = likelihood.linear
    machine = linear.machine
    visit, smr = linear.visit[field.rows], linear.smr[field.rows]
    block = visit % BLOCKS
    total = np.asarray(np.bincount(block, np.sum(field.before**2, axis=1), minlength=BLOCKS), dtype=np.float64)
    for strut in machine.strut_names:
        response = linear.gap_by_shift(likelihood.channels.shift_m(f"length.{strut}"))
        yield _share("strut", strut, _remaining_squares(response, field.before, visit, total))
    for i in np.unique(smr[smr != TOOL]):
        of_reflector = np.where((smr == i)[:, None], field.before, 0.0)
        explained = np.bincount(block, np.sum(of_reflector**2, axis=1), minlength=BLOCKS)
        yield _share("smr", machine.smrs[i].name, np.stack([total - explained, total], axis=1))


def _remaining_squares(response: Array, gap: Array, visit: NDArray[np.intp], total: Array) -> Array:
    """(b, 2): remaining and total sum of squares of the gap (m, c) by block, with one free shift per visit."""
    along = np.bincount(visit, np.sum(response * gap, axis=1))
    square = np.bincount(visit, np.sum(response**2, axis=1))
    explained = along**2 / np.maximum(square, 1e-300)
    of_block = np.zeros(BLOCKS)
    np.add.at(of_block, np.arange(len(along)) % BLOCKS, explained)
    return np.stack([total - of_block, total], axis=1)


def spectra(likelihood: MarginalLikelihood, periodograms: Sequence[Periodogram]) -> tuple[Spectrum, ...]:
    """Power along each drive by period: the highest value within each of many steps of the logarithm."""
    out = []
    for drive, periodogram in zip(likelihood.linear.machine.drive_names, periodograms, strict=True):
        edges = np.geomspace(1.0 / LONGEST_M, 1.0 / SHORTEST_M, SPECTRUM_POINTS + 1)
        first = np.unique(np.searchsorted(periodogram.frequency, edges))
        top = np.array([i + int(np.argmax(periodogram.power[i:j])) for i, j in pairwise(first.tolist())])
        out.append(Spectrum(drive, 1.0 / periodogram.frequency[top], periodogram.power[top]))
    return tuple(out)
