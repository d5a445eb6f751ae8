"""What is stated of the rig and is not so: payloads, tables off, a drive's scale and zero; coefficients: `expansion`.

The calibration takes such a value as known, within its stated uncertainty, and the machine's model says how its error
acts: through channels of their own, so that one number moves all that depends on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.api import BasisSets, Effect, EffectInputs, EffectParameter, Textbook, strongest_onset, varies
from calibration.effects.basis_functions import (
    cosine_basis,
    course_with_jumps,
    random_walk_basis,
    tensor_product,
)
from calibration.machine.description import Machine
from calibration.model.payload import PayloadEntry

LEVER_M = 0.25  # at which a mass beside the stated centre turns the platform as the moment of its size does
SWINGS_RAD_PER_S, CALMS_S = (0.9, 1.4, 2.2), 12.0  # of what swings after a stop
REST_TERMS, MOVING_WEIGHT, STOPPED_M_PER_S = 4, 0.2, 0.5  # of a centre that moves on after a stop, from this speed
AGE_TERMS, PLACE_TERMS, CHANGING_WEIGHT = 4, 2, 0.2  # of a load that changes in time or with the place
LEAST_LOAD_SHARE = 1e-3  # of the largest payload: less is none
TABLE_TERMS = 3  # of any function of another drive's coordinate
BESIDE_M = (0.03, 0.08, 0.15, 0.22)  # beside its own place, at which a table may be looked up
MOUNTINGS, WALK_TERMS = 6, 12  # terms of what may be otherwise each time, or at any time
WALK_WEIGHT = 0.02  # of a table whose weight changes at any time
ZERO_WEIGHT = 0.5  # of a zero that changes against a scale that does
SEVERAL_WEIGHT = 0.5  # of several changes against one
COURSE_TERMS, COURSE_WEIGHT = 24, 0.1  # of any course in time, as fine as that of settling, against steps
EACH_TIME_TERMS = 12  # of any function of the number of the exchange
EXCHANGES_WEIGHT = 0.02  # of one at each payload exchange, whose moment is known
ONE_DRIVE_WEIGHT = 0.2  # of a table that is on in one drive alone


def payload(inputs: EffectInputs, _: int) -> BasisSets:
    """What is mounted has another mass or centre than stated: all of it in proportion, or by what was not counted.

    Weight and its moment in the platform's equilibrium (Merlet, Parallel Robots, Springer 2006, ch. 9). A centre that
    is off by d counts as the mass m d / 0.25 m, which has the same moment at a lever of 0.25 m. Beside each form is
    what struts of another stiffness than the fitted one, which a wrong payload has spoilt, make of its forces.
    """
    sets, kg = BasisSets(), inputs.context.payload_kg
    largest = max(float(kg.max()), 1e-9)
    mounted = (kg > LEAST_LOAD_SHARE * largest).astype(np.float64)
    in_proportion = sets.add(("payload.mass", inputs.payload_ratio), form="in_proportion")
    not_counted = sets.add(("payload.mass", mounted), form="not_counted")
    shifted, beside = [], []
    any_load = np.stack([mounted, inputs.payload_ratio, inputs.payload_ratio**2], axis=1)
    each_time = mounted[:, None] * cosine_basis(inputs.context.exchanges, MOUNTINGS)
    anyhow = sets.add(("payload.mass", np.concatenate([any_load, each_time], axis=1)))
    whenever = anyhow[:1]  # of each channel what is always mounted
    for channel in (c for c in inputs.channels if c.startswith("payload.") and c != "payload.mass"):
        moment = mounted * LEVER_M / np.maximum(kg, LEAST_LOAD_SHARE * largest)
        shifted += sets.add((channel, mounted * (LEVER_M / largest)), form="shifted")
        beside += sets.add((channel, moment), form="beside")
        at_any_load = sets.add((channel, moment[:, None] * np.concatenate([any_load, each_time], axis=1)))
        anyhow, whenever = [*anyhow, *at_any_load], [*whenever, at_any_load[0]]

    def yielding(columns: Sequence[int]) -> list[int]:
        return [c for column in columns for c in _by_strut(sets, inputs, column)]

    sets.add_set(in_proportion, (*shifted, *yielding(in_proportion)))
    sets.add_set(not_counted, (*beside, *yielding(not_counted)))
    sets.add_set(shifted, yielding(shifted))
    sets.add_set(beside, yielding(beside))
    sets.add_set((*in_proportion, *not_counted), (*shifted, *beside), weight=0.5)
    sets.add_set(anyhow, yielding(whenever), weight=0.5)
    for loads in _loads_over_time(inputs, mounted):
        changing = sets.add(("payload.mass", loads))
        sets.add_set(changing, yielding(changing), weight=CHANGING_WEIGHT)
    place = np.column_stack([np.ones(len(kg)), *(cosine_basis(q, PLACE_TERMS) for q in inputs.context.drives.T)])
    for loads in (place, mounted[:, None] * place):  # a chain that is lifted
        sets.add_set(sets.add(("payload.mass", loads)), yielding(whenever[:1]), weight=CHANGING_WEIGHT)
    if moving_on := _moving_on(sets, inputs, mounted / np.maximum(kg, LEAST_LOAD_SHARE * largest)):
        sets.add_set(moving_on, weight=MOVING_WEIGHT)
    return sets


def _loads_over_time(inputs: EffectInputs, mounted: Array) -> list[Array]:
    """Loads (n, k) that change in the course of time: what is mounted, which runs out, and what comes onto the platform
    with it or without, as chips do."""
    if "t_s" in inputs.context.not_said:
        return []
    age = cosine_basis(inputs.context.elapsed_s, AGE_TERMS, constant=True)
    return [mounted[:, None] * age, age]


def _moving_on(sets: BasisSets, inputs: EffectInputs, per_kg: Array) -> list[int]:
    """Columns of a payload whose centre moves on when its drives stop: to any side, by any function of the rest."""
    context = inputs.context
    if {"direction", "dwell_s", "speed_m_per_s"} & context.not_said.keys():
        return []
    t = context.dwell_s[:, None]
    swings = [np.exp(-t / CALMS_S) * wave(t * np.array(SWINGS_RAD_PER_S)) for wave in (np.cos, np.sin)]
    rests = np.column_stack([cosine_basis(np.log(context.dwell_s + 0.3), REST_TERMS, constant=True), *swings])
    stopped = tensor_product(context.direction * context.speed_m_per_s[:, None] / STOPPED_M_PER_S, rests)
    channels = [c for c in inputs.channels if c.startswith("payload.") and c != "payload.mass"]
    return [c for channel in channels for c in sets.add((channel, LEVER_M * per_kg[:, None] * stopped))]


def _by_strut(sets: BasisSets, inputs: EffectInputs, column: int) -> list[int]:
    """What each strut grows by the forces of a column of the payload, if it is twice as soft as in the model."""
    ((channel, shape),) = sets.contributions[column]
    if channel not in inputs.payload_elongation_m:
        return []
    growth = shape[:, None] * inputs.payload_elongation_m[channel]
    return [
        c
        for strut, name in enumerate(inputs.machine.strut_names)
        for c in sets.add((f"length.{name}", growth[:, strut]), form=sets.named[column])
    ]


def tables_left_on(inputs: EffectInputs, _: int) -> BasisSets:
    """A known table is on though the recording says off: all the time, from a moment on, until one, or in one drive."""
    sets, context = BasisSets(), inputs.context
    one = np.ones(len(context))
    drives = inputs.machine.drive_names
    for generation in context.table_generations:
        sets.add_set(sets.add((f"table.{generation}", one), form="all_of_it"))
        corrections = context.table_corrections_m(generation, drives, context.drives)
        for name, correction in zip(drives, corrections.T, strict=True):
            if len(drives) > 1 and np.any(correction):
                sets.add_set(sets.add((f"travel.{name}", correction), form="one_drive"), weight=ONE_DRIVE_WEIGHT)
    _add_tables_by_direction(sets, inputs)
    _add_multiplied_tables(sets, inputs)
    _add_tables_beside_their_places(sets, inputs)
    if "t_s" in context.not_said:  # who knows when: nothing depends on time then
        return sets
    for generation in context.table_generations:
        t = context.elapsed_s
        corrections = context.table_corrections_m(generation, drives, context.drives)
        at_times = np.column_stack([one, random_walk_basis(t / max(float(t.max()), 1.0), WALK_TERMS)])
        sets.add_set(sets.add((f"table.{generation}", at_times)), weight=WALK_WEIGHT)
        in_each = [(f"travel.{n}", c) for n, c in zip(drives, corrections.T, strict=True) if np.any(c)]
        by_drive = len(drives) > 1 and bool(in_each)
        if by_drive:
            of_each = [c for channel, shape in in_each for c in sets.add((channel, shape[:, None] * at_times))]
            sets.add_set(of_each, weight=WALK_WEIGHT)
        for onset, prior in inputs.onsets((f"table.{generation}",)):
            after = (t >= onset).astype(np.float64)
            for switched in (after, 1.0 - after):
                if by_drive:
                    parts = [c for channel, shape in in_each for c in sets.add((channel, shape * switched))]
                    sets.add_set(parts, weight=ONE_DRIVE_WEIGHT * prior, onset_s=onset)
                column = sets.add((f"table.{generation}", switched), form="switched")
                sets.add_set(column, weight=prior, onset_s=onset)
    return sets


def _add_multiplied_tables(sets: BasisSets, inputs: EffectInputs) -> None:
    """A control may multiply a drive's table by one of another drive's coordinate: by any smooth function of it."""
    context, drives = inputs.context, inputs.machine.drive_names
    for generation in context.table_generations:
        corrections = context.table_corrections_m(generation, drives, context.drives)
        parts = [
            (f"travel.{name}", corrections[:, a : a + 1] * cosine_basis(context.drives[:, b], TABLE_TERMS))
            for a, name in enumerate(drives)
            for b in inputs.other_drives(a)
            if np.any(corrections[:, a])
        ]
        if parts:
            sets.add_set([c for part in parts for c in sets.add(part)], weight=WALK_WEIGHT)


def _add_tables_beside_their_places(sets: BasisSets, inputs: EffectInputs) -> None:
    """A table is looked up at another place if the drive's zero was moved after it had been taken: anywhere around."""
    context, drives = inputs.context, inputs.machine.drive_names
    shifts_m = sorted({0.0, *BESIDE_M, *(-shift for shift in BESIDE_M)})
    for generation in context.table_generations:
        at_places = np.stack(
            [context.table_corrections_m(generation, drives, context.drives + shift) for shift in shifts_m], axis=2
        )
        parts = [
            c
            for a, name in enumerate(drives)
            if np.any(at_places[:, a])
            for c in sets.add((f"travel.{name}", at_places[:, a]))
        ]
        if parts:
            sets.add_set(parts, weight=WALK_WEIGHT)


