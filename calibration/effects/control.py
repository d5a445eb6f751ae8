"""Errors of the control system: axis crosstalk, latency of the readings, settling after a motion."""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.api import BasisSets, Effect, EffectInputs, EffectParameter, Textbook, geometric_series, varies
from calibration.effects.basis_functions import any_course, cosine_basis, tensor_product, wave_of
from calibration.effects.onsets import ONSET

REFERENCE_SPEED_M_PER_S = 0.5
DWELL_TIMES_S = geometric_series(0.5, 16.0, 7)
CAPS_M_PER_S = (10.0, 0.3, 0.2, 0.15, 0.125)
TURNS_M, TURNS_WEIGHT = (1.0e-3, 6.0e-2), 0.3  # periods over the other's coordinate, or over the difference of both
FEWEST_POSITIONS = 100  # of fewer, some wave explains a sixth of anything by chance
OTHER_TERMS, OWN_TERMS = 4, 2  # of any function of both axes: of the other, and of the one that is shifted
WAVE_TERMS, WAVE_WEIGHT = 24, 0.2  # half waves of any function of the other, from those that turns begin with
TOGETHER_TERMS = 6  # of any function of both axes together
DRAGGED_WIDTHS, DRAGGED_WEIGHT = (0.0, 0.1, 0.25, 0.5, 0.75, 1.0), 0.2  # of plays, over half the other's travel
SWITCHED_WIDTHS, SWITCHED_AT, SWITCHED_WEIGHT = (0.05, 0.15, 0.3), np.linspace(-0.6, 0.6, 9), 0.1  # of switches
CURVE_TERMS = 5  # of any smooth function of the other
SPEED_TERMS, LEG_TERMS = 2, 3  # of any function of the speed, and of the length of the last leg
SHORT_LEG_M = 0.01  # below which a leg's length does not matter
REST_TERMS = 6  # of any function of the rest
COURSE_TERMS, COURSE_WEIGHT = 24, 0.02  # of a delay by any course in time
AGE_TERMS, AGE_WEIGHT = 4, 0.3  # the first of them: a slow course
STANDING_M_PER_S = 1.0e-3  # below which a drive that crosses another one's motion hardly moves
WAY_WEIGHT = 0.3  # of a delay by a fixed way, as of a mean over so many counts, against one by a fixed time
AFTER_EFFECT_S = (0.8, 3.0, 12.0, 50.0, 200.0, 800.0)  # in which a part forgets former motions
AFTER_EFFECT_WEIGHT = 0.1
LIMITS_M, WOUND_S = (1.0e-3, 0.05, 0.2, 0.6), (1.0, 3.0, 10.0, 30.0)  # ways that wind up wholly; time constants
REPORTED_M = 5.0e-7  # following error at rest, of which less is noise of the encoder
ANY_REST_WEIGHT = 0.2  # of any course at rest, against those that die away


