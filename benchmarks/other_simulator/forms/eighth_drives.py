"""Forms of effects of screws, scales and the control of drives, of the eighth archive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.drives import SETTLING_M, next_drive
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import draw_mountings
from benchmarks.other_simulator.forms.memory import cooled_by_thermostat
from benchmarks.other_simulator.forms.screws import GROWTH_M, PERIODIC_M, draw_lead, draw_pitch, of_pitch
from benchmarks.other_simulator.forms.shapes import (
    bump,
    draw_instant,
    draw_phase,
    draw_sign,
    load_share,
    logistic,
    normalised,
    since,
    wave,
)
from benchmarks.other_simulator.rows import Rows
from benchmarks.other_simulator.scene import Scene

Array = NDArray[np.float64]
Generator = np.random.Generator

CELLS = 30  # of a screw, over the travel


@form(GROWTH_M)
def warmed_where_the_nut_works(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The nut warms the stretch of the screw that it works on; what is between there and the fixed bearing is cold."""
    warmth, place = _warmth_of_cells(scene.rows, drive, rng.uniform(12, 40) * 60), scene.rows.raised[:, drive]
    away = 1
    if rng.random() < 0.5:  # the fixed bearing is above
        warmth, place, away = warmth[:, ::-1], 1 - place, -1
    ends = np.linspace(0, 1, CELLS + 1)
    grown_to = np.concatenate([np.zeros((len(scene.rows), 1)), np.cumsum(warmth, 1)], 1)
    grown = [np.interp(where, ends, to) for where, to in zip(place, grown_to, strict=True)]
    return Contribution(drive_m=away * normalised(np.array(grown)))


def _warmth_of_cells(rows: Rows, drive: int, tau_s: float) -> Array:
    """Warmth (r, CELLS) of the pieces of a screw, which each way across them adds to and time takes away."""
    out, warmth = np.zeros((len(rows), CELLS)), np.zeros(CELLS)
    edges, place = np.linspace(0, 1, CELLS + 1), rows.raised[:, drive]
    travelled = np.diff(rows.way_m[:, drive], prepend=rows.way_m[0, drive])
    for k in range(1, len(rows)):
        low, high = sorted((place[k - 1], place[k]))
        reached = (edges[1:] > low - 1 / CELLS) & (edges[:-1] < high + 1 / CELLS)
        warmth = warmth * np.exp(-(rows.t_s[k] - rows.t_s[k - 1]) / tau_s) + reached * travelled[k] / reached.sum()
        out[k] = warmth
    return out


