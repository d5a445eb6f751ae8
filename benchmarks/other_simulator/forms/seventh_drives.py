"""Forms of effects of drives, of the seventh archive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.drives import SETTLING_M, next_drive
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import pause_before_s
from benchmarks.other_simulator.forms.screws import GROWTH_M, PERIODIC_M, draw_lead, draw_pitch, of_pitch
from benchmarks.other_simulator.forms.seventh_traces import (
    heat_below_carriage,
    of_each,
    phases_of_visits,
    walked_line,
)
from benchmarks.other_simulator.forms.shapes import (
    bump,
    draw_instant,
    draw_phase,
    draw_sign,
    load_share,
    normalised,
    since,
    wave,
)
from benchmarks.other_simulator.forms.traces import draw_breaks
from benchmarks.other_simulator.scene import Scene

Array = NDArray[np.float64]
Generator = np.random.Generator

PINION_TURN_M, MAGNETS_M, GROUND_M = (0.06, 0.3), (0.12, 0.4), (0.06, 0.15)
PULLEY_RATIOS = (1.25, 1.5, 1.6, 2.5)
HUNTING_S = (5.0, 15.0)


@form(GROWTH_M)
def nut_warms_where_it_runs(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The nut warms the stretch of the screw that it runs over, and what has grown below the carriage lifts it."""
    return Contribution(drive_m=heat_below_carriage(scene.rows, drive, rng.uniform(10, 40)))