def coupling(inputs: EffectInputs, drive: int) -> BasisSets:
    """The position or approach direction of another axis shifts this one."""
    sets, travel, context = BasisSets(), f"travel.{inputs.drive(drive)}", inputs.context
    for other in inputs.other_drives(drive):
        (middle, half), q = inputs.travel_range_m(other), context.drives[:, other]
        straight = sets.add((travel, q - middle), form="in_proportion")
        curve = sets.add((travel, half * cosine_basis(q, CURVE_TERMS)))
        sets.add_set(straight, curve[1:], share=0.5)
        sets.add_set(curve)
        own = cosine_basis(context.drives[:, drive], OWN_TERMS, constant=True)
        sets.add_set(sets.add((travel, half * tensor_product(cosine_basis(q, OTHER_TERMS), own))))
        waves = sets.add((travel, half * cosine_basis(q, WAVE_TERMS, roughness=0.5)))
        sets.add_set(waves, weight=WAVE_WEIGHT)
        own_q = context.drives[:, drive]
        for together in (q - own_q, q + own_q):  # by how far both stand apart, or by their middle
            sets.add_set(sets.add((travel, half * cosine_basis(together, TOGETHER_TERMS))))
        if "history" not in context.not_said:  # and comes after only once it has gone far enough
            sets.add_set(sets.add((travel, half * _dragged_by(inputs, other))), weight=DRAGGED_WEIGHT)
            sets.add_set(sets.add((travel, half * _switched_by(inputs, other))), weight=SWITCHED_WEIGHT)
        push = 0.25 * context.direction[:, other]
        # By any function of speed and length of the last leg, from which follows how fast the other axis came.
        whatever_speed = cosine_basis(context.speed_m_per_s, SPEED_TERMS, constant=True)
        leg_m = np.abs(q - context.previous_drives[:, other]) if "history" not in context.not_said else np.zeros(len(q))
        whatever_leg = cosine_basis(np.log(leg_m + SHORT_LEG_M), LEG_TERMS, constant=True)
        sets.add_set(sets.add((travel, push[:, None] * tensor_product(whatever_speed, whatever_leg))), weight=0.5)
        # On the fly it comes as fast as asked, after a short approach perhaps not.
        on_the_fly = context.moving.astype(np.float64)
        both = np.column_stack([whatever_speed * (1.0 - on_the_fly)[:, None], whatever_speed * on_the_fly[:, None]])
        sets.add_set(sets.add((travel, push[:, None] * both)), weight=0.5)
        for over in _coordinates_with(inputs, drive, other):
            along = context.drives @ np.array(over)
            for period, prior in inputs.periods(drive, *TURNS_M, over):
                turning, twice = (sets.add((travel, 0.25 * wave_of(along, period / k))) for k in (1.0, 2.0))
                sets.add_set(turning, twice, share=0.5, weight=TURNS_WEIGHT * prior, period_m=period)
    return sets


def _dragged_by(inputs: EffectInputs, other: int) -> Array:
    """Plays (n, k) of several widths that another drive has dragged along, over half its travel: any part with memory
    of where that was, as a rope that sticks on its pulley."""
    middle, half = inputs.travel_range_m(other)
    dragged = [inputs.context.dragged(other, width * half) for width in DRAGGED_WIDTHS]
    return (np.stack(dragged, axis=1) - middle) / half


def _switched_by(inputs: EffectInputs, other: int) -> Array:
    """States (n, k), -1 or 1, of switches that another drive passes over, of several hystereses at several places:
    whatever has thresholds, as a valve on a cam (Preisach's operator; Mayergoyz, Mathematical Models of Hysteresis)."""
    middle, half = inputs.travel_range_m(other)
    dragged = [inputs.context.dragged(other, width * half) for width in SWITCHED_WIDTHS]
    return np.column_stack([np.where(lies >= middle + at * half, 1.0, -1.0) for lies in dragged for at in SWITCHED_AT])


def _coordinates_with(inputs: EffectInputs, drive: int, other: int) -> tuple[tuple[float, ...], ...]:
    """Weights of the drives' coordinates over which errors of a drive may repeat with another: the other's alone, as of
    its screw that turns, and the difference of both, as of signals that mix. None where the other had few positions."""
    if len(np.unique(np.round(inputs.context.drives[:, other], 7))) < FEWEST_POSITIONS:
        return ()
    own, others = np.eye(len(inputs.machine.drive_names))[[drive, other]]
    return tuple(others.tolist()), tuple((others - own).tolist())


