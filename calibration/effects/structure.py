"""Elastic effects: compliance of columns and carriages, softness of single struts, joint clearance.

Forces are those of the fitted model. Their preload results from misfits that the readings barely determine, so basis
sets with several shares of it are tried.
"""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.api import (
    BasisSets,
    Coordinate,
    Curve,
    Effect,
    EffectInputs,
    EffectParameter,
    Textbook,
)
from calibration.effects.basis_functions import cosine_basis, tensor_product
from calibration.effects.compliant_columns import LOAD_TERMS, compliance
from calibration.effects.onsets import ONSET
from calibration.effects.softening import add_softening
from calibration.effects.strut_laws import (
    ElongationLaw,
    LawParameter,
    RestrainedStrut,
    curve_of_law,
    misfit_m,
    saturating_law,
    series_spring,
    smooth_spring,
)

SOFT_N = (300.0, 1500.0)  # tension over which play closes
LEAST_KG = 20.0
LEAST_FORCE_CHANGE = 0.2  # of a strut, over its RMS, that shows what is soft without another payload
PLACE_TERMS, TENSION_TERMS = 4, 5  # of any function of a strut's place and of its tension
AGE_TERMS, AGE_WEIGHT = 4, 0.3  # of a softness that is another one at any time
LATE_TIMES_S, LATE_WEIGHT = (100.0, 300.0, 900.0), 0.2  # in which a bushing follows its force
RESTS_S, REST_WEIGHT = (3.0, 12.0, 48.0), 0.3  # in which a pin sinks through its oil
ANYWHERE = "anywhere"  # form of a pin that lies elsewhere in its play at each visit
MISFIT_UNIT = 0.07  # unit of a strut's misfit on a curve, over its standard deviation


def link_stiffness(inputs: EffectInputs, strut: int) -> BasisSets:
    """One strut is softer than in the model, more so in some poses or under load."""
    sets, name = BasisSets(), f"length.{inputs.machine.strut_names[strut]}"
    drive = int(inputs.machine.strut_drive[strut])
    t = inputs.tension_n[:, strut] / inputs.machine.nominal.stiffness_n_per_m[strut]
    size = max(float(np.std(t)), 1e-9)
    u = inputs.normalised_travel(drive) if drive >= 0 else np.zeros(len(t))
    main = sets.add((name, t), form="tension")
    angle_alone = sets.add((name, np.stack([size * u**k for k in (1, 2, 3, 4)], axis=1)))
    by_place = inputs.context.drives[:, drive] if drive >= 0 else np.zeros(len(t))
    anywhere = sets.add((name, t[:, None] * cosine_basis(by_place, PLACE_TERMS)))
    stretched = sets.add((name, size * cosine_basis(t, TENSION_TERMS)))
    anyhow_loaded = sets.add((name, t[:, None] * cosine_basis(inputs.payload_ratio, LOAD_TERMS)))
    sets.add_set(main, sign=1.0)
    # At a large angle the joint yields more than in proportion, and so does the strut's own share of the preload.
    others = [inputs.normalised_travel(other) for other in inputs.other_drives(drive)] if drive >= 0 else []
    coupled = [
        c for v in others for c in sets.add((name, np.stack([t * v, size * v, size * u * v, size * v**2], axis=1)))
    ]
    sets.add_set((*main, *anywhere), (*angle_alone, *anyhow_loaded, *coupled), share=0.7, sign=1.0)
    sets.add_set(main, (*stretched, *anyhow_loaded), share=0.7, sign=1.0)
    if "t_s" not in inputs.context.not_said:  # bolts work loose, joints bed in
        ages = cosine_basis(inputs.context.elapsed_s, AGE_TERMS)
        ageing = sets.add((name, np.column_stack([t[:, None] * ages, size * ages])))
        sets.add_set((*main, *ageing), anyhow_loaded, share=0.6, weight=AGE_WEIGHT)
        add_softening(sets, inputs, strut, t)
        late = [inputs.context.lagging(t, tau_s) for tau_s in LATE_TIMES_S]
        sets.add_set(sets.add((name, np.column_stack([t, *late]))), weight=LATE_WEIGHT)  # a bushing that flows
    return sets


