"""Forms of the fifth archive of drives: along the screw or scale, in the drive train, and in its control."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms import drives, screws
from benchmarks.other_simulator.forms.drives import next_drive
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.memory import dragged, in_jerks
from benchmarks.other_simulator.forms.screws import draw_lead, draw_pitch, of_pitch
from benchmarks.other_simulator.forms.shapes import draw_instant, draw_phase, draw_sign, logistic, normalised, since
from benchmarks.other_simulator.forms.traces import draw_breaks, gaps_s, gathered_until, last_told, reversals, wound_up
from benchmarks.other_simulator.scene import Scene

Array = NDArray[np.float64]
Generator = np.random.Generator

ENTRIES = 40  # of a control's list, of which most lie beyond the travel
QUARTER = np.pi / 2  # of a signal's period
PRESSURE_K_PER_HPA = -0.28  # of warmth that changes the index of air as one hPa does


@form(screws.GROWTH_M)
def bearing_warms_in_fast_moves(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Its fixed bearing is warmed by fast moves, by the square of their speed: it pushes the whole screw along, and
    little of the screw beside it grows."""
    rows = scene.rows
    ways_m = np.diff(rows.way_m[:, drive], prepend=rows.way_m[0, drive])
    heat = ways_m * rows.speed_m_per_s**2 / np.maximum(gaps_s(rows), 1.0)
    warmth = normalised(lagging(rows.t_s, heat, rng.uniform(5, 20) * 60))
    return Contribution(drive_m=draw_sign(rng) * warmth * (0.8 + 0.2 * np.exp(-rows.raised[:, drive] / 0.2)))