@form(GROWTH_M)
def holding_current_warms_foot(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The current that holds the load, at rest as well, warms the motor and the end of the screw next to it."""
    rows, reach = scene.rows, rng.uniform(0.3, 0.8)
    warmth = lagging(rows.t_s, load_share(scene, drive) ** 2, rng.uniform(8, 30) * 60)
    grown = 1 - np.exp(-(rows.raised[:, drive] + 0.15) / reach)
    return Contribution(drive_m=normalised(warmth - warmth.min()) * grown)


@form()
def eccentric_pinion(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The pinion runs out, so that its play on the rack varies with each of its turns."""
    turn = wave(scene.rows.drives_m[:, drive], rng.uniform(*PINION_TURN_M), draw_phase(rng))
    return Contribution(drive_m=-0.5 * scene.rows.side[:, drive] * (0.55 + 0.45 * turn))


@form()
def preloaded_nut_comes_loose(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The lock nut of a preloaded double nut works loose at a moment, and play is there at once."""
    step_s = draw_instant(scene.rows, rng)
    return Contribution(drive_m=-0.5 * scene.rows.side[:, drive] * since(scene.rows, step_s), step_s=step_s)


@form()
def seals_stick_after_pauses(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Wipers and seals stick the more the longer the drive stood before, and wind up the drive train."""
    rows = scene.rows
    stuck = 0.25 + 0.75 * (1 - np.exp(-pause_before_s(rows) / rng.uniform(40, 150)))
    return Contribution(drive_m=-rows.side[:, drive] * stuck)


@form()
def cover_plates_drag(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A telescopic cover drags, with more of its plates the further it is pushed together, and springs back."""
    place, plates, way = scene.rows.raised[:, drive], int(rng.integers(3, 7)), draw_sign(rng)
    pushed = place if way > 0 else 1 - place
    dragging = 0.3 + 0.7 * np.ceil(pushed * plates) / plates
    return Contribution(drive_m=-scene.rows.side[:, drive] * dragging - 0.4 * way * pushed)


@form()
def lead_walks_over_ground_lengths(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The screw was ground in short lengths, each with a small error of lead of its own, which add up."""
    return Contribution(drive_m=walked_line(scene.rows.drives_m[:, drive], rng.uniform(*GROUND_M), rng))


@form()
def tape_drawn_in_at_its_clamp(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The scale's steel tape is strained near the clamp at one of its ends, and less and less away from it."""
    place = scene.rows.raised[:, drive]
    from_clamp = place if rng.random() < 0.5 else 1 - place
    return Contribution(drive_m=draw_sign(rng) * np.exp(-from_clamp / rng.uniform(0.12, 0.3)))


@form(PERIODIC_M)
def screw_and_pulley_beat(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Screw and motor pulley both run out, at turns that the belt's ratio sets apart."""
    place_m, lead_m = scene.rows.drives_m[:, drive], draw_lead(scene, drive, rng)
    of_motor_m = lead_m / float(rng.choice(PULLEY_RATIOS))
    error = 0.7 * wave(place_m, lead_m, draw_phase(rng)) + 0.6 * wave(place_m, of_motor_m, draw_phase(rng))
    return Contribution(drive_m=error, period_m=lead_m)


@form(PERIODIC_M)
def wobble_lags_on_either_side(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The thrust bearing's shoulder wobbles once a turn, and is felt a little later on the way from either side."""
    lead_m, lag_rad = draw_lead(scene, drive, rng), rng.uniform(0.3, 0.9)
    turn = 2 * np.pi * scene.rows.drives_m[:, drive] / lead_m
    return Contribution(
        drive_m=np.sin(turn + draw_phase(rng) - lag_rad * scene.rows.side[:, drive]), period_m=lead_m
    )  # fmt: skip


@form()
def amplifier_clips_signals(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The amplifier of the encoder's two signals clips their peaks, and the angle between them comes out wrong."""
    pitch_m, limit = draw_pitch(scene, drive, rng), rng.uniform(0.75, 0.92)
    phase = 2 * np.pi * scene.rows.drives_m[:, drive] / pitch_m + draw_phase(rng)
    read = np.arctan2(np.clip(np.sin(phase), -limit, limit), np.clip(np.cos(phase), -limit, limit))
    return of_pitch(normalised(np.angle(np.exp(1j * (read - phase)))), pitch_m)


@form()
def smear_weakens_one_signal(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A smear of oil on a stretch of the scale weakens one of the two signals there."""
    pitch_m, place = draw_pitch(scene, drive, rng), scene.rows.centred[:, drive]
    phase = 2 * np.pi * scene.rows.drives_m[:, drive] / pitch_m + draw_phase(rng)
    smeared = 0.15 + 0.85 * bump(place, rng.uniform(-0.6, 0.6), rng.uniform(0.3, 0.7))
    return of_pitch(smeared * (0.9 * np.sin(2 * phase) + 0.3 * np.sin(phase + 1)), pitch_m)


@form()
def taut_cable_of_other(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The other drive's cable is taut beyond some place of its travel, and pulls at this one from there on."""
    place = draw_sign(rng) * scene.rows.centred[:, next_drive(scene, drive)]
    return Contribution(drive_m=np.maximum(place - rng.uniform(-0.3, 0.3), 0))


@form()
def stray_field_of_other_magnets(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The magnets that move with the other drive disturb this one's encoder with their stray field as they pass."""
    place_m = scene.rows.drives_m[:, next_drive(scene, drive)]
    field = wave(place_m, rng.uniform(*MAGNETS_M), draw_phase(rng))
    return Contribution(drive_m=field * (0.7 + 0.3 * draw_sign(rng) * scene.rows.centred[:, drive]))


@form(SETTLING_M)
def settles_later_with_payload(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The position loop was tuned without a payload, and takes the longer to settle the more is carried."""
    rows = scene.rows
    tau_s = rng.uniform(0.8, 1.8) * (1 + rows.payload_kg / 50)
    left = np.exp(-rows.dwell_s / tau_s) * np.minimum(rows.speed_m_per_s, 0.3) / 0.15
    return Contribution(drive_m=-rows.side[:, drive] * left * ~rows.moving)


@form()
def hunts_about_its_place_otherwise(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Stiction and integral action make the drive hunt: it jumps to and fro about its place and never rests on it."""
    rows = scene.rows
    swing = np.sin(2 * np.pi * rows.dwell_s / rng.uniform(*HUNTING_S) + phases_of_visits(rows, rng))
    return Contribution(drive_m=np.tanh(2.5 * swing) * ~rows.moving)


@form()
def homed_anew_after_breaks(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The drive is homed anew after each break, and its switch does not trip at the same place again."""
    breaks, first_s = draw_breaks(scene.rows, rng)
    zeros = of_each(breaks, rng.normal(size=breaks.max() + 1))
    return Contribution(drive_m=normalised(zeros), step_s=first_s)


@form()
def measuring_wheel_slips(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The encoder's friction wheel slips more one way than the other, and loses its zero with the way that it runs."""
    way_m = scene.rows.way_m[:, drive]
    return Contribution(drive_m=draw_sign(rng) * (way_m - way_m[0]) / max(np.ptp(way_m), 1e-9))


FORMS: dict[str, tuple[Form, ...]] = {
    "screw_thermal_growth": (nut_warms_where_it_runs, holding_current_warms_foot),
    "backlash": (eccentric_pinion, preloaded_nut_comes_loose),
    "friction_windup": (seals_stick_after_pauses, cover_plates_drag),
    "screw_cumulative_error": (lead_walks_over_ground_lengths, tape_drawn_in_at_its_clamp),
    "screw_periodic_error": (screw_and_pulley_beat, wobble_lags_on_either_side),
    "encoder_interpolation": (amplifier_clips_signals, smear_weakens_one_signal),
    "axis_coupling": (taut_cable_of_other, stray_field_of_other_magnets),
    "servo_settling": (settles_later_with_payload, hunts_about_its_place_otherwise),
    "drive_scale": (homed_anew_after_breaks, measuring_wheel_slips),
}
