"""What gives way under force: columns and carriages, single struts, joints with play.

Forces are those of the fitted model. The preload in them follows from misfits that readings hardly show, so that forms
are tried with several shares of it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.api import Curve, Effect, Forms, Parameter, Setting
from calibration.effects.basis_functions import smooth
from calibration.effects.strut_laws import Held, Law, Range, curve, misfit_m, one_way, play, slipping, softer

LEVER_M = 0.25
SOFT_N = (300.0, 1500.0)  # over which play is taken up
LEAST_KG = 20.0
MISFIT_UNIT = 0.07  # of its standard deviation: so much a strut's misfit counts
NARROW = 0.02  # of the typical tension: over which a strut goes from tension to compression


def compliance(s: Setting, drive: int) -> Forms:
    """The column or the carriage on it gives way: across the guide, in rotation, along the screw."""
    f, u = Forms(), s.along(drive)
    higher = np.stack([u, u**2], axis=1)
    axis = s.machine.nominal.axis[drive]
    pull = s.pull_n[:, drive]
    directions = [(c, pull @ np.eye(3)["xyz".index(c[-1])]) for c in s.of_drive("sideways", drive)]
    directions += [(c, s.moment_nm[:, drive] / LEVER_M**2) for c in s.of_drive("turn", drive)]
    directions += [(f"travel.{s.drive(drive)}", pull @ axis)]
    for channel, force in directions:
        size = max(float(np.std(force)), 1.0)
        mean = force.mean()
        main = f.add((channel, force))
        loaded = f.add((channel, mean * (s.load - 0.5)))
        placed = f.add((channel, force[:, None] * higher))
        hard = f.add((channel, np.stack([(force - mean) ** 2 / size, (force - mean) ** 3 / size**2], axis=1)))
        f.form(main)
        f.form(main, placed, share=0.6)
        f.form(main, (*placed, *hard, *loaded), share=0.2)
    return f


def link_stiffness(s: Setting, strut: int) -> Forms:
    """One strut is softer than the model has it, in some poses or under load more than in others."""
    f, name = Forms(), f"length.{s.machine.strut_names[strut]}"
    drive = int(s.machine.strut_drive[strut])
    t = s.tension_n[:, strut] / s.machine.nominal.stiffness_n_per_m[strut]
    size = max(float(np.std(t)), 1e-9)
    u = s.along(drive) if drive >= 0 else np.zeros(len(t))
    main = f.add((name, t))
    loaded = f.add((name, np.stack([t * s.load, s.load * size], axis=1)))
    swung = f.add((name, np.stack([t * u**k for k in (1, 2, 3, 4)], axis=1)))
    leant = f.add((name, np.stack([size * u**k for k in (1, 2, 3, 4)], axis=1)))
    pressed = f.add((name, np.stack([np.maximum(t, 0.0), np.minimum(t, 0.0)], axis=1)))
    away = t - t.mean()
    bent = f.add((name, np.stack([away**2 / size, away**3 / size**2], axis=1)))
    f.form(main)
    f.form(loaded[:1], (*main, *loaded[1:]), share=0.6)
    f.form(swung[:2], (*main, *leant[:2]), share=0.6)
    # Where it bends far, the joint gives way more than in proportion, and the strut's own share of the preload with it.
    others = [s.along(other) for other in s.partners(drive)] if drive >= 0 else []
    beside = [c for v in others for c in f.add((name, np.stack([t * v, size * v, size * u * v, size * v**2], axis=1)))]
    f.form((*main, *swung), (*leant, *loaded, *beside), share=0.7)
    f.form(pressed)
    f.form((*main, *bent), loaded, share=0.7)
    f.form(main, (*loaded, *swung, *bent), share=0.5)
    return f


def clearance(s: Setting, strut: int) -> Forms:
    """A joint of a strut has play: taken up to one side or the other by the strut's force, or by the pin's weight."""
    f, name = Forms(), f"length.{s.machine.strut_names[strut]}"
    drive = int(s.machine.strut_drive[strut])
    t = s.tension_n[:, strut]
    size = max(float(np.std(t)), 1.0)
    for shift in (-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0):
        for soft in SOFT_N:
            side = np.tanh((t - t.mean() + shift * size) / soft)
            main = f.add((name, side))
            loaded = f.add((name, np.stack([side * s.load, s.load], axis=1)))
            f.form(main, loaded, share=0.7)
    if drive >= 0:
        # A pin that lies in its hole follows the strut's angle, which goes with the drive and the pose.
        seated = f.add((name, smooth(s.moments.drives[:, drive], 4, roughness=1.0)))
        f.form(seated, weight=4.0)
    f.form(f.add((name, s.load)), weight=2.0)
    return f


def link_stiffness_curves(s: Setting, strut: int) -> tuple[Curve, ...]:
    """A strut that is softer by its angle, gives way above a tension, or is softer in tension or compression alone."""
    held = Held.of(s, strut)
    compliance, typical = 1.0 / held.stiffness_n_per_m, held.typical_n
    drive = int(s.machine.strut_drive[strut])
    u = s.along(drive) if drive >= 0 else np.zeros(len(s.moments))
    ratio, bend = Range(np.log(0.02), np.log(50.0)), Range(-6.0, 6.0, 2.0)
    threshold, power = Range(np.log(0.02), np.log(4.0)), Range(np.log(0.5), np.log(8.0))

    def by_angle(at: Array) -> Law:
        return softer(compliance * np.exp(at[0] + at[1] * u + at[2] * u**2))

    def above(at: Array) -> Law:
        return slipping(compliance, typical * float(np.exp(at[0])), float(np.exp(at[1])))

    def towards(side: float) -> Callable[[Array], Law]:
        return lambda at: one_way(compliance * float(np.exp(at[0])), side, NARROW * typical)

    def stated(at: Array, _: Array) -> float:
        return float(np.exp(at[0]))

    def mean(_: Array, growth: Array) -> float:
        return max(float(np.sqrt(np.mean(growth**2))) / (typical * compliance), 1e-6)

    def unit(_: Array) -> float:
        return MISFIT_UNIT * misfit_m(s)

    ratios = [np.log(r) for r in (0.3, 1.0, 5.0)]
    thresholds = [(np.log(f), np.log(p)) for f in (0.15, 0.5, 1.2) for p in (1.5, 6.0)]
    angles = [(r, by, 0.0) for r in ratios for by in (-1.5, 0.0, 1.5)]
    far, near = (-3.0, -1.0, 0.0, 1.0, 3.0), (-2.0, -1.0, 0.0, 1.0, 2.0)
    return (
        curve(held, by_angle, (ratio, bend, bend), angles, (), stated, unit, misfit_m(s)),
        curve(held, above, (threshold, power), thresholds, far, mean, unit, misfit_m(s)),
        *(
            curve(held, towards(side), (ratio,), [(r,) for r in ratios[::2]], near, stated, unit, misfit_m(s))
            for side in (-1.0, 1.0)
        ),
    )


def clearance_curves(s: Setting, strut: int) -> tuple[Curve, ...]:
    """Play that the tension takes up, more of it or less under load."""
    held = Held.of(s, strut)
    play_m, by_load = Range(np.log(1e-6), np.log(4e-4)), Range(-3.0, 3.0, 0.7)
    width = Range(np.log(0.005), np.log(2.0))  # over the typical tension

    def law(at: Array) -> Law:
        return play(np.exp(at[0] + at[2] * s.load), held.typical_n * float(np.exp(at[1])))

    def stated(at: Array, _: Array | None = None) -> float:
        return float(np.exp(at[0]))

    starts = [(np.log(c), np.log(w), 0.0) for c in (1e-5, 4e-5, 1.6e-4) for w in (0.015, 0.15)]
    middles = (-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0)
    return (curve(held, law, (play_m, width, by_load), starts, middles, stated, stated, misfit_m(s)),)


def _one_load(s: Setting) -> str | None:
    if float(np.ptp(s.moments.payload_kg)) >= LEAST_KG:
        return None
    return "every pose was measured with the same payload; measure two"


EFFECTS = (
    Effect(
        "column_compliance", "drive",
        Parameter("compliance_m_per_n", 5e-10, 2e-6, "m/N", "of the carriage, at 0.25 m lever if in rotation"),
        "payload, reflectors on the sliders, height", ("friction_windup", "link_stiffness"), compliance, (), _one_load,
    ),
    Effect(
        "link_stiffness", "strut", Parameter("compliance_ratio", 0.05, 20.0, "1", "additional over nominal compliance"),
        "payload", ("joint_clearance", "column_compliance"), link_stiffness, (), _one_load,
        curves=link_stiffness_curves,
    ),
    Effect(
        "joint_clearance", "strut", Parameter("clearance_m", 1e-6, 4e-4, "m", "play each way"),
        "poses where the strut's force changes its sign, payload", ("link_stiffness", "link_thermal_growth"), clearance,
        curves=clearance_curves,
    ),
)  # fmt: skip
