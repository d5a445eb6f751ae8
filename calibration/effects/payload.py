"""A payload that is another than stated: its mass, its centre, and what comes or goes while the campaign runs.

The calibration takes it as known, within its stated uncertainty, and the machine's model says how its error acts:
through channels of its own, so that one number moves all that depends on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.api import BasisSets, Effect, EffectInputs, EffectParameter, Textbook, varies
from calibration.effects.basis_functions import any_course, cosine_basis, tensor_product
from calibration.effects.onsets import ONSET
from calibration.machine.description import Machine
from calibration.model.payload import PayloadEntry

LEVER_M = 0.25  # at which a mass beside the stated centre turns the platform as the moment of its size does
SWINGS_RAD_PER_S, CALMS_S = (0.9, 1.4, 2.2), 12.0  # of what swings after a stop
REST_TERMS, MOVING_WEIGHT, STOPPED_M_PER_S = 4, 0.2, 0.5  # of a centre that moves on after a stop, from this speed
AGE_TERMS, PLACE_TERMS, CHANGING_WEIGHT = 4, 2, 0.2  # of a load that changes in time or with the place
FINE_TERMS, FINE_WEIGHT = 16, 0.1  # of a centre that slides about
SLIPPED_WEIGHT = 0.5  # of one that slips once
COURSE_TERMS, YIELDING_TERMS = 32, 8  # of what comes onto the platform and goes; of what its weight makes of struts
LEAST_LOAD_SHARE = 1e-3  # of the largest payload: less is none
MOUNTINGS = 6  # terms of what may be otherwise each time


def payload(inputs: EffectInputs, _: int) -> BasisSets:
    """What is mounted has another mass or centre than stated: in proportion, or by any function of load and exchange.

    Weight and its moment in the platform's equilibrium (Merlet, Parallel Robots, Springer 2006, ch. 9). A centre that
    is off by d counts as the mass m d / 0.25 m, which has the same moment at a lever of 0.25 m. Beside each form is
    what struts of another stiffness than the fitted one, which a wrong payload has spoilt, make of its forces.
    """
    sets, kg = BasisSets(), inputs.context.payload_kg
    largest = max(float(kg.max()), 1e-9)
    mounted = (kg > LEAST_LOAD_SHARE * largest).astype(np.float64)
    in_proportion = sets.add(("payload.mass", inputs.payload_ratio), form="in_proportion")
    moment = _moment_of_centre(inputs, mounted)
    shifted = []
    any_load = np.stack([mounted, inputs.payload_ratio, inputs.payload_ratio**2], axis=1)
    each_time = mounted[:, None] * cosine_basis(inputs.context.exchanges, MOUNTINGS)
    anyhow = sets.add(("payload.mass", np.concatenate([any_load, each_time], axis=1)))
    whenever = anyhow[:1]  # of each channel what is always mounted
    for channel in _of_centre(inputs):
        shifted += sets.add((channel, mounted * (LEVER_M / largest)), form="shifted")
        at_any_load = sets.add((channel, moment[:, None] * np.concatenate([any_load, each_time], axis=1)))
        anyhow, whenever = [*anyhow, *at_any_load], [*whenever, at_any_load[0]]

    yielding = partial(_by_strut, sets, inputs)
    sets.add_set(in_proportion, (*shifted, *yielding(in_proportion)))
    sets.add_set(shifted, yielding(shifted))
    sets.add_set(anyhow, yielding(whenever), weight=0.5)
    _add_changing_loads(sets, inputs, mounted)
    if moving_on := _moving_on(sets, inputs, moment):
        sets.add_set(moving_on, weight=MOVING_WEIGHT)
    return sets


def _of_centre(inputs: EffectInputs) -> list[str]:
    """Channels that move the centre of what is mounted."""
    return [c for c in inputs.channels if c.startswith("payload.") and c != "payload.mass"]


def _moment_of_centre(inputs: EffectInputs, mounted: Array) -> Array:
    """By how much (n,) a centre is off that has the moment of one kilogram at the lever."""
    kg = inputs.context.payload_kg
    return np.asarray(mounted * LEVER_M / np.maximum(kg, LEAST_LOAD_SHARE * max(float(kg.max()), 1e-9)))


def _add_changing_loads(sets: BasisSets, inputs: EffectInputs, mounted: Array) -> None:
    """Loads that change in the course of time or with the place: of what is mounted, which may run out or be a chain
    that is lifted, of what comes onto the platform with it or without, as chips do; and a centre that moves in time."""
    one = np.ones(len(mounted))
    place = np.column_stack([one, *(cosine_basis(q, PLACE_TERMS) for q in inputs.context.drives.T)])
    by_side = [] if "direction" in inputs.context.not_said else [_by_side(inputs)]  # as a rope's friction has it
    for loads in (place, mounted[:, None] * place, *by_side):
        changing = sets.add(("payload.mass", loads))
        sets.add_set(changing, _by_strut(sets, inputs, changing[:1]), weight=CHANGING_WEIGHT)
    if "t_s" in inputs.context.not_said:
        return
    age = cosine_basis(inputs.context.elapsed_s, AGE_TERMS, constant=True)
    for loads in (age, mounted[:, None] * age):
        changing = sets.add(("payload.mass", loads))
        sets.add_set(changing, _by_strut(sets, inputs, changing), weight=CHANGING_WEIGHT)
    # What comes and goes, with any payload or none: parts that wait, coolant that stands on the platform.
    lying = sets.add(("payload.mass", any_course(inputs.context.elapsed_s, COURSE_TERMS)))
    sets.add_set(lying, _by_strut(sets, inputs, lying[:YIELDING_TERMS]), weight=FINE_WEIGHT)
    _add_slipped(sets, inputs, mounted)
    finely = any_course(inputs.context.elapsed_s, FINE_TERMS)
    slid = _moment_of_centre(inputs, mounted)[:, None] * finely
    if sliding := [c for channel in _of_centre(inputs) for c in sets.add((channel, slid))]:
        sets.add_set(sliding, _by_strut(sets, inputs, sliding[:1]), weight=FINE_WEIGHT)


def _add_slipped(sets: BasisSets, inputs: EffectInputs, mounted: Array) -> None:
    """A centre that is beside the stated one, and slips at a moment to where it lies whenever it is mounted."""
    moment = _moment_of_centre(inputs, mounted)
    centre = [c for channel in _of_centre(inputs) for c in sets.add((channel, moment), form="slipped")]
    of_moments = {
        onset_s: prior
        for column in centre
        for onset_s, prior in inputs.strength_onsets(f"payload.slipped.{column}", sets.contributions[column])
    }
    for onset_s, prior in of_moments.items():
        after = moment * (inputs.context.elapsed_s >= onset_s)
        slipped = [c for channel in _of_centre(inputs) for c in sets.add((channel, after), form="slipped")]
        before = [c for channel in _of_centre(inputs) for c in sets.add((channel, moment - after), form="slipped")]
        beside = _by_strut(sets, inputs, [*before, *slipped])
        first = len(sets.sets)
        sets.add_set((*before, *slipped), beside, weight=SLIPPED_WEIGHT * prior, onset_s=onset_s)
        sets.act_in_spells(2, since=first)


def _by_side(inputs: EffectInputs) -> Array:
    """What hangs on a drive by the side (n, 2 d) from which it has come: the same with any payload, and with each."""
    side, ratio = inputs.context.direction, inputs.payload_ratio[:, None]
    return np.concatenate([side, side * ratio], axis=1)


def _moving_on(sets: BasisSets, inputs: EffectInputs, moment: Array) -> list[int]:
    """Columns of a payload whose centre moves on when its drives stop: to any side, by any function of the rest."""
    context = inputs.context
    if {"direction", "dwell_s", "speed_m_per_s"} & context.not_said.keys():
        return []
    t = context.dwell_s[:, None]
    swings = [np.exp(-t / CALMS_S) * wave(t * np.array(SWINGS_RAD_PER_S)) for wave in (np.cos, np.sin)]
    rests = np.column_stack([cosine_basis(np.log(context.dwell_s + 0.3), REST_TERMS, constant=True), *swings])
    stopped = tensor_product(context.direction * context.speed_m_per_s[:, None] / STOPPED_M_PER_S, rests)
    return [c for channel in _of_centre(inputs) for c in sets.add((channel, moment[:, None] * stopped))]


def _by_strut(sets: BasisSets, inputs: EffectInputs, columns: Sequence[int]) -> list[int]:
    """What each strut grows by the forces of columns of the payload, if it is twice as soft as in the model."""
    out = list[int]()
    for column in columns:
        ((channel, shape),) = sets.contributions[column]
        if channel in inputs.payload_elongation_m:
            growth = shape[:, None] * inputs.payload_elongation_m[channel]
            for strut, name in enumerate(inputs.machine.strut_names):
                out += sets.add((f"length.{name}", growth[:, strut]), form=sets.named[column])
    return out


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


EFFECTS = (
    Effect(
        name="payload",
        place="rig",
        size=EffectParameter("mass_kg", 0.1, 1000.0, "kg", "beyond what is stated, or at 0.25 m beside its centre"),
        reveals="several payloads",
        confounded=("column_compliance", "link_stiffness"),
        forms=payload,
        others=(ONSET,),
        untested=_untested_with_one_payload,
        textbook=Textbook("in_proportion", "Merlet, Parallel Robots, ch. 9: the platform's equilibrium under a weight"),
        stated_u=_u_payload_kg,
        varies_with=("rest", "time"),
        order=220,
    ),
)