def _add_tables_by_direction(sets: BasisSets, inputs: EffectInputs) -> None:
    """A control may hold a table for each direction of an axis (ISO 230-2), each of another generation."""
    context, drives = inputs.context, inputs.machine.drive_names
    if "direction" in context.not_said or len(context.table_generations) < 2:
        return
    backward = context.direction < 0.0
    corrections = {g: context.table_corrections_m(g, drives, context.drives) for g in context.table_generations}
    for forwards, backwards in permutations(context.table_generations, 2):
        both = np.where(backward, corrections[backwards], corrections[forwards])
        if any(np.any(corrections[generation]) for generation in (forwards, backwards)):
            column = sets.add(*((f"travel.{name}", both[:, a]) for a, name in enumerate(drives)), form="by_direction")
            sets.add_set(column, weight=ONE_DRIVE_WEIGHT)
    parts = [  # any share of each in each drive and direction
        (f"travel.{name}", corrections[g][:, a] * side[:, a])
        for g in context.table_generations
        for a, name in enumerate(drives)
        for side in (backward, ~backward)
        if np.any(corrections[g][:, a])  # whatever the direction: a twin's other readings must have the same columns
    ]
    if parts:
        sets.add_set([c for part in parts for c in sets.add(part)], weight=WALK_WEIGHT)