def latency(inputs: EffectInputs, _: int) -> BasisSets:
    """The drives are sampled at another time than the station: an error v tau while moving, decaying after a stop."""
    sets, context = BasisSets(), inputs.context
    drives = range(len(inputs.machine.drive_names))

    def all_drives(shape: Array, form: str = "") -> list[int]:
        return sets.add(*((f"travel.{inputs.drive(a)}", shape[:, a]) for a in drives), form=form)

    speed = np.abs(context.velocity_m_per_s).max(axis=1, keepdims=True)
    moving = all_drives(context.velocity_m_per_s, "dead_time")
    whatever_speed = cosine_basis(speed[:, 0], SPEED_TERMS)
    any_speed = [c for term in whatever_speed.T for c in all_drives(context.velocity_m_per_s * term[:, None])]
    # Of each drive but the last: how much its delay differs from the others'.
    by_drive = [c for a in drives[:-1] for c in sets.add((f"travel.{inputs.drive(a)}", context.velocity_m_per_s[:, a]))]
    sets.add_set(moving, (*any_speed, *by_drive), share=0.6)
    # Positions that are means over a fixed way are late by that way, however fast: by its time at the reference speed.
    v = context.velocity_m_per_s * context.moving[:, None]
    behind = REFERENCE_SPEED_M_PER_S * v / np.hypot(v, STANDING_M_PER_S)
    each_way = [c for a in drives[:-1] for c in sets.add((f"travel.{inputs.drive(a)}", behind[:, a]))]
    sets.add_set(all_drives(behind, "fixed_way"), (*moving, *each_way), share=0.6, weight=WAY_WEIGHT)
    if "t_s" not in context.not_said:
        walk = any_course(context.elapsed_s, COURSE_TERMS)
        course = [c for step in walk.T for c in all_drives(context.velocity_m_per_s * step[:, None])]
        sets.add_set((*moving, *course[:AGE_TERMS]), by_drive, share=0.6, weight=AGE_WEIGHT)
        sets.add_set((*moving, *course), by_drive, share=0.6, weight=COURSE_WEIGHT)
    for reached in _speeds(inputs)[::2]:
        for tau in geometric_series(0.15, 5.0, 6):
            late = np.exp(-context.dwell_s / tau) * reached * REFERENCE_SPEED_M_PER_S
            sets.add_set(all_drives(-context.direction * late[:, None], "filtering"), tau_s=tau, weight=0.2)
    return sets


def servo_settling(inputs: EffectInputs, drive: int) -> BasisSets:
    """The slider settles with a delay that grows with its approach speed, or is friction's, which has none.

    Against friction only the controller's integral action brings it on, from whatever speed (Armstrong-Hélouvry,
    Dupont, Canudas de Wit, Automatica 30 (1994) 1083).
    """
    sets, travel, context = BasisSets(), f"travel.{inputs.drive(drive)}", inputs.context
    if not {"t_s", "history"} & context.not_said.keys():
        # What former motions have left dies away (Boltzmann's elastic after-effect), with any spectrum of times.
        moved_m = np.diff(context.history.drives[:, drive], prepend=context.history.drives[0, drive])
        left = np.stack([context.left_by_motions(moved_m, tau) for tau in AFTER_EFFECT_S], axis=1)
        sets.add_set(sets.add((travel, -left)), weight=AFTER_EFFECT_WEIGHT)
        # Or as a controller's integral action, up to a limit.
        limited = np.sign(moved_m) * np.clip(np.abs(moved_m) / np.array(LIMITS_M)[:, None], 0.0, 1.0)
        wound = [context.left_by_motions(by, tau) for by in limited for tau in WOUND_S]
        sets.add_set(sets.add((travel, np.stack(wound, axis=1))), weight=AFTER_EFFECT_WEIGHT)
    rest = cosine_basis(np.log(context.dwell_s + 0.3), REST_TERMS, constant=True)
    # Some of what it is short of its target a drive reports itself: the slider is short of that by more.
    reported_m = np.where(context.moving, 0.0, context.following_error_m[:, drive])
    if (rms_m := float(np.sqrt(np.mean(reported_m**2)))) > REPORTED_M:
        reported = sets.add((travel, -reported_m / rms_m), form="reported")
        slowly = sets.add((travel, -(reported_m / rms_m)[:, None] * rest[:, 1:]))
        sets.add_set(reported)
        sets.add_set(reported, slowly, share=0.4)
    # Loads push it out of place until integral action has brought it back, from whatever side it came.
    for load_n in _loads_along(inputs, drive):
        sets.add_set(sets.add((travel, load_n[:, None] * rest)), weight=ANY_REST_WEIGHT)
    against_friction = np.where(context.moving, 0.0, 1.0)  # from whatever speed
    for form, speed in (*(("exponential", s) for s in _speeds(inputs)), ("against_friction", against_friction)):
        behind = -context.direction[:, drive] * speed
        any_way = sets.add((travel, behind[:, None] * rest))
        sets.add_set(any_way, weight=ANY_REST_WEIGHT)
        for tau in DWELL_TIMES_S:
            lagging = sets.add((travel, behind * np.exp(-context.dwell_s / tau)), form=form)
            sets.add_set(lagging, any_way, share=0.4, sign=1.0, tau_s=tau)
        for tau in DWELL_TIMES_S[1::2] if form == "exponential" else ():
            t = context.dwell_s / tau
            ringing = np.stack([np.exp(-0.5 * t) * np.cos(w * t) for w in (1.5, 2.5, 4.0)], axis=1)
            oscillating = sets.add((travel, behind[:, None] * ringing), form="ringing")
            sets.add_set(oscillating, any_way, share=0.4, tau_s=tau, weight=0.5)
    return sets


