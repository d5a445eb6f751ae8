"""Forms of effects of screws, scales and the control of drives, of the ninth archive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.drives import CREEP_M, SETTLING_M, next_drive
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.memory import since_change_s, switched_over
from benchmarks.other_simulator.forms.screws import GROWTH_M, PERIODIC_M, draw_lead, draw_pitch, of_pitch
from benchmarks.other_simulator.forms.shapes import (
    bump,
    draw_phase,
    draw_sign,
    load_share,
    logistic,
    normalised,
    wave,
)
from benchmarks.other_simulator.forms.traces import draw_after_break, draw_breaks
from benchmarks.other_simulator.scene import Scene

Array = NDArray[np.float64]
Generator = np.random.Generator

BALLS_OF_TURN = (5.0, 12.0)  # that enter a nut in a turn of its screw


@form(GROWTH_M)
def central_oil_brings_heat_of_all(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """One pump sends the same oil through all nuts and back: a screw grows by the work of the other drives as well as
    by its own, evenly from its fixed bearing on."""
    rows, tau_min = scene.rows, rng.uniform(20, 60)
    drives = len(scene.machine.drives)
    shares = np.where(np.arange(drives) == drive, rng.uniform(0.3, 0.6), 1.0)
    warmth = np.stack([rows.warmth_of_motion(one, tau_min) for one in range(drives)], 1) @ shares
    return Contribution(drive_m=normalised(warmth) * (rows.raised[:, drive] + rng.uniform(0.1, 0.5)))


@form(GROWTH_M)
def flooded_cold_after_each_break(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """After each break the pump first brings the oil that has cooled in its tank: the screw shrinks within minutes
    and takes its former length again as the oil gets warm."""
    rows = scene.rows
    breaks, first_s = draw_breaks(rows, rng)
    passed_min = since_change_s(rows, breaks) / 60
    cools_min, warms_min = rng.uniform(1.5, 4), rng.uniform(10, 30)
    cold = (np.exp(-passed_min / warms_min) - np.exp(-passed_min / cools_min)) * (breaks > 0)
    shrunk = -normalised(cold) * (rows.raised[:, drive] + rng.uniform(0.1, 0.5))
    return Contribution(drive_m=shrunk, step_s=first_s)


@form()
def worn_where_it_stops_in_production(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """For years it stopped at the same few places for each workpiece: much play within a few centimetres of each,
    hardly any between them."""
    place, worn = scene.rows.centred[:, drive], np.zeros(len(scene.rows))
    for stop in np.linspace(-0.8, 0.8, int(rng.integers(3, 6))):
        worn = np.maximum(worn, rng.uniform(0.6, 1) * bump(place, stop + rng.uniform(-0.12, 0.12), 0.13))
    return Contribution(drive_m=-0.5 * scene.rows.side[:, drive] * (0.1 + 0.9 * worn))


@form()
def nut_set_tighter_in_a_break(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It has play; in a break a fitter sets the nut tighter, and from then on little of it is left."""
    after, _, step_s = draw_after_break(scene.rows, rng)
    width = np.where(after, rng.uniform(0, 0.2), 1.0)
    return Contribution(drive_m=-0.5 * scene.rows.side[:, drive] * width, step_s=step_s)