@form(GROWTH_M)
def cooled_through_its_bore(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A hollow screw whose chiller goes on and off: within minutes it shrinks and, warmed by the nut, grows again."""
    rows = scene.rows
    heat = 0.5 + 0.5 * rows.warmth_of_motion(drive, rng.uniform(8, 25))
    middle, half = rng.uniform(0.15, 0.3), rng.uniform(0.08, 0.15)
    warmth = cooled_by_thermostat(rows.t_s, heat, rng.uniform(6, 15) * 60, middle + half, middle - half)
    grown = normalised(warmth - warmth.mean()) * (rows.raised[:, drive] + rng.uniform(0.05, 0.3))
    return Contribution(drive_m=grown)


@form()
def eccentric_pinion_as_well(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A wheel of the gear runs out: it lies deep in its mate at one angle and has play half a turn further."""
    circumference_m = rng.uniform(0.06, 0.26)
    depth = 0.5 * (1 + wave(scene.rows.drives_m[:, drive], circumference_m, draw_phase(rng)))
    return Contribution(drive_m=-0.5 * scene.rows.side[:, drive] * (0.2 + 0.8 * depth))


@form()
def coupling_comes_loose(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The hub of the coupling comes loose at a moment; until then there is hardly any play."""
    step_s = draw_instant(scene.rows, rng, 0.2, 0.7)
    width = rng.uniform(0, 0.1) + since(scene.rows, step_s)
    return Contribution(drive_m=-0.5 * scene.rows.side[:, drive] * width, step_s=step_s)


@form()
def stiff_grease_until_warm(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Grease that is stiff until motion has warmed it, and drags with the speed of approach; the load winds up too."""
    rows = scene.rows
    thinned = 1 - 0.75 * rows.warmth_of_motion(drive, rng.uniform(8, 25))
    drag = thinned * (0.2 + np.sqrt(rows.speed_m_per_s / 0.1))
    return Contribution(drive_m=-0.6 * rows.side[:, drive] * drag + rng.uniform(0.4, 0.8) * load_share(scene, drive))


@form()
def cover_jams_when_folded(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A telescopic cover jams the more it is pushed together; the same soft transmission gives way to the load."""
    place = scene.rows.raised[:, drive]
    folded = place if rng.random() < 0.5 else 1 - place
    drag = 0.15 + 0.85 * folded ** rng.uniform(1.5, 3)
    wound_up = -scene.rows.side[:, drive] * drag + rng.uniform(0.5, 0.9) * load_share(scene, drive)
    return Contribution(drive_m=wound_up)


@form()
def racks_butted_with_gaps(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Racks put end to end, with a gap that is too wide or too narrow at each joint."""
    travel_m = scene.rows.drives_m[:, drive]
    rack_m = rng.choice([0.25, 0.333, 0.5]) * min(np.ptp(travel_m) / 0.8, 1.0)
    joint_m, errors = travel_m.min() + rng.uniform(0.3, 0.9) * rack_m, np.zeros(len(travel_m))
    while joint_m < travel_m.max():
        gap = rng.uniform(0.4, 1) * draw_sign(rng)
        errors += gap * logistic((travel_m - joint_m) / 0.004)
        joint_m += rack_m
    return Contribution(drive_m=errors)


@form()
def lead_wanders(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The lead wanders along the screw as the grinding machine's temperature did; its errors add up."""
    place, nodes = scene.rows.centred[:, drive], np.linspace(-1, 1, 81)
    pieces = int(rng.integers(6, 11))
    lead = np.interp(nodes, np.linspace(-1, 1, pieces), rng.normal(size=pieces))
    summed = np.cumsum(lead)
    bent = summed - np.polynomial.Polynomial.fit(nodes, summed, 1)(nodes)
    return Contribution(drive_m=np.interp(place, nodes, normalised(bent)))


@form(PERIODIC_M)
def motor_and_screw_turn(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A toothed belt between motor and screw: an error of each turn of the screw, and one of each turn of the motor."""
    lead_m, place_m = draw_lead(scene, drive, rng), scene.rows.drives_m[:, drive]
    ratio = float(rng.choice([1.25, 1.5, 1.6, 2.5]))
    error = 0.8 * wave(place_m, lead_m, draw_phase(rng)) + 0.5 * wave(place_m, lead_m / ratio, draw_phase(rng))
    return Contribution(drive_m=error, period_m=lead_m)


@form(PERIODIC_M)
def bent_between_bearings(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A bent screw throws the nut about once a turn, most of all midway between its bearings."""
    lead_m, place_m = draw_lead(scene, drive, rng), scene.rows.drives_m[:, drive]
    thrown = np.cos(0.5 * np.pi * (scene.rows.centred[:, drive] * rng.uniform(0.75, 0.95)))
    return Contribution(drive_m=wave(place_m, lead_m, draw_phase(rng)) * thrown, period_m=lead_m)


@form()
def dirt_on_a_stretch_of_scale(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Oil on a stretch of the scale spoils both signals there: errors once and twice a period, and none elsewhere."""
    pitch_m, place_m = draw_pitch(scene, drive, rng), scene.rows.drives_m[:, drive]
    dirty = bump(scene.rows.centred[:, drive], rng.uniform(-0.5, 0.5), rng.uniform(0.35, 0.6))
    error = wave(place_m, pitch_m, draw_phase(rng)) + 0.5 * wave(place_m, pitch_m / 2, draw_phase(rng))
    return of_pitch(error * dirty, pitch_m)


@form()
def signals_too_large(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Signals too large for the converter, which cuts off their peaks: an error four times a period, with a second
    one once a period of a signal that is cut off on one side only.
    """
    pitch_m = draw_pitch(scene, drive, rng)
    phase = 2 * np.pi * scene.rows.drives_m[:, drive] / pitch_m + draw_phase(rng)
    level, offset = rng.uniform(0.72, 0.85), rng.uniform(-0.1, 0.1)
    cosine = np.clip(np.cos(phase) + offset, -level, level)
    sine = np.clip(np.sin(phase), -level, level)
    off = np.angle(np.exp(1j * (np.arctan2(sine, cosine) - phase)))
    return of_pitch(normalised(off - off.mean()), pitch_m)


@form()
def takes_over_periodic_error(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It follows the other drive by that one's motor encoder, and takes over what the screw there errs by each turn."""
    other = next_drive(scene, drive)
    turn_m = draw_lead(scene, other, rng)
    return Contribution(drive_m=wave(scene.rows.drives_m[:, other], turn_m, draw_phase(rng)))


@form()
def chain_lifts_beyond_a_place(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The chain of the other drive lies on its trough, and is lifted by this one from some place of the other on."""
    place = scene.rows.centred[:, next_drive(scene, drive)] * draw_sign(rng)
    return Contribution(drive_m=draw_sign(rng) * normalised(np.maximum(place - rng.uniform(-0.5, 0.3), 0)))


@form(SETTLING_M)
def hunts(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It hunts: its integral action and friction drive it to and fro across its place, and it does not end."""
    rows = scene.rows
    visits = rows.visit.max() + 1
    period_s = rng.uniform(2.5, 7) * np.exp(0.15 * rng.normal(size=visits))[rows.visit]
    turn = rows.dwell_s / period_s + rng.uniform(0, 0.15, visits)[rows.visit]
    return Contribution(drive_m=-rows.side[:, drive] * np.tanh(3 * np.cos(2 * np.pi * turn)) * ~rows.moving)


@form(SETTLING_M)
def overshoots_with_mass(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It runs past its place and comes back, later and from further the more mass it moves and the faster it came."""
    rows = scene.rows
    mass = 1 + rows.payload_kg / scene.machine.moving_mass_kg
    done = rows.dwell_s / (rng.uniform(1.5, 4) * np.sqrt(mass))
    past = done * np.exp(1 - done) * mass * np.minimum(rows.speed_m_per_s, 0.3) / 0.15
    return Contribution(drive_m=rows.side[:, drive] * past * ~rows.moving)


@form()
def homes_elsewhere_each_time(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It is switched off for each change of payload and homed after it, to a zero that scatters."""
    mounting, first_s = draw_mountings(scene.rows, rng)
    zeros = rng.uniform(0.4, 1, int(mounting.max()) + 1) * rng.choice([-1, 1], int(mounting.max()) + 1)
    zeros[0] = 0.0
    return Contribution(drive_m=zeros[mounting], step_s=first_s)


@form()
def scale_tape_slackens(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The end of a tensioned scale tape comes off at a moment; the tape creeps together towards the end that holds."""
    rows = scene.rows
    step_s = draw_instant(rows, rng, 0.15, 0.6)
    passed = np.maximum(rows.t_s - step_s, 0) / (rng.uniform(3, 20) * 60)
    place = rows.raised[:, drive] if rng.random() < 0.5 else 1 - rows.raised[:, drive]
    slack = (0.35 + 0.65 * (1 - np.exp(-passed))) * since(rows, step_s)
    return Contribution(drive_m=-slack * (place + rng.uniform(0.05, 0.3)), step_s=step_s)


FORMS: dict[str, tuple[Form, ...]] = {
    "screw_thermal_growth": (warmed_where_the_nut_works, cooled_through_its_bore),
    "backlash": (eccentric_pinion_as_well, coupling_comes_loose),
    "friction_windup": (stiff_grease_until_warm, cover_jams_when_folded),
    "screw_cumulative_error": (racks_butted_with_gaps, lead_wanders),
    "screw_periodic_error": (motor_and_screw_turn, bent_between_bearings),
    "encoder_interpolation": (dirt_on_a_stretch_of_scale, signals_too_large),
    "axis_coupling": (takes_over_periodic_error, chain_lifts_beyond_a_place),
    "servo_settling": (hunts, overshoots_with_mass),
    "drive_scale": (homes_elsewhere_each_time, scale_tape_slackens),
}
