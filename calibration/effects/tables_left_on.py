"""Compensation tables that are on though the recording says off; the known tables say what they do."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

import numpy as np

from calibration.effects.api import BasisSets, Effect, EffectInputs, EffectParameter, Textbook
from calibration.effects.basis_functions import any_course, cosine_basis
from calibration.effects.onsets import ONSET

TABLE_TERMS = 3  # of any function of another drive's coordinate
PART_TERMS = 12  # of a share of it that may begin or end anywhere along its drive
BESIDE_M = (0.03, 0.08, 0.15, 0.22)  # beside its own place, at which a table may be looked up
WALK_TERMS = 12  # of what may be otherwise at any time
WALK_WEIGHT = 0.02  # of a table whose weight changes at any time
MOST_STANDING = 9  # nodes at which a control may take the second drive of a table to stand
ONE_DRIVE_WEIGHT = 0.2  # of a table that is on in one drive alone


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
    _add_tables_in_part(sets, inputs)
    _add_tables_beside_their_places(sets, inputs)
    _add_tables_of_other_drives(sets, inputs)
    _add_tables_read_otherwise(sets, inputs)
    if "t_s" in context.not_said:  # who knows when: nothing depends on time then
        return sets
    for generation in context.table_generations:
        t = context.elapsed_s
        corrections = context.table_corrections_m(generation, drives, context.drives)
        at_times = np.column_stack([one, any_course(t, WALK_TERMS)])
        sets.add_set(sets.add((f"table.{generation}", at_times)), weight=WALK_WEIGHT)
        in_each = [(f"travel.{n}", c) for n, c in zip(drives, corrections.T, strict=True) if np.any(c)]
        if len(drives) > 1 and in_each:
            of_each = [c for channel, shape in in_each for c in sets.add((channel, shape[:, None] * at_times))]
            sets.add_set(of_each, weight=WALK_WEIGHT)
        for onset, prior in inputs.onsets((f"table.{generation}",)):
            after = (t >= onset).astype(np.float64)
            for switched in (after, 1.0 - after):
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


def _add_tables_in_part(sets: BasisSets, inputs: EffectInputs) -> None:
    """Tables of which only a part is on, as after a transfer that broke off: each times a walk along its own drive."""
    context, drives = inputs.context, inputs.machine.drive_names
    for generation in context.table_generations:
        corrections = context.table_corrections_m(generation, drives, context.drives)
        parts = [
            (f"travel.{name}", corrections[:, a : a + 1] * cosine_basis(q, PART_TERMS, roughness=1.0, constant=True))
            for a, (name, q) in enumerate(zip(drives, context.drives.T, strict=True))
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


def _add_tables_of_other_drives(sets: BasisSets, inputs: EffectInputs) -> None:
    """Each table is at another drive, as after drives were counted from another one, or from the other end."""
    context, drives = inputs.context, inputs.machine.drive_names
    counted_otherwise = {*(drives[k:] + drives[:k] for k in range(1, len(drives))), drives[::-1]} - {drives}
    for generation in context.table_generations:
        for named in sorted(counted_otherwise):
            corrections = context.table_corrections_m(generation, named, context.drives)
            parts = [(f"travel.{name}", c) for name, c in zip(drives, corrections.T, strict=True) if np.any(c)]
            if parts:
                weight = ONE_DRIVE_WEIGHT / len(counted_otherwise)
                sets.add_set(sets.add(*parts, form="at_another_drive"), weight=weight)


def _add_tables_read_otherwise(sets: BasisSets, inputs: EffectInputs) -> None:
    """A control may not interpolate between a table's nodes, or not know of the drive on which it also depends."""
    context, drives = inputs.context, inputs.machine.drive_names
    for generation in context.table_generations:
        tables = [
            of_drive
            for of_drive in context.tables_at(generation, drives, context.drives)
            if np.any(of_drive[1].corrections_m)  # whatever the readings: a twin's must have the same columns
        ]
        if not tables:
            continue
        have_partner = any(table.partner for _, table, _, _ in tables)
        ways = 3 if have_partner else 2  # without a second drive the last one is the first
        at_nodes = [(f"travel.{drives[a]}", table.at_nodes_m(*at_m)[:, :ways]) for a, table, *at_m in tables]
        held = sets.add(*at_nodes, form="not_interpolated")
        for column in held:
            sets.add_set([column], weight=ONE_DRIVE_WEIGHT / len(held))
        if have_partner:
            stands_anywhere = [
                c
                for a, table, own_m, _ in tables
                for node_m in _some_nodes(table.partner_m or (0.0,))
                for c in sets.add(
                    (f"travel.{drives[a]}", table.correction_m(own_m, np.full_like(own_m, node_m))),
                    form="partner_stands",
                )
            ]
            share = 1.0 / len(tables)  # the coefficients of a table add up to its weight
            sets.add_set(stands_anywhere, weight=ONE_DRIVE_WEIGHT, size=(share,) * len(stands_anywhere))


def _some_nodes(nodes: Sequence[float]) -> list[float]:
    """Nodes of a table, or as many of them as are enough, from end to end."""
    numbers = np.linspace(0, len(nodes) - 1, min(len(nodes), MOST_STANDING)).round().astype(int)
    return [nodes[k] for k in numbers.tolist()]


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


def _untested_without_tables(inputs: EffectInputs) -> str | None:
    return None if inputs.context.known_tables else "the recording names no compensation tables"


EFFECTS = (
    Effect(
        name="tables_left_on",
        place="rig",
        size=EffectParameter("weight_ratio", 0.05, 2.0, "1", "part of the table that is applied"),
        reveals="tables that the recording names, drive coordinates off their nodes",
        confounded=("screw_cumulative_error", "axis_coupling"),
        forms=tables_left_on,
        others=(ONSET,),
        untested=_untested_without_tables,
        textbook=Textbook("all_of_it", "ISO/TR 16907: numerical compensation adds a table's value to the command"),
        varies_with=("own travel", "other travel", "side", "payload", "time", "temperature"),
        order=230,
    ),
)