def clearance(inputs: EffectInputs, strut: int) -> BasisSets:
    """A joint of a strut has play, which the strut's force or the weight of the pin closes to one side or the other."""
    sets, name = BasisSets(), f"length.{inputs.machine.strut_names[strut]}"
    drive = int(inputs.machine.strut_drive[strut])
    t = inputs.tension_n[:, strut]
    size = max(float(np.std(t)), 1.0)
    for shift in (-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0):
        for soft in SOFT_N:
            side = np.tanh((t - t.mean() + shift * size) / soft)
            main = sets.add((name, side), form="sides_by_tension")
            loaded = sets.add((name, np.stack([side * inputs.payload_ratio, inputs.payload_ratio], axis=1)))
            sets.add_set(main, loaded, share=0.7, sign=1.0)
    if drive >= 0:
        # A pin at the bottom of its hole follows the strut's angle, which depends on drive and pose.
        angles = cosine_basis(inputs.context.drives[:, drive], 4, roughness=1.0)
        seated = sets.add((name, angles))
        sets.add_set(seated, weight=4.0)
        if "dwell_s" not in inputs.context.not_said:  # through its oil it sinks there at rest only
            seating = np.exp(-inputs.context.dwell_s[:, None] / np.array(RESTS_S))
            sinking = sets.add((name, tensor_product(angles, seating)))
            sets.add_set((*seated, *sinking), sets.add((name, seating)), share=0.7, weight=REST_WEIGHT)
        if "direction" not in inputs.context.not_said:  # and friction holds it on the side to which the motion took it
            towards = inputs.context.direction[:, drive : drive + 1]
            pressed = cosine_basis(t, TENSION_TERMS, roughness=1.0)
            held = sets.add((name, towards * np.column_stack([np.ones_like(t), pressed, angles])))
            sets.add_set(held, (*sets.add((name, pressed)), *seated), share=0.7, weight=REST_WEIGHT)
    # Without a force to press it, it lies where the last motion left it: where on the average is calibrated.
    sets.add_set(sets.add((name, np.ones_like(t)), form=ANYWHERE))
    return sets


def link_stiffness_curves(inputs: EffectInputs, strut: int) -> tuple[Curve, ...]:
    """Softness that depends on the strut's angle and load, or on its tension."""
    restrained = RestrainedStrut.from_inputs(inputs, strut)
    compliance, typical = 1.0 / restrained.stiffness_n_per_m, restrained.typical_n
    drive = int(inputs.machine.strut_drive[strut])
    u = (inputs.normalised_travel(drive) if drive >= 0 else np.zeros(len(inputs.context)))[restrained.rows]
    load = inputs.payload_ratio[restrained.rows]
    ratio, bend = LawParameter(np.log(0.02), np.log(50.0)), LawParameter(-6.0, 6.0, 2.0)

    def anywhere(at: Array) -> ElongationLaw:
        bent = at[1] * u + at[2] * u**2 + at[3] * load
        return series_spring(compliance * np.exp(at[0] + bent))

    def stretched(at: Array) -> ElongationLaw:
        return smooth_spring(compliance * np.exp(at[0]), typical, at[1], at[2])

    def size_at(at: Array) -> Array:
        return np.asarray(np.exp(at[0]))

    def misfit_unit_m(_: Array) -> float:
        return MISFIT_UNIT * misfit_m(inputs)

    ratios = [np.log(r) for r in (0.3, 1.0, 5.0)]
    angles = [(r, by, 0.0) for r in ratios for by in (-1.5, 0.0, 1.5)]
    far = (-3.0, -1.0, 1.0, 3.0)
    own_misfit_m = misfit_m(inputs)
    return (
        curve_of_law(
            restrained, anywhere, (ratio, bend, bend, bend), starts=[(*a, 0.0) for a in angles], middles=(),
            size=size_at, misfit_unit_m=misfit_unit_m, misfit_m=own_misfit_m, form="",
        ),
        curve_of_law(
            restrained, stretched, (ratio, bend, bend), starts=[(r, b, 0.0) for r in ratios[1:] for b in (-1.0, 1.0)],
            middles=far, size=size_at, misfit_unit_m=misfit_unit_m, misfit_m=own_misfit_m, form="",
        ),
    )  # fmt: skip