def drive_scale(inputs: EffectInputs, drive: int) -> BasisSets:
    """From a moment on a drive counts with another scale or zero: a scale that slipped, a lost reference, homed anew.

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
    # Any course in time.
    of_scale, of_zero = (course_with_jumps(t, COURSE_TERMS, [at for at, _ in onsets]) for onsets in (scales, zeros))
    sets.add_set(scale(of_scale), zero(of_scale), share=1.0, weight=COURSE_WEIGHT, **strongest_onset(scales))
    sets.add_set(zero(of_zero), (), weight=ZERO_WEIGHT * COURSE_WEIGHT, **strongest_onset(zeros))
    exchanges = np.unique(inputs.context.exchanges)[1:]
    if exchanges.size:  # somebody was in the cell: the drives were switched off, and homed again
        since = (inputs.context.exchanges[:, None] >= exchanges).astype(np.float64)
        sets.add_set(zero(since, "exchanges"), (), weight=EXCHANGES_WEIGHT, **strongest_onset(zeros))
        each_time = cosine_basis(inputs.context.exchanges, min(EACH_TIME_TERMS, exchanges.size), roughness=0.5)
        sets.add_set(zero(each_time), (), weight=EXCHANGES_WEIGHT, **strongest_onset(zeros))
    return sets


def _u_payload_kg(_: Machine, payloads: Sequence[PayloadEntry]) -> float:
    """Of mass or of the centre, whichever is known better; not stated: none."""
    stated = [
        u for p in payloads for u in (p.u_mass_kg, p.u_com_m * p.mass_kg / LEVER_M) if p.mass_kg > 0.0 and u > 0.0
    ]
    return min(stated, default=0.0)


def _untested_with_one_payload(inputs: EffectInputs) -> str | None:
    return (
        None
        if varies(inputs.context.payload_kg, 1e-3)
        else "every pose was measured with the same payload; measure two"
    )


def _untested_without_tables(inputs: EffectInputs) -> str | None:
    return None if inputs.context.known_tables else "the recording names no compensation tables"


def _untested_in_short_campaign(inputs: EffectInputs) -> str | None:
    return None if varies(inputs.context.t_s, 600.0) else "the campaign is too short"


_ONSET = EffectParameter("onset_s", 0.0, 1e5, "s", "after the campaign's begin")

EFFECTS = (
    Effect(
        name="payload",
        place="rig",
        size=EffectParameter("mass_kg", 0.1, 1000.0, "kg", "beyond what is stated, or at 0.25 m beside its centre"),
        reveals="several payloads",
        confounded=("column_compliance", "link_stiffness"),
        forms=payload,
        untested=_untested_with_one_payload,
        textbook=Textbook("in_proportion", "Merlet, Parallel Robots, ch. 9: the platform's equilibrium under a weight"),
        stated_u=_u_payload_kg,
        varies_with=("rest", "time"),
        order=220,
    ),
    Effect(
        name="tables_left_on",
        place="rig",
        size=EffectParameter("weight_ratio", 0.05, 2.0, "1", "part of the table that is applied"),
        reveals="tables that the recording names, drive coordinates off their nodes",
        confounded=("screw_cumulative_error", "axis_coupling"),
        forms=tables_left_on,
        others=(_ONSET,),
        untested=_untested_without_tables,
        textbook=Textbook("all_of_it", "ISO/TR 16907: numerical compensation adds a table's value to the command"),
        varies_with=("own travel", "other travel", "side", "payload", "time", "temperature"),
        order=230,
    ),
    Effect(
        name="drive_scale",
        place="drive",
        size=EffectParameter("shift_m", 1e-6, 1e-3, "m", "of the zero, or at the end of the travel"),
        reveals="time and the drive coordinate, reflectors on the sliders, floor nests",
        confounded=("foundation_settling", "screw_thermal_growth"),
        forms=drive_scale,
        others=(_ONSET,),
        untested=_untested_in_short_campaign,
        textbook=Textbook("scale", "Slocum, Precision Machine Design, ch. 2: scale error of an axis"),
        varies_with=("own travel", "time", "temperature"),
        order=240,
    ),
)
