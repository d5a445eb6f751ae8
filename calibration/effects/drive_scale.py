"""A drive whose scale or zero changes while the campaign runs."""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.api import BasisSets, Effect, EffectInputs, EffectParameter, Textbook, strongest_onset
from calibration.effects.basis_functions import any_course, cosine_basis, course_with_jumps
from calibration.effects.onsets import ONSET, untested_in_short_campaign

ZERO_WEIGHT = 0.5  # of a zero that changes against a scale that does
SEVERAL_WEIGHT = 0.5  # of several changes against one
COURSE_TERMS, COURSE_WEIGHT = 24, 0.1  # of any course in time, as fine as that of settling, against steps
FINE_TERMS, FINE_WEIGHT = 48, 0.05  # of one as fine as that of a screw's warmth, which acts on the same channel
CREEP_S, CREEP_WEIGHT = (1200.0, 3600.0, 10800.0), 0.1  # in which a belt or tape stretches: rarer than what gets warm
MOTIONS_WEIGHT = 0.1  # of what its own motions leave of a zero
HEAT_S = (300.0, 900.0, 2700.0)  # in which a part near its reading head forgets their heat
EACH_TIME_TERMS = 12  # of any function of the number of the exchange
EXCHANGES_WEIGHT = 0.02  # of a zero that is another one after each exchange


def drive_scale(inputs: EffectInputs, drive: int) -> BasisSets:
    """From a moment on a drive counts with another scale or zero: a scale that slipped, a lost reference, homed anew;
    or it creeps, as a new belt stretches.

    Scale and zero error of a linear axis (ISO 230-2; Slocum, Precision Machine Design, SME 1992, ch. 2), in steps.
    """
    sets, name, t = BasisSets(), inputs.drive(drive), inputs.context.elapsed_s
    low, high = inputs.machine.travel[drive]
    per_shift = 2.0 / float(high - low)  # relative, that shifts the end of the travel by one
    scales, zeros = inputs.onsets((f"scale.{name}",)), inputs.onsets((f"travel.{name}",))

    def scale(shape: Array, form: str = "") -> list[int]:
        return sets.add((f"scale.{name}", shape * per_shift), form=form)

    def zero(shape: Array, form: str = "") -> list[int]:
        return sets.add((f"travel.{name}", shape), form=form)

    def after(onset_s: float) -> Array:
        return (t >= onset_s).astype(np.float64)

    for onset, prior in scales:
        moved = zero(after(onset), "zero_with_scale")
        sets.add_set(scale(after(onset), "scale"), moved, share=1.0, weight=prior, onset_s=onset)
    for onset, prior in zeros:
        sets.add_set(zero(after(onset), "zero"), weight=ZERO_WEIGHT * prior, onset_s=onset)
    for changes, column, other, weight in ((scales, scale, zero, 1.0), (zeros, zero, scale, ZERO_WEIGHT)):
        if len(changes) > 1:  # any number of steps
            steps = np.column_stack([after(onset) for onset, _ in changes])
            first, prior = changes[0]
            sets.add_set(column(steps), other(steps), share=1.0, weight=weight * SEVERAL_WEIGHT * prior, onset_s=first)
    for tau_s in CREEP_S:
        crept = 1.0 - np.exp(-t / tau_s)
        sets.add_set(scale(crept, "creep"), zero(crept, "creep"), share=1.0, weight=CREEP_WEIGHT)
    # Any course in time.
    of_scale, of_zero = (course_with_jumps(t, COURSE_TERMS, [at for at, _ in onsets]) for onsets in (scales, zeros))
    sets.add_set(scale(of_scale), zero(of_scale), share=1.0, weight=COURSE_WEIGHT, **strongest_onset(scales))
    sets.add_set(zero(of_zero), (), weight=ZERO_WEIGHT * COURSE_WEIGHT, **strongest_onset(zeros))
    fine = any_course(t, FINE_TERMS)
    sets.add_set(zero(fine), scale(fine), share=1.0, weight=FINE_WEIGHT, **strongest_onset(zeros))
    if (added := _added_by_motions(inputs, drive)) is not None:  # a belt that creeps, steps that are lost
        sets.add_set(zero(added), (), weight=MOTIONS_WEIGHT)
        heats = [_to_one(inputs.context.motion_heat(drive, tau_s)) for tau_s in HEAT_S]
        sets.add_set(zero(np.column_stack(heats)), (), weight=MOTIONS_WEIGHT)
    exchanges = np.unique(inputs.context.exchanges)[1:]
    if exchanges.size:  # somebody was in the cell: the drives were switched off, and homed again
        since = (inputs.context.exchanges[:, None] >= exchanges).astype(np.float64)
        sets.add_set(zero(since, "exchanges"), (), weight=EXCHANGES_WEIGHT, **strongest_onset(zeros))
        each_time = cosine_basis(inputs.context.exchanges, min(EACH_TIME_TERMS, exchanges.size), roughness=0.5)
        sets.add_set(zero(each_time), (), weight=EXCHANGES_WEIGHT, **strongest_onset(zeros))
    return sets


def _added_by_motions(inputs: EffectInputs, drive: int) -> Array | None:
    """Sums (n, 8) over all motions so far, up and down apart: their way, number and speed, and the way by the square of
    what hangs on the drive; each ends at one.

    None where the readings do not say how the drives came there.
    """
    context = inputs.context
    if {"history", "speed_m_per_s"} & context.not_said.keys():
        return None
    way_m = np.diff(context.history.drives[:, drive], prepend=context.history.drives[:1, drive])
    load = _load_at_arrivals(inputs, drive)
    each = np.column_stack(
        [np.abs(way_m), np.ones_like(way_m), context.approach_speed_m_per_s, np.abs(way_m) * load**2]
    )
    so_far = [np.cumsum(each * (side * way_m > 0.0)[:, None], axis=0)[context.arrival] for side in (1.0, -1.0)]
    return np.column_stack([_to_one(column) for sums in so_far for column in sums.T])


def _load_at_arrivals(inputs: EffectInputs, drive: int) -> Array:
    """What loads a drive at each arrival (k,), over the largest."""
    pull_n = inputs.pull_along_n(drive)
    load = np.zeros(len(inputs.context.history.arrived_s))
    load[inputs.context.arrival] = pull_n / max(float(np.abs(pull_n).max()), 1e-300)
    return load


def _to_one(shape: Array) -> Array:
    return np.asarray(shape / max(float(shape.max()), 1e-300))


EFFECTS = (
    Effect(
        name="drive_scale",
        place="drive",
        size=EffectParameter("shift_m", 1e-6, 1e-3, "m", "of the zero, or at the end of the travel"),
        reveals="time and the drive coordinate, reflectors on the sliders, floor nests",
        confounded=("foundation_settling", "screw_thermal_growth"),
        forms=drive_scale,
        others=(ONSET,),
        untested=untested_in_short_campaign,
        textbook=Textbook("scale", "Slocum, Precision Machine Design, ch. 2: scale error of an axis"),
        varies_with=("own travel", "time", "temperature"),
        order=240,
    ),
)
