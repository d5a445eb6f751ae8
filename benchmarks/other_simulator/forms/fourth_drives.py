"""Forms of the fourth archive of drives: along the screw or scale, in the drive train, and in its control."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms import drives, screws
from benchmarks.other_simulator.forms.columns import sideways_n
from benchmarks.other_simulator.forms.drives import next_drive
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import new_visit, of_former_visit
from benchmarks.other_simulator.forms.memory import cooled_by_thermostat
from benchmarks.other_simulator.forms.screws import draw_lead, draw_pitch, of_pitch
from benchmarks.other_simulator.forms.shapes import (
    draw_instant,
    draw_phase,
    draw_sign,
    draw_two_instants,
    logistic,
    normalised,
    since,
    wave,
)
from benchmarks.other_simulator.scene import Scene

Array = NDArray[np.float64]
Generator = np.random.Generator

MARKS = 160  # of a screw, between which its lead is another each time
ON_ABOVE, OFF_BELOW = 0.45, 0.1  # warmth at which the cooler of a screw starts and stops


@form(screws.GROWTH_M)
def cooler_of_screw_starts_and_stops(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Oil flows through it as soon as it is too warm and until it is too cold: it swings, the faster the more it
    works."""
    rows = scene.rows
    heat = 0.6 + 0.5 * rows.warmth_of_motion(drive, rng.uniform(5, 15))
    warmth = cooled_by_thermostat(rows.t_s, heat, rng.uniform(5, 15) * 60, ON_ABOVE, OFF_BELOW)
    return Contribution(drive_m=normalised(warmth - warmth.mean()) * (rows.raised[:, drive] + 0.2))