def _loads_along(inputs: EffectInputs, drive: int) -> list[Array]:
    """What loads a drive (n,), over the largest: the payload, and the pull of its struts."""
    pull_n = inputs.pull_along_n(drive)
    return [x / np.abs(x).max() for x in (inputs.payload_ratio, pull_n) if np.any(x)]


def _speeds(inputs: EffectInputs) -> list[Array]:
    """Speeds (n,) of the last leg over the reference, with several caps: a short leg stays below the approach speed."""
    context = inputs.context
    caps = [
        np.where(context.moving, context.speed_m_per_s, np.minimum(context.speed_m_per_s, cap)) for cap in CAPS_M_PER_S
    ]
    return [capped / REFERENCE_SPEED_M_PER_S for capped in caps]


def _untested_with_one_dwell(inputs: EffectInputs) -> str | None:
    at_rest = inputs.context.dwell_s[~inputs.context.moving]
    return None if varies(at_rest, 5.0) and varies(inputs.context.direction, 1.0) else (
        "every pose was measured after the same rest; vary the dwell"
    )  # fmt: skip


def _untested_at_rest(inputs: EffectInputs) -> str | None:
    if bool(np.any(inputs.context.moving)) or float(inputs.context.dwell_s.min()) < 1.0:
        return None
    return "no reading was taken on the fly or soon after a stop"


def _untested_with_one_drive(inputs: EffectInputs) -> str | None:
    return None if len(inputs.machine.drive_names) > 1 else "the machine has one drive"


EFFECTS = (
    Effect(
        name="axis_coupling",
        place="drive",
        size=EffectParameter("ratio", 1e-6, 2e-3, "1", "metres a metre of the other axis"),
        reveals="the other drive's coordinate, reflectors on the sliders",
        confounded=("screw_cumulative_error",),
        forms=coupling,
        others=(
            EffectParameter("period_m", *TURNS_M, "m", "of what repeats with the other", aliased=True),
            ONSET,
        ),
        untested=_untested_with_one_drive,
        textbook=Textbook("in_proportion", "ISO 230-1: squareness and parallelism of axes"),
        varies_with=(
            "own travel",
            "other travel",
            "side",
            "payload",
            "speed",
            "time",
            "course",
            "warmth",
            "temperature",
        ),
        functions_vary_with=("own travel", "other travel", "payload", "rest", "speed", "time", "temperature"),
        order=180,
    ),
    Effect(
        name="latency",
        place="rig",
        size=EffectParameter("latency_s", 1e-5, 5.0, "s", "dead time or time constant"),
        reveals="readings on the fly at several speeds, or short rests",
        confounded=("servo_settling",),
        forms=latency,
        others=(ONSET,),
        untested=_untested_at_rest,
        textbook=Textbook("dead_time", "Åström, Hägglund, PID Controllers: dead time"),
        varies_with=("speed", "time", "course", "temperature"),
        order=190,
    ),
    Effect(
        name="servo_settling",
        place="drive",
        size=EffectParameter("amplitude_m", 1e-6, 4e-3, "m", "short on arrival at 0.5 m/s"),
        reveals="varied dwell and speed, reflectors on the sliders",
        confounded=("backlash", "latency"),
        forms=servo_settling,
        others=(EffectParameter("tau_s", 0.3, 20.0, "s", "time constant"),),
        untested=_untested_with_one_dwell,
        textbook=Textbook("exponential", "Franklin, Powell, Emami-Naeini, Feedback Control: a first-order lag"),
        varies_with=(
            "own travel",
            "other travel",
            "side",
            "approach",
            "payload",
            "speed",
            "time",
            "course",
            "warmth",
        ),
        functions_vary_with=("side", "approach", "speed", "time", "warmth"),
        order=200,
    ),
)
