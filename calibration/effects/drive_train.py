"""Errors between encoder and slider: cumulative and periodic errors of the screw, interpolation of the encoder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.api import (
    PERIOD,
    BasisSets,
    Coordinate,
    Effect,
    EffectInputs,
    EffectParameter,
    Textbook,
    varies,
)
from calibration.effects.basis_functions import cosine_basis, wave_of

TRANSMISSION_M = (2.0e-4, 6.0e-2)  # of screws, and of teeth of belts, racks and gears
PITCH_M = (2.0e-6, 6.0e-3)  # of optical scales up to inductive and magnetic ones
USUAL_BORDER_M = 4.0e-3  # most scales have shorter periods, most screws longer leads
UNUSUAL = 0.1  # prior weight of the others
STATED_MULTIPLES = 3  # of a stated period: a wave repeats within it
STATED_WITHIN = 0.005  # of a stated period, how far a period may be off it
FEWEST_POSITIONS = 30
OVERTONES, AGE_TERMS = (2.0, 3.0, 4.0, 5.0), 4  # of a wave of any form that changes
ANYHOW_PERIODS, ANYHOW_WEIGHT = 2, 0.3  # the likeliest periods, whose wave may be such a one
TWO_WEIGHT = 1.0  # of waves of two periods, times the prior of each
ROUGH_TERMS, ROUGH_WEIGHT = 40, 0.3  # of an error that walks along the travel


def cumulative(inputs: EffectInputs, drive: int) -> BasisSets:
    """An error along the travel, smooth or one that walks; its straight part is the drive's scale."""
    sets, travel, q = BasisSets(), f"travel.{inputs.drive(drive)}", inputs.context.drives[:, drive]
    columns = sets.add((travel, cosine_basis(q, 14, roughness=1.5)))
    sets.add_set(columns[:4])
    sets.add_set(columns)
    sets.add_set(sets.add((travel, cosine_basis(q, ROUGH_TERMS, roughness=1.0))), weight=ROUGH_WEIGHT)
    return sets


def screw_periodic(inputs: EffectInputs, drive: int) -> BasisSets:
    """An error that repeats with every turn of the screw, or with every tooth of a transmission."""
    entry = inputs.machine.file.drives[drive]
    periods = _periods(inputs, drive, TRANSMISSION_M, usual=lambda period: period >= USUAL_BORDER_M)
    return _periodic(inputs, drive, _not_another_s(inputs, drive, periods, entry.transmission_m, entry.scale_m))


def interpolation(inputs: EffectInputs, drive: int) -> BasisSets:
    """An error that repeats with each period of the encoder's signals, or twice within it."""
    entry = inputs.machine.file.drives[drive]
    periods = _periods(inputs, drive, PITCH_M, usual=lambda period: period < USUAL_BORDER_M)
    return _periodic(inputs, drive, _not_another_s(inputs, drive, periods, entry.scale_m, entry.transmission_m))


def _periods(
    inputs: EffectInputs, drive: int, limits_m: tuple[float, float], *, usual: Callable[[float], bool]
) -> list[tuple[float, float]]:
    """Periods of a drive within limits with their prior; of both kinds of parts the same where they overlap."""
    shortest_m, longest_m = limits_m
    found = [
        *inputs.periods(drive, PITCH_M[0], USUAL_BORDER_M),
        *inputs.periods(drive, USUAL_BORDER_M, TRANSMISSION_M[1]),
    ]
    within = {period: prior for period, prior in found if shortest_m <= period <= longest_m}
    return [(period, prior if usual(period) else UNUSUAL * prior) for period, prior in within.items()]


def _not_another_s(
    inputs: EffectInputs,
    drive: int,
    periods: Sequence[tuple[float, float]],
    own_m: Sequence[float],
    other_s_m: Sequence[float],
) -> list[tuple[float, float]]:
    """Periods without those that the machine file states of the other kind of part and not of this one."""
    resolution = 1.0 / max(float(np.ptp(inputs.context.drives[:, drive])), 1e-6)

    def stated(period: float, of_parts_m: Sequence[float]) -> bool:
        """Whether a period is one of these, or of a wave within it, as far as the positions resolve it."""
        frequencies = [k / part for part in of_parts_m for k in range(1, STATED_MULTIPLES + 1)]
        return any(abs(1.0 / period - f) < max(resolution, STATED_WITHIN * f) for f in frequencies)

    return [(p, prior) for p, prior in periods if stated(p, own_m) or not stated(p, other_s_m)]