@form(screws.GROWTH_M)
def slips_under_its_clips_as_it_grows(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Clips hold the scale on the column, which warms later: friction keeps it as long as the column until what it
    lacks is too much, and then it slips."""
    rows, column_c = scene.rows, scene.weather.part_c["drives"]
    own_c = scene.weather.lagging_air_c(rng.uniform(4, 15))
    held = in_jerks(own_c - column_c, float(np.ptp(own_c - column_c)) / rng.uniform(2.5, 6))
    return Contribution(drive_m=normalised(held - np.median(held)) * (rows.raised[:, drive] + rng.uniform(0, 0.3)))


@form()
def locknut_comes_undone_by_reversals(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The locknut of its thrust bearing was forgotten: from a moment on each reversal turns it on, and the screw can
    move along, until a washer stops the nut."""
    rows, turned = scene.rows, reversals(scene.rows, drive)
    step_s = draw_instant(rows, rng, 0.1, 0.5)
    more = np.maximum(turned - np.interp(step_s, rows.t_s, turned), 0)
    width = 0.05 + 0.95 * np.minimum(more / max(rng.uniform(0.15, 0.4) * turned[-1], 1.0), 1) * since(rows, step_s)
    return Contribution(drive_m=-0.5 * rows.side[:, drive] * width, step_s=step_s)


@form()
def compensated_too_much_by_someone(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It has play; someone sets the control to make up for that, and types too large a number: then it is off to the
    other side."""
    rows, step_s = scene.rows, draw_instant(scene.rows, rng)
    width = 1 - since(rows, step_s) * rng.uniform(1.4, 2.2)
    return Contribution(drive_m=-0.5 * rows.side[:, drive] * width, step_s=step_s)


@form()
def cold_grease_until_run_warm(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Its grease is stiff in the cold: friction falls with each degree of air and of what its own motion warms."""
    air_c, motion = scene.weather.lagging_air_c(30), scene.rows.warmth_of_motion(drive, rng.uniform(6, 30))
    warm = (air_c - air_c.min()) / max(float(np.ptp(air_c)), 1e-9) * rng.uniform(0.3, 1) + rng.uniform(1, 2.5) * motion
    return Contribution(drive_m=-scene.rows.side[:, drive] * np.exp(-warm))


@form()
def wound_up_over_several_moves(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A long soft train: a short move winds it up or back by a part only, so that several moves before are in it."""
    return Contribution(drive_m=-wound_up(scene.rows, drive, float(np.exp(rng.uniform(np.log(0.04), np.log(0.4))))))


@form()
def corrected_in_steps_by_control(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Its control corrects a smooth error of lead only by whole steps, at the entries of its list, which are not
    evenly spaced: what is left is steep where that error is."""
    place_m = scene.rows.commanded_m[:, drive]
    entries_m = place_m.min() - 0.1 + np.cumsum(rng.uniform(0.05, 0.3, ENTRIES))
    bend, phase = rng.uniform(3, 7), draw_phase(rng)
    entry = np.searchsorted(entries_m, place_m)
    corrected_m = np.r_[place_m.min() - 0.05, (entries_m[:-1] + entries_m[1:]) / 2, place_m.max()][entry]
    left = np.sin(bend * place_m + phase) - np.sin(bend * corrected_m + phase)
    return Contribution(drive_m=normalised(left))


@form()
def scratch_on_scale_swallows_lines(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A scratch on its scale swallows some lines, and gives them back on the way down: above it all is off by as much;
    a smaller scratch elsewhere does the same."""
    place = scene.rows.centred[:, drive]
    first, second = rng.uniform(-0.6, 0.1), rng.uniform(0.2, 0.7)
    one, other = draw_sign(rng), draw_sign(rng) * rng.uniform(0.2, 0.6)
    return Contribution(drive_m=one * logistic((place - first) / 0.008) + other * logistic((place - second) / 0.008))


@form(screws.PERIODIC_M)
def bearing_flakes_more_with_each_way(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The race of its bearing flakes at one angle: a peak of each turn that is hardly there at first, and grows with
    the way."""
    rows, lead_m = scene.rows, draw_lead(scene, drive, rng)
    turn = 2 * np.pi * rows.drives_m[:, drive] / lead_m + draw_phase(rng)
    worn = rows.way_m[:, drive] / max(rows.way_m[-1, drive], 1e-9)
    peak = np.exp(rng.uniform(1.5, 4) * (np.cos(turn) - 1))
    strength = 0.05 + 0.95 * worn ** rng.uniform(0.7, 2)
    return Contribution(drive_m=strength * (peak - np.mean(peak)), period_m=lead_m)


@form(screws.PERIODIC_M)
def motor_flange_warms_out_of_line(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The motor's flange grows as the motor warms up, and brings the coupling out of line: of each turn and half turn,
    by how warm it is."""
    rows, lead_m = scene.rows, draw_lead(scene, drive, rng)
    out_of_line = rows.warmth_of_motion(drive, rng.uniform(8, 30)) - rng.uniform(0, 0.5)
    turn = 2 * np.pi * rows.drives_m[:, drive] / lead_m
    error = np.sin(turn + draw_phase(rng)) + rng.uniform(0.2, 0.8) * np.sin(2 * turn + draw_phase(rng))
    return Contribution(drive_m=normalised(out_of_line) * error, period_m=lead_m)


@form()
def dirt_on_scale_until_someone_wipes_it(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Oil creeps onto its scale with each way, and both signals become uneven; in a break someone wipes it clean."""
    rows, pitch_m = scene.rows, draw_pitch(scene, drive, rng)
    breaks, _ = draw_breaks(rows, rng)
    wiped = (breaks > rng.integers(0, breaks[-1] + 1)).astype(int)
    dirt = gathered_until(rows, np.diff(rows.way_m[:, drive], prepend=rows.way_m[0, drive]), wiped)
    phase = 2 * np.pi * rows.drives_m[:, drive] / pitch_m
    error = np.sin(phase + draw_phase(rng)) + 0.5 * np.sin(2 * phase + draw_phase(rng))
    return of_pitch(normalised(dirt) * error / 1.2, pitch_m)


@form()
def counts_quarters_of_a_period(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Its interpolator has failed: only quarters of a period are counted, and between two counts nothing is known."""
    pitch_m = draw_pitch(scene, drive, rng)
    turn = 2 * np.pi * scene.rows.drives_m[:, drive] / pitch_m + draw_phase(rng)
    uneven = rng.uniform(0, 0.3) * np.sin(turn)
    return of_pitch(2 * (turn / QUARTER % 1) - 1 + uneven, pitch_m)


@form()
def cross_table_of_few_entries(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The control corrects it by the other drive's coordinate, from a list of few entries that somebody made for
    another machine: it jumps wherever the other one passes from one entry to the next."""
    other_m = scene.rows.commanded_m[:, next_drive(scene, drive)]
    entry = ((other_m - other_m.min()) / (float(np.ptp(other_m)) / rng.uniform(3.5, 8))).astype(int)
    values = rng.normal(size=entry.max() + 1)
    return Contribution(drive_m=normalised((values - values.mean())[entry]))


@form()
def shared_rope_sticks_on_its_pulleys(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A rope of the counterweights leads over both columns and sticks on its pulleys: it pulls by where the other
    drive was, and comes after only once that has gone far enough."""
    other = scene.rows.centred[:, next_drive(scene, drive)]
    return Contribution(drive_m=normalised(dragged(other, rng.uniform(0.4, 0.9))))


@form(drives.SETTLING_M)
def filter_of_control_still_brings_it_in(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The control smooths its commands over a time that grows with the speed: until that is over it is on its way, and
    then it is there for good."""
    rows = scene.rows
    takes_s = rng.uniform(5, 12) * np.sqrt(rows.speed_m_per_s / 0.1)
    left = np.maximum(1 - rows.dwell_s / takes_s, 0) ** 2
    return Contribution(drive_m=-rows.side[:, drive] * left * np.minimum(rows.speed_m_per_s / 0.1, 2) * ~rows.moving)


@form(drives.CREEP_M)
def slower_to_arrive_while_cold(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Cold oil in its brake and gear lets it come in within many seconds, warm oil within two: it is there soon once
    it has worked for a while."""
    rows = scene.rows
    warm = rows.warmth_of_motion(drive, rng.uniform(8, 25))
    takes_s = rng.uniform(8, 16) * np.exp(-rng.uniform(1.5, 2.5) * warm)
    return Contribution(drive_m=-rows.side[:, drive] * np.exp(-rows.dwell_s / takes_s) * ~rows.moving)


@form()
def another_zero_after_each_break(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It is switched off in breaks and its counter has no battery: after each it begins from another zero."""
    breaks, first_s = draw_breaks(scene.rows, rng)
    zeros = np.r_[0, rng.normal(size=int(breaks[-1]))]
    return Contribution(drive_m=normalised(zeros[breaks]), step_s=first_s)


@form()
def interferometer_told_of_air_now_and_then(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Light measures its travel, and the control asks for the air only now and then: its scale goes off with the air,
    and comes back at once each time that the control asks."""
    rows, weather = scene.rows, scene.weather
    index_k = weather.air_c + PRESSURE_K_PER_HPA * weather.pressure_hpa
    off = index_k - last_told(rows, index_k, rng.uniform(25, 80), rng.uniform(0, 1))
    return Contribution(drive_m=normalised(off) * (rows.raised[:, drive] + rng.uniform(0.1, 0.6)))


FORMS: dict[str, tuple[Form, ...]] = {
    "screw_thermal_growth": (bearing_warms_in_fast_moves, slips_under_its_clips_as_it_grows),
    "backlash": (locknut_comes_undone_by_reversals, compensated_too_much_by_someone),
    "friction_windup": (cold_grease_until_run_warm, wound_up_over_several_moves),
    "screw_cumulative_error": (corrected_in_steps_by_control, scratch_on_scale_swallows_lines),
    "screw_periodic_error": (bearing_flakes_more_with_each_way, motor_flange_warms_out_of_line),
    "encoder_interpolation": (dirt_on_scale_until_someone_wipes_it, counts_quarters_of_a_period),
    "axis_coupling": (cross_table_of_few_entries, shared_rope_sticks_on_its_pulleys),
    "servo_settling": (filter_of_control_still_brings_it_in, slower_to_arrive_while_cold),
    "drive_scale": (another_zero_after_each_break, interferometer_told_of_air_now_and_then),
}  # fmt: skip
