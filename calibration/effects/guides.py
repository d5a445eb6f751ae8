"""Errors of guides and foundation: straightness, angular errors, settling."""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.api import (
    BasisSets,
    Coordinate,
    Effect,
    EffectInputs,
    EffectParameter,
    Textbook,
    strongest_onset,
    varies,
)
from calibration.effects.basis_functions import (
    cosine_basis,
    course_with_jumps,
    random_walk_basis,
    steps_over,
    tensor_product,
)
from calibration.effects.onsets import ONSET, untested_in_short_campaign
from calibration.recording.header import HOUR_S

SHORTEST_WAVE_M = 0.06
EXCHANGES_WEIGHT = 0.1  # of one that gives way at each payload exchange
SLAB_S, SLAB_WEIGHT = (0.0, 1500.0), 0.3  # of what a floor follows, at once on top and late below
ONSETS = 14
SETTLING_S = (600.0, 3000.0)
UNEVEN_WAVE_M, UNEVEN_WEIGHT = 0.02, 0.3  # shortest wave of a rail that its bolts draw down
ANYWHERE = "anywhere"  # form of a slider that lies elsewhere in its play at each visit
SIDE_TERMS, SIDE_WEIGHT = 6, 0.3  # of what is another deviation for each side of the approach
APART_TERMS, APART_WEIGHT = 16, 0.2  # of what another carriage does to this one, by how far it is
BENT_TERMS, COURSE_TERMS, BENT_WEIGHT = 6, 8, 0.3  # of a guide whose form changes


CHANGES_WITH: tuple[Coordinate, ...] = (
    "other travel", "side", "payload", "rest", "speed", "time", "course", "way", "temperature",
)  # fmt: skip


def straightness(inputs: EffectInputs, drive: int) -> BasisSets:
    """The slider deviates sideways from its axis along the travel, or as another carriage pushes it aside."""
    channels = inputs.channels_of_drive("sideways", drive)
    sets, q = _along_travel(inputs, drive, channels), inputs.context.drives[:, drive]
    for channel in channels:
        along = sets.add((channel, cosine_basis(q, BENT_TERMS, roughness=1.0)))
        for other in inputs.other_drives(drive):
            pushed = cosine_basis(inputs.context.drives[:, other] - q, APART_TERMS, roughness=1.0, constant=True)
            sets.add_set(sets.add((channel, pushed)), along, share=0.3, weight=APART_WEIGHT)
    return sets


def angular(inputs: EffectInputs, drive: int) -> BasisSets:
    """The slider rotates along its travel, or lies turned in the play of its guide, elsewhere after each motion."""
    channels = inputs.channels_of_drive("turn", drive)
    sets = _along_travel(inputs, drive, channels)
    for channel in channels:
        sets.add_set(sets.add((channel, np.ones(len(inputs.context))), form=ANYWHERE))
    return sets


def _along_travel(inputs: EffectInputs, drive: int, channels: tuple[str, ...]) -> BasisSets:
    sets, q = BasisSets(), inputs.context.drives[:, drive]
    span = float(np.ptp(q))
    fine = int(np.clip(2.0 * span / SHORTEST_WAVE_M, 6, 28))
    finest = int(np.clip(2.0 * span / UNEVEN_WAVE_M, 6, 80))
    bends = _bends_in_time(inputs, q)
    for channel in channels:
        curve = sets.add((channel, cosine_basis(q, fine, roughness=1.0)))
        loaded = sets.add((channel, 2.0 * cosine_basis(q, fine, roughness=1.0) * (inputs.payload_ratio - 0.5)[:, None]))
        sets.add_set(curve[:6], loaded[:6], share=0.5)
        sets.add_set(curve, loaded, share=0.5)
        if "direction" not in inputs.context.not_said:  # play of the guide: it lies at one side or the other
            side = inputs.context.direction[:, drive : drive + 1]
            along = cosine_basis(q, SIDE_TERMS, roughness=1.0, constant=True)
            sided = sets.add((channel, side * along))
            sets.add_set(sided, curve, share=0.5, weight=SIDE_WEIGHT)
            by_load = sets.add((channel, 2.0 * side * (inputs.payload_ratio - 0.5)[:, None] * along))
            sets.add_set((*sided, *by_load), curve, share=0.5, weight=SIDE_WEIGHT)
        sets.add_set(sets.add((channel, cosine_basis(q, finest, roughness=0.5))), weight=UNEVEN_WEIGHT)
        if bends is not None:
            sets.add_set((*curve[:BENT_TERMS], *sets.add((channel, bends))), weight=BENT_WEIGHT)
    return sets


