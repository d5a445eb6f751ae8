"""Forms of effects of the drive train and its control: play, wind-up, coupling, settling, zero and scale."""

from __future__ import annotations

import numpy as np

from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.shapes import (
    bump,
    draw_instant,
    draw_sign,
    draw_two_instants,
    load_share,
    logistic,
    since,
)
from benchmarks.other_simulator.plan import RANDOMISED
from benchmarks.other_simulator.scene import Scene

Generator = np.random.Generator

SETTLING_M, CREEP_M = 2e-3, 1e-3


@form()
def constant(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The same play everywhere."""
    return Contribution(drive_m=-0.5 * scene.rows.side[:, drive])


@form()
def worn_mid_travel(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """More play in one zone."""
    worn = bump(scene.rows.centred[:, drive], rng.uniform(-0.4, 0.4), 0.4)
    return Contribution(drive_m=-0.5 * scene.rows.side[:, drive] * (0.3 + 0.7 * worn))


@form()
def grows_with_wear(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Play that grows in the campaign."""
    return Contribution(drive_m=-0.5 * scene.rows.side[:, drive] * (0.2 + 0.8 * scene.rows.elapsed))


@form()
def taken_up_by_load(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Less play the more the drive holds."""
    load = np.abs(scene.loads_n[:, drive])
    return Contribution(drive_m=-0.5 * scene.rows.side[:, drive] * (1.1 - load / load.max()))


@form()
def closes_with_warmth(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Less play when it is warm."""
    warmth = scene.rows.warmth_of_motion(drive, rng.uniform(15, 40))
    return Contribution(drive_m=-0.5 * scene.rows.side[:, drive] * (1 - 0.8 * warmth))


@form()
def coulomb_and_weight(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Wound up by constant friction and the load."""
    return Contribution(drive_m=-0.6 * scene.rows.side[:, drive] + 0.8 * load_share(scene, drive))


@form()
def stribeck(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Friction that falls with the speed of approach."""
    friction = 0.35 + 0.65 * np.exp(-scene.rows.speed_m_per_s / rng.uniform(0.03, 0.1))
    return Contribution(drive_m=-scene.rows.side[:, drive] * friction)


@form()
def friction_of_the_load(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Friction in proportion to the load."""
    load = load_share(scene, drive)
    return Contribution(drive_m=-scene.rows.side[:, drive] * np.abs(load) + 0.5 * load)


@form()
def long_screw_twists(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A screw that twists over the length to the nut."""
    raised = scene.rows.raised[:, drive]
    torque = -0.7 * scene.rows.side[:, drive] + 0.5 * load_share(scene, drive)
    return Contribution(drive_m=torque * (0.15 + (raised if rng.random() < 0.5 else 1 - raised)))


@form()
def presliding_and_viscous(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Friction that builds up over the approach and grows with its speed."""
    built_up = 1 - np.exp(-scene.rows.approach_m[:, drive] / rng.uniform(0.01, 0.05))
    viscous = 0.5 + 2 * np.minimum(scene.rows.speed_m_per_s, 0.3)
    return Contribution(drive_m=-scene.rows.side[:, drive] * built_up * viscous)


def next_drive(scene: Scene, drive: int) -> int:
    """The other drive, of more than two the next one."""
    return (drive + 1) % len(scene.machine.drives)


@form()
def square_of_other(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """By the square of the other drive's coordinate."""
    return Contribution(drive_m=scene.rows.centred[:, next_drive(scene, drive)] ** 2)


@form()
def product(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """By the product of both coordinates."""
    return Contribution(drive_m=scene.rows.centred[:, drive] * scene.rows.centred[:, next_drive(scene, drive)])


@form()
def side_of_other(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """By the side that the other comes from; where sides differ from drive to drive, by its coordinate too."""
    rows, other = scene.rows, next_drive(scene, drive)
    coordinate = 0.3 * rows.centred[:, other] if rows.style == RANDOMISED else 0.0
    return Contribution(drive_m=0.7 * rows.side[:, other] + coordinate)


@form()
def proportional_and_bent(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """By the other drive's coordinate, more at its ends."""
    place = scene.rows.centred[:, next_drive(scene, drive)]
    return Contribution(drive_m=place + 0.5 * place**3)


@form()
def difference_of_both(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """By how far both stand apart."""
    apart = scene.rows.centred[:, drive] - scene.rows.centred[:, next_drive(scene, drive)]
    return Contribution(drive_m=np.sin(1.6 * apart))


@form(SETTLING_M)
def exponential_of_speed(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """What is left fades, and is more after a fast approach."""
    rows = scene.rows
    fading = np.exp(-rows.dwell_s / rng.uniform(1, 3))
    return Contribution(
        drive_m=-rows.side[:, drive] * fading * np.minimum(rows.speed_m_per_s, 0.3) / 0.15 * ~rows.moving
    )


@form(SETTLING_M)
def ringing(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It rings."""
    rows, rate = scene.rows, rng.uniform(0.3, 1.5)
    fading = np.exp(-rows.dwell_s / rng.uniform(1.5, 4))
    swing = fading * np.cos(2 * np.pi * rate * rows.dwell_s) * np.sqrt(rows.speed_m_per_s / 0.1)
    return Contribution(drive_m=-rows.side[:, drive] * swing * ~rows.moving)


@form(CREEP_M)
def slow_creep_to_place(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It creeps by the logarithm of time, for half a minute."""
    rows = scene.rows
    left = (1 - np.log1p(rows.dwell_s / 0.5) / np.log1p(60)).clip(0)
    return Contribution(drive_m=-rows.side[:, drive] * left * ~rows.moving)


@form(CREEP_M)
def integrator_breaks_away(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It sticks until the integral action breaks it away."""
    rows = scene.rows
    until_s = rng.uniform(3, 7) * np.exp(0.2 * rng.normal(size=rows.visit.max() + 1))[rows.visit]
    stuck = (rows.dwell_s < until_s) * ~rows.moving
    return Contribution(drive_m=-rows.side[:, drive] * stuck * (0.6 + 0.4 * np.abs(load_share(scene, drive))))


@form(SETTLING_M)
def two_time_constants(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """What is left fades fast, then slowly."""
    rows = scene.rows
    fast = 0.6 * np.exp(-rows.dwell_s / rng.uniform(0.6, 1.5))
    slow = 0.4 * np.exp(-rows.dwell_s / rng.uniform(5, 12))
    return Contribution(drive_m=-rows.side[:, drive] * (fast + slow) * ~rows.moving)


@form()
def zero_jumps_after_homing(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Another zero from a moment on."""
    step_s = draw_instant(scene.rows, rng)
    return Contribution(drive_m=since(scene.rows, step_s), step_s=step_s)


@form()
def scale_changed(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Another scale from a moment on."""
    step_s = draw_instant(scene.rows, rng)
    shift = scene.rows.raised[:, drive] + rng.uniform(-0.5, 0.5)
    return Contribution(drive_m=since(scene.rows, step_s) * shift, step_s=step_s)


@form()
def zero_and_scale(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Both from a moment on."""
    step_s = draw_instant(scene.rows, rng)
    shift = 0.6 + 0.8 * scene.rows.centred[:, drive] * draw_sign(rng)
    return Contribution(drive_m=since(scene.rows, step_s) * shift, step_s=step_s)


@form()
def scale_clamp_slips_slowly(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The zero slips over some minutes."""
    return Contribution(drive_m=logistic((scene.rows.elapsed - rng.uniform(0.3, 0.7)) / 0.06))


@form()
def lost_counts_twice(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The zero jumps twice."""
    first_s, second_s = draw_two_instants(scene.rows, rng, (0.2, 0.45), (0.55, 0.8))
    return Contribution(
        drive_m=0.6 * since(scene.rows, first_s) + 0.5 * since(scene.rows, second_s), step_s=first_s
    )  # fmt: skip


FORMS: dict[str, tuple[Form, ...]] = {
    "backlash": (constant, worn_mid_travel, grows_with_wear, taken_up_by_load, closes_with_warmth),
    "friction_windup": (
        coulomb_and_weight, stribeck, friction_of_the_load, long_screw_twists, presliding_and_viscous,
    ),
    "axis_coupling": (square_of_other, product, side_of_other, proportional_and_bent, difference_of_both),
    "servo_settling": (
        exponential_of_speed, ringing, slow_creep_to_place, integrator_breaks_away, two_time_constants,
    ),
    "drive_scale": (
        zero_jumps_after_homing, scale_changed, zero_and_scale, scale_clamp_slips_slowly, lost_counts_twice,
    ),
}  # fmt: skip
