"""Forms of effects of screws, scales and the control of drives, of the tenth archive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.drives import CREEP_M, SETTLING_M, next_drive
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import new_visit
from benchmarks.other_simulator.forms.memory import switched_over
from benchmarks.other_simulator.forms.screws import GROWTH_M, PERIODIC_M, draw_lead, draw_pitch, of_pitch
from benchmarks.other_simulator.forms.shapes import (
    draw_phase,
    draw_sign,
    load_share,
    logistic,
    normalised,
    wave,
)
from benchmarks.other_simulator.forms.traces import draw_after_break, draw_stretches, reversals
from benchmarks.other_simulator.scene import Scene

Array = NDArray[np.float64]
Generator = np.random.Generator

TEETH = (17, 41)  # of a wheel on the screw
JERKS = 3  # in which a drive lets go


def _detrended(x: Array, values: Array) -> Array:
    """Values (r,) without their line over x (r,), which the drive's scale takes up; 1 at most."""
    return normalised(values - np.polyval(np.polyfit(x, values, 1), x))


def _approach_share(scene: Scene, drive: int) -> Array:
    """Length of the last approach (r,), 1 for a long one."""
    approach_m = scene.rows.approach_m[:, drive]
    return np.minimum(approach_m / max(float(np.quantile(approach_m, 0.9)), 1e-6), 1.5)


