"""How an effect departs from the textbook's form: the form times a function of whatever else varies in a campaign.

No real part follows a formula exactly. Play differs along the travel, friction with the load, and what one stop leaves
of it the next one does not. A departure is a column of the form times one such function; where the form is zero, so is
what departs from it.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.api import BasisSet, Coordinate, Departure, Effect, EffectInputs
from calibration.effects.basis_functions import cosine_basis, wave_of
from calibration.effects.columns import Contributions

VISIT = "visit"
STIFFNESS = "stiffness"  # in place of a coordinate: how much the response depends on that of a strut or guide
STIFFENED = (
    "stiffened"  # kind of the channels that say so: by the logarithm of a stiffness, per unit of another channel
)
DEPENDS_ON_STIFFNESS = ("travel", "scale", "table", "sideways", "turn", "length", "weight", "force", "payload")
OWN_TERMS, OTHER_TERMS, TIME_TERMS = 12, 2, 3  # half waves over the range of a coordinate
CHANGING_TERMS = 4  # of the own travel, by each of the many columns of a general function
COURSE_TERMS = 16  # of any course in time, as after somebody has wiped, set or tightened something
WARMTH_S = (300.0, 1500.0)  # in which what a drive's motions warm cools again: bearings and grease, a housing
ROUGHNESS, WALK = 1.5, 1.0  # powers by which their size falls: of a smooth function, of a random walk
SHORTEST_REST_S = 0.1
# How many periods each wave has in one. Not one: a wave by side times itself is, in its mean, play.
WAVES = (1.0 / 3.0, 0.5, *(float(k) for k in range(2, 12)))
# Positions of a drive, those within SAME_M being one: of fewer a column, waves of any form explain anything.
SAME_M, POSITIONS_A_COLUMN = 1.0e-4, 3
ALWAYS: tuple[Coordinate, ...] = (
    "own travel", "other travel", "side", "approach", "payload", "rest", "speed", "time",
)  # fmt: skip


def functions_of_coordinates(inputs: EffectInputs, effect: Effect, place: int) -> dict[str, Array]:
    """Smooth functions (n, k), of total RMS one, of each coordinate that varies and on which any effect may depend."""
    return _functions(inputs, effect, place, ALWAYS)


def functions_of_change(inputs: EffectInputs, effect: Effect, place: int) -> dict[str, Array]:
    """The same of each coordinate with which its general functions may change."""
    return _functions(inputs, effect, place, effect.functions_vary_with, own_terms=CHANGING_TERMS)


def functions_it_varies_with(
    inputs: EffectInputs, effect: Effect, place: int, period_m: float = 0.0
) -> dict[str, Array]:
    """The same of each coordinate on which the effect's strength may depend wholly; period_m: of what repeats."""
    functions = _functions(inputs, effect, place, effect.varies_with)
    if period_m > 0.0 and effect.place == "drive" and "phase" in effect.varies_with:
        functions |= _functions_of_phase(inputs, place, period_m)
    return functions


def _functions_of_phase(inputs: EffectInputs, drive: int, period_m: float) -> dict[str, Array]:
    """Waves of a drive's coordinate within a period, a few periods and its fractions: by themselves and by side.

    A wave times these is a wave of any form, as of signals that are cut off, counted, or switched late. None where the
    drive had too few positions to tell.
    """
    columns = 2 * 2 * len(WAVES)  # a sine and a cosine, times those of each wave
    if len(np.unique(np.round(inputs.context.drives[:, drive] / SAME_M))) < POSITIONS_A_COLUMN * columns:
        return {}
    name = inputs.machine.drive_names[drive]
    weights = np.array([min(k, 1.0 / k) for k in WAVES])
    waves = np.concatenate([wave_of(inputs.context.drives[:, drive], period_m / k) for k in WAVES], axis=1)
    form = waves * np.repeat(weights / np.sqrt(np.sum(weights**2)), 2)
    side = inputs.context.direction[:, drive : drive + 1]
    both_ways = bool(np.ptp(side) > 0.0)
    return {f"phase.{name}": form} | ({f"phase by side.{name}": side * form} if both_ways else {})


def functions_of_strength(inputs: EffectInputs, effect: Effect, place: int) -> list[Array]:
    """As `functions_it_varies_with`, of each coordinate whether it varies or not, and of a side the side itself.

    A twin's further readings must not add columns or change those of the campaign.
    """
    return [
        x[:, None] if kind == "side" else _functions_of(kind, x, terms)
        for kind, _, x, terms in _coordinates(inputs, effect, place, effect.varies_with)
    ]


def _functions(
    inputs: EffectInputs, effect: Effect, place: int, kinds: Collection[Coordinate], own_terms: int = OWN_TERMS
) -> dict[str, Array]:
    def build() -> dict[str, Array]:
        return {
            name: _functions_of(kind, x, min(terms, own_terms) if kind == "own travel" else terms)
            for kind, name, x, terms in _coordinates(inputs, effect, place, kinds)
            if np.ptp(x) > 0.0
        }

    # A copy: whoever asks may add to it.
    return dict(inputs.once(("functions of coordinates", effect.place, place, tuple(kinds), own_terms), build))