def _bends_in_time(inputs: EffectInputs, q: Array) -> Array | None:
    """Curves (n, k) along the travel that change in the course of time, as a bed bends that warms on one side; None
    where the readings do not say their times."""
    if "t_s" in inputs.context.not_said:
        return None
    course = random_walk_basis(inputs.context.elapsed_s / HOUR_S, COURSE_TERMS)
    return tensor_product(cosine_basis(q, BENT_TERMS, roughness=1.0), course)


def settling(inputs: EffectInputs, drive: int) -> BasisSets:
    """The foot of a column sinks and the column leans: along the axis, sideways with the height, and in rotation."""
    sets, t, h = BasisSets(), inputs.context.elapsed_s, inputs.height_m(drive)
    travel = f"travel.{inputs.drive(drive)}"
    pairs = inputs.leaning(drive)

    def columns(sunk: Array, form: str = "") -> tuple[list[int], list[int]]:
        wide = sunk[:, None] if sunk.ndim == 1 else sunk
        down = sets.add((travel, -wide), form=form)
        lean = [sets.add((side, sign * wide * h[:, None]), (turn, wide), form=form) for side, turn, sign in pairs]
        return down, [column for pair in lean for column in pair]

    end = float(t.max())
    onsets = inputs.onsets((travel, *inputs.channels_of_drive("sideways", drive)))
    for onset, prior in onsets:
        down, lean = columns((t >= onset).astype(np.float64), "step")
        sets.add_set(down, lean, share=0.5, onset_s=onset, weight=prior * ONSETS)
    for onset in np.linspace(0.0, 0.95, ONSETS) * end:
        for tau in SETTLING_S:
            down, lean = columns(1.0 - np.exp(-np.maximum(t - onset, 0.0) / tau), "consolidation")
            sets.add_set(down, lean, share=0.5, onset_s=float(onset))
    if temperatures := inputs.context.relative_changes(inputs.context.temperatures_c, SLAB_S):  # a slab that curls
        down, lean = columns(np.column_stack([change for change, _ in temperatures]))
        sets.add_set(down, lean, share=0.5, weight=SLAB_WEIGHT)
    numbers = np.unique(inputs.context.exchanges)[1:]
    if numbers.size:  # whatever brings a payload presses the foot down, each time by another amount
        pressed, before = (inputs.context.exchanges[:, None] >= numbers).astype(np.float64), len(sets.sets)
        down, lean = columns(pressed, "exchanges")
        sets.add_set(down, lean, share=0.5, weight=EXCHANGES_WEIGHT, **strongest_onset(onsets))
        sets.keep_one_way(steps_over(t, pressed), since=before)
    course = course_with_jumps(t, 24, [onset for onset, _ in onsets])
    down, lean = columns(course)
    of_each = [lean[k : k + len(down)] for k in range(0, len(lean), len(down))]
    steps, onset_of_walk = steps_over(t, course), strongest_onset(onsets)
    for terms in (len(down), 6):
        flexible = [c for leaning in of_each for c in leaning[:terms]]
        before = len(sets.sets)
        sets.add_set(down[:terms], flexible, share=0.5, weight=4.0, **onset_of_walk)
        sets.keep_one_way(steps[:, :terms], since=before)
    return sets


def _untested_with_short_travel(inputs: EffectInputs) -> str | None:
    return None if all(varies(q, 0.1) for q in inputs.context.drives.T) else "the drives hardly moved"


EFFECTS = (
    Effect(
        name="guide_straightness",
        place="drive",
        size=EffectParameter("amplitude_m", 1e-6, 4e-4, "m", "RMS sideways"),
        reveals="drive coordinate, reflectors on the sliders",
        confounded=("screw_cumulative_error",),
        forms=straightness,
        untested=_untested_with_short_travel,
        measured="rms",
        functions_vary_with=CHANGES_WITH,
        order=120,
    ),
    Effect(
        name="guide_angular",
        place="drive",
        size=EffectParameter("amplitude_rad", 2e-6, 4e-3, "rad", "RMS rotation"),
        reveals="drive coordinate, platform rotation; not a slider's reflector",
        confounded=("joint_clearance",),
        forms=angular,
        untested=_untested_with_short_travel,
        measured="rms",
        differs_by_visit=True,
        anew_by_visit=ANYWHERE,
        functions_vary_with=CHANGES_WITH,
        order=130,
    ),
    Effect(
        name="foundation_settling",
        place="drive",
        size=EffectParameter("settled_m", 1e-6, 8e-4, "m", "how far the foot sinks"),
        reveals="time, reflectors on the sliders against the floor nests",
        confounded=("column_thermal_growth", "tracker_drift"),
        forms=settling,
        others=(ONSET,),
        untested=untested_in_short_campaign,
        measured="range",
        textbook=Textbook("consolidation", "Terzaghi, Theoretical Soil Mechanics: settlement that dies away"),
        varies_with=("own travel", "other travel", "payload"),
        functions_vary_with=("own travel", "other travel", "payload"),
        order=140,
    ),
)
