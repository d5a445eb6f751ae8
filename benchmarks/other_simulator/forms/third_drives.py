"""Forms of the third archive of drives: along the screw or scale, in the drive train, and in its control."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms import drives, screws
from benchmarks.other_simulator.forms.drives import next_drive
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import of_former_visit, pause_before_s
from benchmarks.other_simulator.forms.screws import draw_lead, draw_pitch, of_pitch
from benchmarks.other_simulator.forms.shapes import bump, draw_phase, load_share, normalised, warming_up, wave
from benchmarks.other_simulator.rows import Rows
from benchmarks.other_simulator.scene import Scene

Array = NDArray[np.float64]
Generator = np.random.Generator

NODES = 41  # of a screw, of which each has a warmth of its own
GEARS = [0.4, 0.625, 1.6, 2.5]  # a gear's period over that of the screw


@form(screws.GROWTH_M)
def nut_warms_where_it_works(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The nut warms the piece of the screw on which it has worked lately; what lies beyond that piece is shifted."""
    return Contribution(drive_m=normalised(_grown_by_nut(scene.rows, drive, rng.uniform(12, 40))))


def _grown_by_nut(rows: Rows, drive: int, tau_min: float) -> Array:
    """Growth of a screw between its lower end and the nut (r,)."""
    place, way_m = rows.raised[:, drive], rows.way_m[:, drive]
    nodes, warmth, out = np.linspace(0, 1, NODES), np.zeros(NODES), np.zeros(len(rows))
    for k in range(1, len(rows)):
        warmth *= np.exp(-max(rows.t_s[k] - rows.t_s[k - 1], 0) / (tau_min * 60))
        low, high = sorted((place[k - 1], place[k]))
        passed = (nodes >= low - 1 / NODES) & (nodes <= high + 1 / NODES)
        warmth[passed] += max(way_m[k] - way_m[k - 1], 0) / passed.sum()
        out[k] = np.interp(place[k], nodes, np.cumsum(warmth))
    return out