@form(screws.GROWTH_M)
def grows_once_its_stretch_is_used_up(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It was mounted stretched between its two bearings: warmth only slackens it at first, and then moves an end."""
    warmth = scene.rows.warmth_of_motion(drive, rng.uniform(12, 40))
    over = np.maximum(warmth - np.quantile(warmth, rng.uniform(0.3, 0.65)), 0)
    return Contribution(drive_m=normalised(over) * (scene.rows.raised[:, drive] + rng.uniform(0, 0.4)))


@form()
def load_lifts_nut_off_its_spring(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A spring keeps two halves of the nut apart: coming from one side, much load presses that spring together."""
    rows, load = scene.rows, np.abs(scene.loads_n[:, drive])
    spring_n = np.quantile(load, rng.uniform(0.3, 0.7))
    lifted = logistic((load - spring_n) / (0.15 * max(load.std(), 1e-9)))
    return Contribution(drive_m=(0.1 + 0.9 * lifted) * np.where(rows.side[:, drive] == draw_sign(rng), 1.0, 0.0))


@form()
def thrown_through_play_by_fast_stop(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """After a slow way it rests against the flank that pushed it; a fast stop throws it over to the other one."""
    rows, enough = scene.rows, rng.uniform(0.05, 0.15)
    pushed = np.tanh((enough - rows.speed_m_per_s) / (0.3 * enough))
    return Contribution(drive_m=-0.5 * rows.side[:, drive] * pushed)


@form()
def dry_until_next_shot_of_oil(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Oil comes in shots after so much way: friction grows from each shot to the next one, and falls with it."""
    way_m = scene.rows.way_m[:, drive]
    dry = (way_m / max(way_m[-1], 1e-9) * rng.uniform(1.7, 5) + rng.uniform(0, 1)) % 1
    return Contribution(drive_m=-scene.rows.side[:, drive] * (0.15 + 0.85 * dry ** rng.uniform(0.7, 2)))


@form()
def struts_press_it_into_its_guides(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The struts press it sideways into its guides: friction goes with that force, not with what the drive holds."""
    pressed = np.abs(sideways_n(scene.machine, scene.calm, drive))
    share = (pressed - pressed.min()) / max(float(np.ptp(pressed)), 1e-9)
    return Contribution(drive_m=-scene.rows.side[:, drive] * (0.15 + 0.85 * share ** rng.uniform(0.8, 1.6)))


@form()
def scale_stretched_from_screw_to_screw(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A scale whose screws were tightened one after the other: between each two it is stretched by another amount."""
    place_m, spacing_m = scene.rows.drives_m[:, drive], rng.uniform(0.12, 0.3)
    screws_m = np.arange(place_m.min() - rng.uniform(0, 1) * spacing_m, place_m.max() + spacing_m, spacing_m)
    return Contribution(drive_m=_about_line(place_m, np.interp(place_m, screws_m, rng.normal(size=len(screws_m)))))


@form()
def lead_wanders_from_mark_to_mark(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A rolled screw whose lead is another in each short piece: errors add up at random, without any wave or bow."""
    place_m = scene.rows.drives_m[:, drive]
    marks_m = np.linspace(place_m.min() - 0.01, place_m.max() + 0.01, MARKS)
    return Contribution(drive_m=_about_line(place_m, np.interp(place_m, marks_m, np.cumsum(rng.normal(size=MARKS)))))


def _about_line(place_m: Array, error: Array) -> Array:
    """An error (r,) over a place without its line, which would be another scale; 1 at its largest."""
    return normalised(error - np.polyval(np.polyfit(place_m, error, 1), place_m))


@form(screws.PERIODIC_M)
def bent_screw_whips_between_bearings(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A bent screw: of each turn, most halfway between its bearings and hardly at all beside them."""
    lead_m, raised = draw_lead(scene, drive, rng), scene.rows.raised[:, drive]
    off_m = np.sin(np.pi * (0.05 + 0.9 * raised)) ** rng.uniform(1, 2.5)
    return Contribution(drive_m=off_m * wave(scene.rows.drives_m[:, drive], lead_m, draw_phase(rng)), period_m=lead_m)


@form(screws.PERIODIC_M)
def coupling_taken_apart_and_put_on_turned(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Of each turn; someone takes its coupling apart, puts it on turned and homes it: the phase is another then."""
    lead_m, phase, step_s = draw_lead(scene, drive, rng), draw_phase(rng), draw_instant(scene.rows, rng)
    phases = phase + since(scene.rows, step_s) * rng.uniform(1.6, 4.7)
    error = np.sin(2 * np.pi * scene.rows.drives_m[:, drive] / lead_m + phases)
    return Contribution(drive_m=error, period_m=lead_m, step_s=step_s)


@form()
def corrected_only_by_long_moves(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Its electronics learn the signals' offsets while it moves: after a short way they are as wrong as at the
    beginning."""
    pitch_m = draw_pitch(scene, drive, rng)
    unlearnt = 0.15 + 0.85 * np.exp(-scene.rows.approach_m[:, drive] / rng.uniform(0.05, 0.2))
    return of_pitch(unlearnt * wave(scene.rows.drives_m[:, drive], pitch_m, draw_phase(rng)), pitch_m)


@form()
def head_turned_by_load_of_carriage(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The struts turn the carriage and with it the reading head: one signal comes before or after where it should."""
    pitch_m, calm = draw_pitch(scene, drive, rng), scene.calm
    moment_nm = calm.carriage_moment_nm[:, drive] @ scene.machine.normals[drive]
    askew = normalised(moment_nm - np.quantile(moment_nm, rng.uniform(0.2, 0.8)))
    return of_pitch(askew * np.sin(4 * np.pi * scene.rows.drives_m[:, drive] / pitch_m + draw_phase(rng)), pitch_m)


@form()
def cable_of_other_becomes_taut(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A cable too short from the other drive's carriage: slack until that is some way off, and then it pulls."""
    away = draw_sign(rng) * scene.rows.centred[:, next_drive(scene, drive)]
    return Contribution(drive_m=np.maximum(away - rng.uniform(-0.3, 0.4), 0))


@form()
def held_back_when_other_has_longer_way(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The control keeps both in step: which of them had the longer way is left ahead, the other one behind."""
    place_m = scene.rows.commanded_m
    moved_m = np.abs(place_m - of_former_visit(scene.rows, place_m))
    longer_m = moved_m[:, next_drive(scene, drive)] - moved_m[:, drive]
    return Contribution(drive_m=-np.tanh(longer_m / rng.uniform(0.05, 0.2)))


@form(drives.SETTLING_M)
def hunts_about_its_place(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Integral action and stiction: it stays on one side, jumps to the other and back, and is quiet only later."""
    rows, period_s, quiet_s = scene.rows, rng.uniform(4, 11), rng.uniform(8, 25)
    begins = rng.uniform(0, 6.3, int(rows.visit.max()) + 1)[rows.visit]
    jumps = np.tanh(3 * np.sin(2 * np.pi * rows.dwell_s / period_s + begins))
    return Contribution(drive_m=jumps * np.exp(-rows.dwell_s / quiet_s) * ~rows.moving)


@form(drives.CREEP_M)
def declared_there_within_a_window(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The control says that it is there once it is within a window, anywhere in that; then it closes up slowly."""
    rows = scene.rows
    anywhere = rng.uniform(-1, 1, int(rows.visit.max()) + 1)[rows.visit]
    return Contribution(drive_m=anywhere * np.exp(-rows.dwell_s / rng.uniform(4, 14)) * ~rows.moving)


@form()
def wrong_zero_until_homed_again(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """After a fault it is homed on the wrong mark, somebody notices that, and homes it again on the right one."""
    first_s, second_s = draw_two_instants(scene.rows, rng, (0.15, 0.45), (0.55, 0.85))
    return Contribution(drive_m=since(scene.rows, first_s) - since(scene.rows, second_s), step_s=first_s)


@form()
def counts_lost_in_fast_moves(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Its counter misses some of what a fast move brings: the zero goes with those moves, up with one, down with
    another."""
    rows, place_m = scene.rows, scene.rows.commanded_m[:, drive]
    moved_m = place_m - of_former_visit(rows, place_m)
    downwards = 1 + rng.uniform(0, 0.3) * (moved_m < 0)
    lost = np.cumsum(new_visit(rows) * np.tanh(moved_m / 0.05) * downwards * rows.speed_m_per_s**2)
    return Contribution(drive_m=normalised(lost))


FORMS: dict[str, tuple[Form, ...]] = {
    "screw_thermal_growth": (cooler_of_screw_starts_and_stops, grows_once_its_stretch_is_used_up),
    "backlash": (load_lifts_nut_off_its_spring, thrown_through_play_by_fast_stop),
    "friction_windup": (dry_until_next_shot_of_oil, struts_press_it_into_its_guides),
    "screw_cumulative_error": (scale_stretched_from_screw_to_screw, lead_wanders_from_mark_to_mark),
    "screw_periodic_error": (bent_screw_whips_between_bearings, coupling_taken_apart_and_put_on_turned),
    "encoder_interpolation": (corrected_only_by_long_moves, head_turned_by_load_of_carriage),
    "axis_coupling": (cable_of_other_becomes_taut, held_back_when_other_has_longer_way),
    "servo_settling": (hunts_about_its_place, declared_there_within_a_window),
    "drive_scale": (wrong_zero_until_homed_again, counts_lost_in_fast_moves),
}  # fmt: skip