@form()
def new_wipers_run_in(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """In a break new wipers are mounted, which drag hard at first and run in with the way; the load winds up what is
    between motor and slider as well."""
    rows = scene.rows
    after, first_s, step_s = draw_after_break(rows, rng)
    way_m = rows.way_m[:, drive]
    run_m = np.maximum(way_m - float(np.interp(first_s, rows.t_s, way_m)), 0)
    left = np.exp(-run_m / (rng.uniform(0.15, 0.5) * max(float(run_m.max()), 1e-3)))
    drag = 0.2 + 0.8 * left * after
    wound_up = -rows.side[:, drive] * drag + rng.uniform(0.2, 0.5) * load_share(scene, drive)
    return Contribution(drive_m=wound_up, step_s=step_s)


@form()
def strain_wave_gear_drags_by_its_angle(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A strain wave gear of which one ring is oval: it drags at some angles and hardly at others, and its soft ring
    winds up by that and by the load."""
    around_m = rng.uniform(0.08, 0.3)
    drag = 0.55 + 0.45 * wave(scene.rows.drives_m[:, drive], around_m, draw_phase(rng))
    load = rng.uniform(0.3, 0.6) * load_share(scene, drive)
    return Contribution(drive_m=-scene.rows.side[:, drive] * drag + load)


@form()
def list_of_errors_entered_one_line_off(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The screw's errors were measured and typed into the control, all of them one line too far up or down: at each
    place it corrects what is wrong at the next one."""
    place, count = scene.rows.centred[:, drive], int(rng.integers(9, 16))
    nodes = np.linspace(-1.1, 1.1, count)
    errors = np.cumsum(rng.normal(size=count))
    errors -= np.polyval(np.polyfit(nodes, errors, 1), nodes)
    line = draw_sign(rng) * (nodes[1] - nodes[0])
    return Contribution(drive_m=normalised(np.interp(place, nodes, errors) - np.interp(place + line, nodes, errors)))


@form()
def transducer_bends_off_at_its_ends(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A magnetostrictive transducer measures its travel: straight in the middle, and off towards both ends of its rod,
    where the echo of each end reaches the pulse."""
    place = scene.rows.centred[:, drive]
    upper = np.exp((place - 1) / rng.uniform(0.1, 0.3))
    lower = np.exp((-place - 1) / rng.uniform(0.1, 0.3))
    return Contribution(drive_m=draw_sign(rng) * upper + rng.uniform(-1, 1) * lower)


@form(PERIODIC_M)
def balls_enter_nut_with_a_jerk(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Each ball that comes from the return tube of the nut pushes it on a little, which it then gives back: a saw of
    several teeth in each turn of the screw, of no whole number."""
    lead_m = draw_lead(scene, drive, rng)
    period_m = lead_m / rng.uniform(*BALLS_OF_TURN)
    turn = (scene.rows.drives_m[:, drive] / period_m + rng.uniform(0, 1)) % 1
    rise = rng.uniform(0.1, 0.3)
    saw = np.where(turn < rise, turn / rise, (1 - turn) / (1 - rise))
    return Contribution(drive_m=2 * saw - 1, period_m=period_m)


@form(PERIODIC_M)
def universal_joint_twice_a_turn(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A universal joint at an angle drives the screw: this runs ahead and stays behind twice in each of its turns,
    and never once."""
    lead_m, angle_rad = draw_lead(scene, drive, rng), rng.uniform(0.1, 0.35)
    turn = 2 * np.pi * scene.rows.drives_m[:, drive] / lead_m + draw_phase(rng)
    ahead = np.arctan2(np.sin(turn), np.cos(turn) * np.cos(angle_rad)) - np.arctan2(np.sin(turn), np.cos(turn))
    return Contribution(drive_m=normalised(ahead), period_m=lead_m / 2)


@form()
def magnetic_head_remembers_direction(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The head of a magnetic scale has hysteresis of its own: its error within each pole is a sine that comes later by
    a part of the pole, on the way up to one side and on the way down to the other."""
    pitch_m, late = draw_pitch(scene, drive, rng), rng.uniform(0.3, 1.0)
    phase = 2 * np.pi * scene.rows.drives_m[:, drive] / pitch_m + draw_phase(rng)
    return of_pitch(np.sin(phase - late * scene.rows.side[:, drive]), pitch_m)


@form()
def current_of_motor_in_its_signals(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The shield of its encoder's cable carries a part of the motor's current, which lifts both signals: once a
    period, the more the drive holds, and turned round with the current's sign."""
    pitch_m = draw_pitch(scene, drive, rng)
    current = load_share(scene, drive) - rng.uniform(-0.2, 0.2)
    return of_pitch(wave(scene.rows.drives_m[:, drive], pitch_m, draw_phase(rng)) * normalised(current), pitch_m)


@form()
def shared_balance_pressure_switches(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The valve that sets the pressure of both balancing cylinders is switched by a cam of the other drive: well above
    a place this one is held up by more, well below it again by less."""
    place = scene.rows.centred[:, next_drive(scene, drive)]
    middle, half = rng.uniform(-0.35, 0.35), rng.uniform(0.05, 0.3)
    return Contribution(drive_m=0.5 * switched_over(place, middle - half, middle + half))


@form()
def balancers_share_one_gas_bottle(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Both balancing cylinders hang on one bottle of gas that is too small: as the other drive lets its piston in the
    pressure rises for this one too, and lifts it more the less gas is left."""
    rows, other = scene.rows, next_drive(scene, drive)
    own = rng.uniform(0, 0.3) * rows.raised[:, drive]
    pressure = 1 / (rng.uniform(0.25, 0.8) + rows.raised[:, other] + own)
    return Contribution(drive_m=normalised(pressure - pressure.mean()))


@form(CREEP_M)
def comes_in_at_creep_speed(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The control goes over to creep speed too early: what is left after a long way shrinks steadily, not by ever
    less, and then it is there; after a short way it is there at once."""
    rows = scene.rows
    approach = rows.approach_m[:, drive] / max(float(np.quantile(rows.approach_m[:, drive], 0.9)), 1e-6)
    left = np.maximum(np.minimum(approach, 1.5) - rows.dwell_s / rng.uniform(4, 10), 0)
    return Contribution(drive_m=-rows.side[:, drive] * left * ~rows.moving)


@form(SETTLING_M)
def brake_pulls_it_off_as_it_closes(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """To save current its brake closes some seconds after it has arrived, and turns the motor by a little as it grips:
    it is right at first, and off in what is read after that."""
    rows = scene.rows
    closes_s, grips_s = rng.uniform(2.5, 8), rng.uniform(0.3, 1.2)
    gripped = logistic((rows.dwell_s - closes_s) / (grips_s / 4))
    weight = 0.7 + 0.3 * np.abs(load_share(scene, drive))
    return Contribution(drive_m=draw_sign(rng) * gripped * weight * ~rows.moving)


@form()
def measuring_belt_stretches(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A new toothed belt leads to its rotary encoder and stretches from the first hour on, by ever less: the scale
    changes all the time, about where the belt is clamped."""
    hours = scene.rows.hours
    stretched = np.log1p(hours / rng.uniform(0.1, 0.8))
    clamped = rng.uniform(-0.2, 0.4)
    away = draw_sign(rng) * (scene.rows.raised[:, drive] - clamped)
    return Contribution(drive_m=stretched / stretched[-1] * away)


@form()
def homes_on_switch_that_warmth_moves(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Before each check of the nests it is homed on a proximity switch that answers earlier the warmer it is: its zero
    goes in steps, each by what the air has changed since the first one."""
    rows = scene.rows
    air_c, check = scene.weather.lagging_air_c(rng.uniform(5, 20)), np.maximum(rows.nest_check, 0)
    at_check = np.array([air_c[np.argmax(check >= one)] for one in range(int(check.max()) + 1)])
    after = rows.t_s[check > 0]
    step_s = float(after[0]) - 1.0 if len(after) else None
    return Contribution(drive_m=draw_sign(rng) * normalised((at_check - at_check[0])[check]), step_s=step_s)


FORMS: dict[str, tuple[Form, ...]] = {
    "screw_thermal_growth": (central_oil_brings_heat_of_all, flooded_cold_after_each_break),
    "backlash": (worn_where_it_stops_in_production, nut_set_tighter_in_a_break),
    "friction_windup": (new_wipers_run_in, strain_wave_gear_drags_by_its_angle),
    "screw_cumulative_error": (list_of_errors_entered_one_line_off, transducer_bends_off_at_its_ends),
    "screw_periodic_error": (balls_enter_nut_with_a_jerk, universal_joint_twice_a_turn),
    "encoder_interpolation": (magnetic_head_remembers_direction, current_of_motor_in_its_signals),
    "axis_coupling": (shared_balance_pressure_switches, balancers_share_one_gas_bottle),
    "servo_settling": (comes_in_at_creep_speed, brake_pulls_it_off_as_it_closes),
    "drive_scale": (measuring_belt_stretches, homes_on_switch_that_warmth_moves),
}