def _periodic(inputs: EffectInputs, drive: int, periods: Sequence[tuple[float, float]]) -> BasisSets:
    """Sine and cosine with their harmonics; the amplitude may vary along the travel and with the payload."""
    sets, travel, q = BasisSets(), f"travel.{inputs.drive(drive)}", inputs.context.drives[:, drive]
    u = inputs.normalised_travel(drive)
    least = min(sorted((prior for _, prior in periods), reverse=True)[:ANYHOW_PERIODS], default=0.0)
    waves: list[tuple[float, float, list[int]]] = []
    for period, prior in periods:
        wave = wave_of(q, period)
        main = sets.add((travel, wave), form="sine")
        waves.append((period, prior, main))
        harmonics = [sets.add((travel, wave_of(q, period / k)), form="harmonics") for k in (2.0, 3.0)]
        changing = [sets.add((travel, wave * by[:, None]), form="sine_by_travel") for by in (u, u**2 - 0.5)]
        changing.append(sets.add((travel, wave * (inputs.payload_ratio - 0.5)[:, None]), form="sine_by_payload"))
        rest = [c for columns in (*harmonics, *changing) for c in columns]
        sets.add_set(main, rest, share=0.5, weight=prior, period_m=period)
        if prior >= least:
            anyhow = [sets.add((travel, wave * by[:, None])) for by in _slow_changes(inputs, drive)]
            anyhow += [sets.add((travel, wave_of(q, period / k))) for k in OVERTONES]
            flexible = [c for columns in anyhow for c in columns]
            sets.add_set(main, flexible, share=0.5, weight=ANYHOW_WEIGHT * prior, period_m=period)
    resolution = 1.0 / max(float(np.ptp(q)), 1e-6)
    for (period, prior, main), (other, other_prior, beside) in combinations(waves, 2):
        if abs(1.0 / period - 1.0 / other) > resolution:  # a screw and its pulley, two stages of a gear
            sets.add_set((*main, *beside), weight=TWO_WEIGHT * prior * other_prior, period_m=max(period, other))
    return sets


def _slow_changes(inputs: EffectInputs, drive: int) -> list[Array]:
    """With what a wave may change its size and phase, smoothly: place, time."""
    context = inputs.context
    place = cosine_basis(context.drives[:, drive], 2)
    ages = [] if "t_s" in context.not_said else list(cosine_basis(context.elapsed_s, AGE_TERMS, roughness=1.0).T)
    return [*place.T, *ages]


def _untested_on_a_grid(inputs: EffectInputs) -> str | None:
    for column in inputs.context.drives.T:
        if len(np.unique(np.round(column, 7))) < FEWEST_POSITIONS:
            return f"fewer than {FEWEST_POSITIONS} different drive positions; measure off a grid"
    return None


def _untested_with_short_travel(inputs: EffectInputs) -> str | None:
    return None if all(varies(q, 0.05) for q in inputs.context.drives.T) else "the drives hardly moved"


WAVE_VARIES_WITH: tuple[Coordinate, ...] = (
    "own travel", "other travel", "side", "payload", "speed", "time", "course", "way", "warmth", "temperature",
    "phase",
)  # fmt: skip
_PERIOD = EffectParameter(PERIOD, PITCH_M[0], TRANSMISSION_M[1], "m", "period of the error", aliased=True)

EFFECTS = (
    Effect(
        name="screw_cumulative_error",
        place="drive",
        size=EffectParameter("amplitude_m", 1e-6, 5e-4, "m", "RMS along the travel"),
        reveals="drive coordinate, reflectors on the sliders",
        confounded=("axis_coupling", "guide_straightness"),
        forms=cumulative,
        untested=_untested_with_short_travel,
        measured="rms",
        order=90,
    ),
    Effect(
        name="screw_periodic_error",
        place="drive",
        size=EffectParameter("amplitude_m", 5e-7, 3e-4, "m", "of the sine"),
        reveals="many drive positions off a grid, reflectors on the sliders",
        confounded=("encoder_interpolation",),
        forms=screw_periodic,
        others=(_PERIOD,),
        untested=_untested_on_a_grid,
        textbook=Textbook("sine", "ISO 3408-3: travel variation within one revolution"),
        varies_with=WAVE_VARIES_WITH,
        order=100,
    ),
    Effect(
        name="encoder_interpolation",
        place="drive",
        size=EffectParameter("amplitude_m", 2e-7, 3e-4, "m", "of the sine"),
        reveals="many drive positions off a grid, reflectors on the sliders",
        confounded=("screw_periodic_error",),
        forms=interpolation,
        others=(_PERIOD,),
        untested=_untested_on_a_grid,
        textbook=Textbook("sine", "Heydemann 1981, Applied Optics 20: errors of quadrature signals"),
        varies_with=WAVE_VARIES_WITH,
        order=110,
    ),
)