def _functions_of(kind: Coordinate, x: Array, terms: int) -> Array:
    """Functions (n, k) of a coordinate of total RMS one: smooth ones, or as a walk that may jump."""
    return cosine_basis(x, terms, roughness=WALK if kind == "course" else ROUGHNESS)


def _coordinates(
    inputs: EffectInputs, effect: Effect, place: int, kinds: Collection[Coordinate]
) -> list[tuple[Coordinate, str, Array, int]]:
    """Coordinates (n,) of some kinds that the readings say, with their names and numbers of terms."""
    machine, context = inputs.machine, inputs.context
    if effect.place == "drive":
        own: tuple[int, ...] = (place,)
    elif effect.place == "strut":
        own = tuple(d for d in range(len(machine.drive_names)) if d == machine.strut_drive[place])
    else:
        own = tuple(range(len(machine.drive_names)))
    out: list[tuple[Coordinate, str, Array, int]] = []
    for d, name in enumerate(machine.drive_names):
        kind: Coordinate = "own travel" if d in own else "other travel"
        terms = OTHER_TERMS if d not in own else OWN_TERMS if len(own) == 1 else CHANGING_TERMS
        out.append((kind, f"travel.{name}", context.drives[:, d], terms))
    moved, timed = "history" not in context.not_said, "t_s" not in context.not_said
    if moved and "approach" in kinds:
        leg_m = context.drives - context.previous_drives
    for d in own:
        name = machine.drive_names[d]
        out.append(("side", f"side.{name}", context.direction[:, d], 1))
        if moved and "approach" in kinds:
            out.append(("approach", f"approach.{name}", np.abs(leg_m[:, d]), OTHER_TERMS))
            turned = context.direction[:, d] * leg_m[:, d] < 0.0
            out.append(("approach", f"turned.{name}", turned.astype(np.float64), 1))
        if moved and "way" in kinds:
            out.append(("way", f"way.{name}", context.way_m(d), TIME_TERMS))
        if moved and timed and "warmth" in kinds:
            for tau_s in WARMTH_S:
                out.append(("warmth", f"warmth.{name}.{tau_s:.0f}s", context.motion_heat(d, tau_s), OTHER_TERMS))
    out += [
        ("payload", "payload", context.payload_kg, 1),
        ("rest", "rest", np.log(np.maximum(context.dwell_s, SHORTEST_REST_S)), OTHER_TERMS),
        ("speed", "speed", context.speed_m_per_s, 1),
    ]
    if timed:
        out.append(("time", "time", context.elapsed_s, TIME_TERMS))
        out.append(("course", "course", context.elapsed_s, COURSE_TERMS))
    if "temperature" in kinds and context.temperatures_c:
        out.append(("temperature", "temperature", context.mean_temperature_c(), OTHER_TERMS))
    return [entry for entry in out if entry[0] in kinds]


def departing(
    inputs: EffectInputs,
    effect: Effect,
    place: int,
    contributions: Sequence[Contributions],
    chosen: Sequence[Departure],
) -> tuple[Contributions, ...]:
    """The columns of some departures from those of a basis set, which stand at `Departure.column`."""
    functions: dict[str, Array] = {}
    if any(d.coordinate not in (VISIT, STIFFNESS) for d in chosen):
        functions |= functions_of_coordinates(inputs, effect, place)
        period_m = max((d.period_m for d in chosen), default=0.0)
        functions |= functions_of_change(inputs, effect, place)
        functions |= functions_it_varies_with(inputs, effect, place, period_m)

    def function(departure: Departure) -> Array:
        if departure.coordinate == VISIT:
            return (inputs.context.arrival == departure.term).astype(np.float64)
        return functions[departure.coordinate][:, departure.term]

    def column(departure: Departure) -> Contributions:
        form = contributions[departure.column]
        if departure.coordinate == STIFFNESS:
            return through_stiffened(inputs, departure.term, form)
        return tuple((channel, shape * function(departure)) for channel, shape in form)

    return tuple(map(column, chosen))


def through_stiffened(inputs: EffectInputs, constraint: int, form: Contributions) -> Contributions:
    """What a form does more by the logarithm of the stiffness of a strut or guide, by its number."""
    machine = inputs.machine
    name = (*machine.strut_names, *machine.guide_names)[constraint]
    return tuple(
        (f"{STIFFENED}.{name}.{channel}", shape)
        for channel, shape in form
        if channel.partition(".")[0] in DEPENDS_ON_STIFFNESS
    )


def lasting_columns(
    contributions: Sequence[Contributions], inputs: EffectInputs, effect: Effect, place: int, basis_set: BasisSet
) -> tuple[Contributions, ...]:
    """Columns of a basis set that say something of other visits too; contributions: all columns of the effect.

    They have the first coefficients of the basis set: what belongs to single visits stands last.
    """
    own = tuple(contributions[column] for column in basis_set.columns)
    return own + departing(inputs, effect, place, own, lasting_departures(basis_set))


def lasting_departures(basis_set: BasisSet) -> tuple[Departure, ...]:
    """Those that do not belong to single visits."""
    return tuple(departure for departure in basis_set.departures if departure.coordinate != VISIT)