def clearance_curves(inputs: EffectInputs, strut: int) -> tuple[Curve, ...]:
    """Play that the tension closes, sharply or smoothly, and that may vary with payload and angle."""
    restrained = RestrainedStrut.from_inputs(inputs, strut)
    drive, load = int(inputs.machine.strut_drive[strut]), inputs.payload_ratio[restrained.rows]
    u = inputs.normalised_travel(drive)[restrained.rows] if drive >= 0 else np.zeros(len(load))
    play_m, by_load = LawParameter(np.log(1e-6), np.log(4e-4)), LawParameter(-3.0, 3.0, 0.7)
    width = LawParameter(np.log(0.005), np.log(2.0))  # over the typical tension
    by_place, power = LawParameter(-2.0, 2.0, 0.5), LawParameter(0.0, np.log(8.0))

    def anyhow(at: Array) -> ElongationLaw:
        play = np.exp(at[0] + at[2] * load + at[3] * u)
        return saturating_law(play, restrained.typical_n * np.exp(at[1]), np.exp(at[4]))

    def size_at(at: Array) -> Array:
        return np.asarray(np.exp(at[0]))

    starts = [(np.log(3e-5), np.log(w), by) for w in (0.03, 0.3) for by in (-0.8, 0.8)]
    middles = (-2.0, -1.0, 0.0, 1.0, 2.0)
    return (
        curve_of_law(
            restrained, anyhow, (play_m, width, by_load, by_place, power),
            starts=[(*start, 0.0, np.log(3.0)) for start in starts], middles=middles, size=size_at,
            misfit_unit_m=size_at, misfit_m=misfit_m(inputs), form="",
        ),
    )  # fmt: skip


def _untested_with_one_payload(inputs: EffectInputs) -> str | None:
    if float(np.ptp(inputs.context.payload_kg)) >= LEAST_KG:
        return None
    tension_n = inputs.tension_n
    if np.any(np.std(tension_n, axis=0) > LEAST_FORCE_CHANGE * np.sqrt(np.mean(tension_n**2, axis=0))):
        return None  # from pose to pose
    return "every pose was measured with the same payload, and forces hardly vary; measure two"


SOFTNESS_VARIES_WITH: tuple[Coordinate, ...] = (
    "own travel", "other travel", "side", "payload", "rest", "speed", "time", "temperature",
)  # fmt: skip
PLAY_VARIES_WITH: tuple[Coordinate, ...] = (
    "own travel", "other travel", "payload", "rest", "speed", "time", "course", "way", "temperature",
)  # fmt: skip

EFFECTS = (
    Effect(
        name="column_compliance",
        place="drive",
        size=EffectParameter(
            "compliance_m_per_n", 5e-10, 2e-6, "m/N", "of the carriage, at 0.25 m lever if in rotation"
        ),
        reveals="payload, reflectors on the sliders, height",
        confounded=("friction_windup", "link_stiffness"),
        forms=compliance,
        others=(ONSET,),
        untested=_untested_with_one_payload,
        textbook=Textbook("force", "Timoshenko, Strength of Materials: Hooke's law"),
        varies_with=SOFTNESS_VARIES_WITH,
        order=60,
    ),
    Effect(
        name="link_stiffness",
        place="strut",
        size=EffectParameter("compliance_ratio", 0.05, 20.0, "1", "additional over nominal compliance"),
        reveals="payload",
        confounded=("joint_clearance", "column_compliance"),
        forms=link_stiffness,
        others=(ONSET,),
        untested=_untested_with_one_payload,
        curves=link_stiffness_curves,
        textbook=Textbook("tension", "Timoshenko, Strength of Materials: Hooke's law, springs in series"),
        varies_with=SOFTNESS_VARIES_WITH,
        order=70,
    ),
    Effect(
        name="joint_clearance",
        place="strut",
        size=EffectParameter("clearance_m", 1e-6, 4e-4, "m", "play each way"),
        reveals="poses where the strut's force changes its sign, payload",
        confounded=("link_stiffness", "link_thermal_growth"),
        forms=clearance,
        curves=clearance_curves,
        textbook=Textbook(
            "sides_by_tension", "Flores et al., Kinematics and Dynamics of Multibody Systems with Imperfect Joints"
        ),
        differs_by_visit=True,
        anew_by_visit=ANYWHERE,
        varies_with=PLAY_VARIES_WITH,
        order=80,
    ),
)