@form(GROWTH_M)
def runs_warm_after_greasing(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """In a break its nut is filled with fresh grease, which it has to churn: it runs far warmer than before, until the
    surplus has been pressed out on its way."""
    rows = scene.rows
    after, first_s, step_s = draw_after_break(rows, rng)
    way_m = rows.way_m[:, drive]
    run_m = np.maximum(way_m - float(np.interp(first_s, rows.t_s, way_m)), 0)
    churns = after.astype(float) * np.exp(-run_m / (rng.uniform(0.3, 1.5) * max(float(run_m.max()), 1e-3)))
    tau_min = rng.uniform(10, 30)
    heat = (rng.uniform(0.1, 0.3) + lagging(rows.t_s, churns, tau_min * 60)) * rows.warmth_of_motion(drive, tau_min)
    return Contribution(drive_m=normalised(heat) * (rows.raised[:, drive] + rng.uniform(0.1, 0.4)), step_s=step_s)


@form(GROWTH_M)
def chilled_to_the_warmth_of_the_bed(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The chiller of its bore takes the sluggish bed for its guide: the screw is as warm as that, which is behind the
    column by hours, and a little warmer in what oil it gets when it runs."""
    rows, part_c = scene.rows, scene.weather.part_c
    oil = part_c["base"] - part_c["drives"]
    warmth = normalised(lagging(rows.t_s, oil, rng.uniform(3, 12) * 60))
    warmth = warmth + rng.uniform(0, 0.3) * rows.warmth_of_motion(drive, rng.uniform(5, 15))
    return Contribution(drive_m=warmth * (rows.raised[:, drive] + rng.uniform(0.1, 0.4)))


@form()
def rack_parts_from_its_pinion(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The rack was not set parallel to the guide: the teeth are in each other without play at one end of the travel,
    and further apart the nearer the carriage comes to the other end."""
    place = scene.rows.centred[:, drive] * draw_sign(rng)
    apart = np.maximum(place - rng.uniform(-1.0, -0.3), 0)
    return Contribution(drive_m=-0.5 * scene.rows.side[:, drive] * normalised(apart))


@form()
def air_that_closes_its_play_fails(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Two pinions are pressed apart by compressed air and so have no play; at times the hall needs the air elsewhere,
    the pressure falls within a minute or two, and the play is there."""
    rows = scene.rows
    fails = lagging(rows.t_s, draw_stretches(rows, (2, 5), (0.12, 0.3), rng), rng.uniform(0.5, 4) * 60)
    return Contribution(drive_m=-0.5 * rows.side[:, drive] * (rng.uniform(0.0, 0.2) + 0.9 * fails))


@form()
def both_strands_of_belt_stretch(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A toothed belt over two pulleys draws it: both strands carry, the short one most, so that friction and load
    stretch it most midway between the pulleys, and hardly where the carriage is next to one."""
    share = 0.5 + rng.uniform(0.4, 0.47) * scene.rows.centred[:, drive]
    soft = 4 * share * (1 - share)
    pulled = -scene.rows.side[:, drive] * rng.uniform(0.5, 1) + rng.uniform(0.4, 0.9) * load_share(scene, drive)
    return Contribution(drive_m=soft * pulled)


@form()
def felt_wipers_swell_when_damp(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Dry wipers of felt swell with the air's moisture, half an hour or an hour late, and then grip the screw: it is
    wound up before each stop by that, and by what it holds."""
    rows = scene.rows
    damp = lagging(rows.t_s, scene.weather.humidity_percent, rng.uniform(0.2, 0.9) * 3600)
    damp = (damp - damp.min()) / max(float(np.ptp(damp)), 1e-9)
    grip = rng.uniform(0.05, 0.3) + damp ** rng.uniform(1, 2)
    return Contribution(drive_m=-rows.side[:, drive] * grip + rng.uniform(0.1, 0.4) * load_share(scene, drive))


@form()
def straightened_in_press(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The screw was bent by a crash and straightened in a press at two or three places: at each of these its thread
    has become longer for good, over the width of the press's blocks."""
    place, longer = scene.rows.centred[:, drive], np.zeros(len(scene.rows))
    for middle in np.linspace(-0.6, 0.6, int(rng.integers(2, 4))):
        at = middle + rng.uniform(-0.2, 0.2)
        longer += rng.uniform(0.4, 1) * logistic((place - at) / rng.uniform(0.02, 0.06))
    return Contribution(drive_m=draw_sign(rng) * _detrended(place, longer))


@form()
def tape_lies_over_heads_of_rivets(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The tape of the scale was laid over old rivets: it climbs over each of them, so that its lines lean back and then
    forward, and the head reads ahead before the rivet and behind after it."""
    place, error = scene.rows.centred[:, drive], np.zeros(len(scene.rows))
    for rivet in np.linspace(-0.85, 0.85, int(rng.integers(4, 8))):
        off = (place - rivet - rng.uniform(-0.1, 0.1)) / rng.uniform(0.05, 0.11)
        error += rng.uniform(0.5, 1) * off * np.exp(-(off**2))
    return Contribution(drive_m=draw_sign(rng) * _detrended(place, error))


@form(PERIODIC_M)
def teeth_of_wheel_that_runs_out(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The wheel on the screw runs out: its teeth are heard in one half of each turn more than in the other, so that
    the error of each tooth swells and ebbs once a turn, besides some of the turn itself."""
    lead_m, teeth = draw_lead(scene, drive, rng), int(rng.integers(*TEETH))
    at_m, phase = scene.rows.drives_m[:, drive], draw_phase(rng)
    swells = 1 + rng.uniform(0.6, 1) * wave(at_m, lead_m, phase)
    error = swells * wave(at_m, lead_m / teeth, draw_phase(rng)) + rng.uniform(0, 0.5) * wave(at_m, lead_m, phase + 1)
    return Contribution(drive_m=normalised(error), period_m=lead_m / teeth)


@form(PERIODIC_M)
def worn_clutch_turns_on_at_reversals(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The encoder sits behind a worn claw clutch and sees the screw's wobble once a turn; at each reversal the clutch
    creeps on by a few degrees, so that the same wobble comes later and later, though nothing is lost on average."""
    lead_m = draw_lead(scene, drive, rng)
    back = reversals(scene.rows, drive)
    turns = rng.uniform(0.4, 1.5) * draw_sign(rng) * 2 * np.pi / max(float(back[-1]), 1.0)
    if back[-1] < 2:  # it never reverses: the clutch creeps with the way instead
        back = scene.rows.way_m[:, drive] / max(float(scene.rows.way_m[-1, drive]), 1e-6)
    phase = 2 * np.pi * scene.rows.drives_m[:, drive] / lead_m + turns * back + draw_phase(rng)
    return Contribution(drive_m=np.sin(phase) + 0.2 * np.sin(2 * phase), period_m=lead_m)


@form()
def signals_of_other_encoder_leak_in(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Both encoders' cables lie in one trough with their shields undone: a part of the other one's signals is added to
    its own, and turns the phase by the sine of what both phases differ by."""
    pitch_m, at_m = draw_pitch(scene, drive, rng), scene.rows.drives_m
    apart = at_m[:, next_drive(scene, drive)] * rng.choice([1.0, 1.0, -1.0]) - at_m[:, drive]
    own = rng.uniform(0, 0.4) * wave(at_m[:, drive], pitch_m, draw_phase(rng))
    return of_pitch(normalised(wave(apart, pitch_m, draw_phase(rng)) + own), pitch_m)


@form()
def glass_fogs_in_warm_damp_air(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """While the air is warmer than the column, and the damper it is, the scale's glass fogs: the two signals weaken
    unequally, which errs twice a period, and once by stray light."""
    rows, weather = scene.rows, scene.weather
    warmer = weather.lagging_air_c(5) - weather.part_c["drives"]
    fog = np.maximum(warmer - np.quantile(warmer, rng.uniform(0.1, 0.4)), 0) * weather.humidity_percent
    fog = normalised(lagging(rows.t_s, fog, rng.uniform(2, 10) * 60))
    pitch_m, at_m = draw_pitch(scene, drive, rng), rows.drives_m[:, drive]
    error = wave(at_m, pitch_m / 2, draw_phase(rng)) + rng.uniform(0.2, 0.6) * wave(at_m, pitch_m, draw_phase(rng))
    return of_pitch(normalised(error) * (rng.uniform(0.05, 0.2) + fog), pitch_m)


@form()
def cable_tray_hinged_to_both(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A tray for cables hangs on hinges between both carriages and is too short: it pulls hardly at all while they
    stand level, and ever more steeply as they part, the lower one up and the higher one down."""
    at_m = scene.rows.drives_m
    apart_m = at_m[:, next_drive(scene, drive)] - at_m[:, drive] - rng.uniform(-0.1, 0.1)
    long_m = rng.uniform(0.2, 0.8)
    return Contribution(drive_m=normalised(apart_m * (1 - long_m / np.sqrt(long_m**2 + apart_m**2))))


@form()
def pressure_falls_as_other_lifts(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """One pump feeds the balancing cylinders of both: a long way up of the other one takes the pressure away, and this
    one hangs lower until the pump has brought that back."""
    rows, other = scene.rows, next_drive(scene, drive)
    lifted = np.maximum(rows.side[:, other], 0) * _approach_share(scene, other)
    comes_back_s = rng.uniform(6, 30)
    lacks = lifted * np.exp(-rows.dwell_s / comes_back_s) * (1 + rng.uniform(0, 0.5) * rows.raised[:, drive])
    return Contribution(drive_m=-lacks * ~rows.moving)


@form(CREEP_M)
def lets_go_jerk_by_jerk(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """What it was strained by in stopping is let go in a few jerks of its seals, which come sooner at one visit and
    later at another; between two of them nothing moves."""
    rows = scene.rows
    visit = np.cumsum(new_visit(rows))
    jerks_s = np.cumsum(rng.exponential(rng.uniform(1.5, 5), (int(visit[-1]) + 1, JERKS)), 1)
    left = (jerks_s[visit] > rows.dwell_s[:, None]).mean(1)
    strained = 0.4 + 0.6 * np.minimum(rows.speed_m_per_s / 0.1, 1.5)
    return Contribution(drive_m=-rows.side[:, drive] * left * strained * ~rows.moving)


@form(SETTLING_M)
def slower_where_its_screw_is_long(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The loop lowers its gain where the free length of screw is long and would swing: it is there at once near the
    bearing, and takes many seconds for the last bit far from it."""
    rows = scene.rows
    slower = rng.uniform(0.7, 1.4) * draw_sign(rng) * rows.centred[:, drive]
    left = np.exp(-rows.dwell_s / (rng.uniform(1.5, 4) * np.exp(slower)))
    return Contribution(drive_m=-rows.side[:, drive] * _approach_share(scene, drive) * left * ~rows.moving)


@form()
def payload_stretches_its_scale(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The rod that carries the scale bears a part of the weight as well: with each payload it is stretched from its
    upper end down, by the mass of that, and the zero goes along a little."""
    rows = scene.rows
    mass = rows.stated_payload_kg / max(float(rows.stated_payload_kg.max()), 1.0)
    stretched = lagging(rows.t_s, mass, rng.uniform(0.1, 5) * 60)
    return Contribution(drive_m=stretched * (rng.uniform(0.7, 1.2) - rows.raised[:, drive]))


@form()
def head_knocked_at_ends_of_travel(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The bracket of its reading head is loose and touches the stops: near the upper end it is pushed down on the
    carriage, near the lower end up again, and keeps that zero in between."""
    place = scene.rows.centred[:, drive]
    low, high = np.quantile(place, [rng.uniform(0.04, 0.12), 1 - rng.uniform(0.04, 0.12)])
    return Contribution(drive_m=0.5 * switched_over(place, float(low), float(high)))


FORMS: dict[str, tuple[Form, ...]] = {
    "screw_thermal_growth": (runs_warm_after_greasing, chilled_to_the_warmth_of_the_bed),
    "backlash": (rack_parts_from_its_pinion, air_that_closes_its_play_fails),
    "friction_windup": (both_strands_of_belt_stretch, felt_wipers_swell_when_damp),
    "screw_cumulative_error": (straightened_in_press, tape_lies_over_heads_of_rivets),
    "screw_periodic_error": (teeth_of_wheel_that_runs_out, worn_clutch_turns_on_at_reversals),
    "encoder_interpolation": (signals_of_other_encoder_leak_in, glass_fogs_in_warm_damp_air),
    "axis_coupling": (cable_tray_hinged_to_both, pressure_falls_as_other_lifts),
    "servo_settling": (lets_go_jerk_by_jerk, slower_where_its_screw_is_long),
    "drive_scale": (payload_stretches_its_scale, head_knocked_at_ends_of_travel),
}