@form(screws.GROWTH_M)
def motor_warms_by_holding(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The motor holds the weight by its current, also at rest, and warms the screw by the current's square."""
    reach, holding = rng.uniform(0.3, 0.7), load_share(scene, drive) ** 2
    warmth = lagging(scene.rows.t_s, holding, rng.uniform(8, 30) * 60)
    grown = 1 - np.exp(-(1 - scene.rows.raised[:, drive] + 0.1) / reach)
    return Contribution(drive_m=-grown * normalised(warmth - warmth.min()))


@form()
def pinion_off_centre(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A pinion that is off its centre opens and closes its play in each of its turns."""
    opened = 0.55 + 0.45 * wave(scene.rows.drives_m[:, drive], rng.uniform(0.08, 0.3), draw_phase(rng))
    return Contribution(drive_m=-0.5 * scene.rows.side[:, drive] * opened)


@form()
def counterweight_takes_most_of_the_load(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A counterweight takes nearly all load: the side of approach decides where it balances, else what is left."""
    load = scene.loads_n[:, drive]
    left = (load - np.quantile(load, rng.uniform(0.3, 0.7))) / max(load.std(), 1e-9)
    return Contribution(drive_m=-0.5 * np.tanh((1.2 * scene.rows.side[:, drive] + left) / 0.4))


@form()
def covers_drag_at_ends(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Telescopic covers drag where they are pushed together and where they are pulled out."""
    drag = 0.25 + 0.75 * np.abs(scene.rows.centred[:, drive]) ** rng.uniform(2.5, 5)
    return Contribution(drive_m=-scene.rows.side[:, drive] * drag + 0.3 * load_share(scene, drive))


@form()
def sticks_after_standing(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Grease is pressed out at rest: the longer it stood before a move, the more friction winds it up."""
    stuck = normalised(np.log1p(pause_before_s(scene.rows) / rng.uniform(5, 20)))
    return Contribution(drive_m=-scene.rows.side[:, drive] * (0.15 + 0.85 * stuck))


@form()
def racks_one_after_other(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Racks in a row, each with a lead of its own and a gap to the one before."""
    place_m, length_m = scene.rows.drives_m[:, drive], rng.uniform(0.2, 0.45)
    along = (place_m - place_m.min()) / length_m + rng.uniform(0, 1)
    rack = along.astype(int)
    gaps, leads = np.cumsum(rng.normal(size=rack.max() + 1)), rng.normal(size=rack.max() + 1)
    error = gaps[rack] + leads[rack] * (along - rack - 0.5)
    return Contribution(drive_m=normalised(error - error.mean()))


@form()
def tape_stretched_at_its_clamp(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A glued tape that its end clamp stretches: the glue takes that up within the first part of its length."""
    raised = scene.rows.raised[:, drive]
    from_clamp = raised if rng.random() < 0.5 else 1 - raised
    return Contribution(drive_m=np.exp(-from_clamp / rng.uniform(0.08, 0.25)))


@form(screws.PERIODIC_M)
def screw_and_gear(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Of each turn of the screw and of each of a gear's, whose periods have no common multiple nearby."""
    lead_m = draw_lead(scene, drive, rng)
    gear_m = float(np.clip(lead_m * rng.choice(GEARS), *screws.LEAD_M)) * 1.013
    place_m = scene.rows.drives_m[:, drive]
    error = 0.7 * wave(place_m, lead_m, draw_phase(rng)) + 0.6 * wave(place_m, gear_m, draw_phase(rng))
    return Contribution(drive_m=error, period_m=lead_m)


@form(screws.PERIODIC_M)
def each_side_its_own(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Of each turn, but the two flanks of the thread were ground apart: each side of approach has its own."""
    lead_m, place_m = draw_lead(scene, drive, rng), scene.rows.drives_m[:, drive]
    upper, lower = wave(place_m, lead_m, draw_phase(rng)), 0.7 * wave(place_m, lead_m, draw_phase(rng))
    return Contribution(drive_m=np.where(scene.rows.side[:, drive] > 0, upper, lower), period_m=lead_m)


@form()
def scale_dirty_in_one_zone(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Oil on one piece of the scale weakens one of the two signals."""
    pitch_m = draw_pitch(scene, drive, rng)
    dirty = 0.1 + 0.9 * bump(scene.rows.centred[:, drive], rng.uniform(-0.5, 0.5), rng.uniform(0.25, 0.45))
    return of_pitch(dirty * wave(scene.rows.drives_m[:, drive], pitch_m / 2, draw_phase(rng)), pitch_m)


@form()
def offsets_drift_as_it_warms(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Offsets of both signals drift as the head warms up: size and phase at the end are not those of the beginning."""
    pitch_m, place_m = draw_pitch(scene, drive, rng), scene.rows.drives_m[:, drive]
    warmth, phase = warming_up(scene.rows, rng.uniform(0.3, 1.2)), draw_phase(rng)
    cold, warm = wave(place_m, pitch_m, phase), wave(place_m, pitch_m, phase + rng.uniform(1.5, 3.5))
    return of_pitch(0.4 * (1 - warmth) * cold + warmth * warm, pitch_m)


@form()
def follows_last_move_of_other(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A shared hose or rope drags it after the other drive's last move, by the length of that move."""
    place_m = scene.rows.commanded_m[:, next_drive(scene, drive)]
    moved_m = place_m - of_former_visit(scene.rows, place_m)
    return Contribution(drive_m=np.tanh(moved_m / rng.uniform(0.08, 0.3)))


@form()
def wave_of_other(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A wave over the other drive's coordinate, as its chain runs over its rollers on a common frame."""
    place_m = scene.rows.drives_m[:, next_drive(scene, drive)]
    return Contribution(drive_m=wave(place_m, rng.uniform(0.12, 0.4), draw_phase(rng)))


@form(drives.SETTLING_M)
def sags_until_integrator_lifts_it(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It sags by what it holds when the brake opens, whatever side it comes from, until integral action lifts it."""
    rows, load = scene.rows, np.abs(load_share(scene, drive))
    return Contribution(drive_m=-(load**2) * np.exp(-rows.dwell_s / rng.uniform(1.5, 5)) * ~rows.moving)


@form(drives.SETTLING_M)
def overshoots_and_comes_back(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It runs over its place and comes back, further over after a long way."""
    rows = scene.rows
    time = rows.dwell_s / rng.uniform(1, 3.5)
    over = time * np.exp(1 - time) * np.sqrt(np.minimum(rows.approach_m[:, drive], 0.6) / 0.1)
    return Contribution(drive_m=rows.side[:, drive] * over * ~rows.moving)


@form()
def zero_anew_at_each_homing(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It is homed before each check of the nests, by a switch that does not find the same place again."""
    rows = scene.rows
    zeros = np.r_[0, rng.normal(size=rows.nest_check.max())]
    second = int(np.argmax(rows.nest_check > rows.nest_check[0]))
    step_s = float(rows.t_s[second - 1] + rows.t_s[second]) / 2 if second else None
    return Contribution(drive_m=normalised(zeros)[rows.nest_check], step_s=step_s)


@form()
def slips_on_its_way_down(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A clamped coupling slips with the load: a little with each move down, more when much hangs on it."""
    down_m = np.maximum(-np.diff(scene.rows.commanded_m[:, drive], prepend=scene.rows.commanded_m[0, drive]), 0)
    slipped = np.cumsum(down_m * np.abs(load_share(scene, drive)) ** rng.uniform(2, 5))
    return Contribution(drive_m=-slipped / max(slipped[-1], 1e-12))


FORMS: dict[str, tuple[Form, ...]] = {
    "screw_thermal_growth": (nut_warms_where_it_works, motor_warms_by_holding),
    "backlash": (pinion_off_centre, counterweight_takes_most_of_the_load),
    "friction_windup": (covers_drag_at_ends, sticks_after_standing),
    "screw_cumulative_error": (racks_one_after_other, tape_stretched_at_its_clamp),
    "screw_periodic_error": (screw_and_gear, each_side_its_own),
    "encoder_interpolation": (scale_dirty_in_one_zone, offsets_drift_as_it_warms),
    "axis_coupling": (follows_last_move_of_other, wave_of_other),
    "servo_settling": (sags_until_integrator_lifts_it, overshoots_and_comes_back),
    "drive_scale": (zero_anew_at_each_homing, slips_on_its_way_down),
}  # fmt: skip
