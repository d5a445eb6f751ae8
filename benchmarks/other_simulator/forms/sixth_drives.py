"""Forms of the sixth archive of drives: along the screw or scale, in the drive train, and in its control."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms import drives, screws
from benchmarks.other_simulator.forms.drives import next_drive
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import draw_mountings, new_visit, of_former_visit
from benchmarks.other_simulator.forms.screws import draw_lead, draw_pitch, of_pitch
from benchmarks.other_simulator.forms.shapes import bump, draw_phase, draw_sign, load_share, normalised
from benchmarks.other_simulator.forms.traces import draw_after_break, draw_stretches, gaps_s
from benchmarks.other_simulator.scene import Scene

Array = NDArray[np.float64]
Generator = np.random.Generator

PIECES = 40  # of a screw or a guide, each with a former life of its own
SPREAD = 5  # pieces of a screw through which heat passes one after the other
LONGEST_REST_S = 120.0


@form(screws.GROWTH_M)
def warmed_by_what_it_lifts(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Lifting a load warms the nut's friction and with it the screw; going down the load helps and makes no heat."""
    rows, place_m = scene.rows, scene.rows.commanded_m[:, drive]
    lifted_m = np.maximum(place_m - of_former_visit(rows, place_m), 0) * new_visit(rows)
    heat = lifted_m * np.abs(load_share(scene, drive)) ** rng.uniform(1, 2) / np.maximum(gaps_s(rows), 1.0)
    warmth = normalised(lagging(rows.t_s, heat, rng.uniform(12, 40) * 60))
    return Contribution(drive_m=warmth * (rows.raised[:, drive] + rng.uniform(0, 0.4)))


@form(screws.GROWTH_M)
def heat_creeps_along_it_from_motor(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The motor's heat passes along the screw from piece to piece: its near end is warm while the far one is still
    cold, and in a rest that follows the far end goes on growing."""
    rows, tau_s, keeps = scene.rows, rng.uniform(5, 18) * 60, rng.uniform(0.7, 0.95)
    from_motor = rows.raised[:, drive] if rng.random() < 0.5 else 1 - rows.raised[:, drive]
    pieces = [rows.warmth_of_motion(drive, rng.uniform(3, 8))]
    for _ in range(SPREAD - 1):
        pieces.append(keeps * lagging(rows.t_s, pieces[-1], tau_s))
    ends, grown = np.linspace(0, 1, SPREAD + 1), np.cumsum([np.zeros(len(rows)), *pieces], 0)
    growth = [np.interp(place, ends, grown[:, k]) for k, place in enumerate(from_motor)]
    return Contribution(drive_m=draw_sign(rng) * normalised(np.array(growth)))


@form()
def compensated_but_not_after_short_moves(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The control makes up for its play only on moves that are long enough to be sure of their direction: after a
    short one all of the play is left."""
    place_m = scene.rows.commanded_m[:, drive]
    moved_m = place_m - of_former_visit(scene.rows, place_m)
    short = np.exp(-((moved_m / rng.uniform(0.05, 0.2)) ** 2))
    return Contribution(drive_m=-0.5 * scene.rows.side[:, drive] * (0.1 + 0.9 * short))


@form()
def shaken_down_while_neighbour_works(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Friction keeps it on the flank that it came with; while a neighbour shakes the floor it sinks through its play
    by its weight, from whichever side it comes."""
    shaken = draw_stretches(scene.rows, (2, 5), (0.08, 0.25), rng)
    return Contribution(drive_m=-0.5 * np.where(shaken > 0, 1.0, scene.rows.side[:, drive]))


@form()
def brake_drags_at_times(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Its brake does not open wholly for some stretches, each time by another gap, and then frees itself."""
    rows = scene.rows
    dragging = draw_stretches(rows, (2, 6), (0.06, 0.22), rng)
    begun = np.cumsum(np.diff(dragging, prepend=0.0) > 0)
    tight = rng.uniform(0.5, 1, int(begun[-1]) + 1)[begun]
    return Contribution(drive_m=-rows.side[:, drive] * (0.08 + 0.92 * dragging * tight))


@form()
def dry_where_it_has_not_been_lately(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Each pass leaves oil on the piece of the guide that it goes over, and that runs off: friction winds it up where
    it has not been for a while, and hardly where it has just been."""
    rows, tau_s = scene.rows, rng.uniform(4, 25) * 60
    pieces, since_s = np.linspace(0, 1, PIECES), np.full(PIECES, tau_s)
    place, first, gaps = rows.raised[:, drive], new_visit(rows), gaps_s(rows)
    dry, out = 0.5, np.zeros(len(rows))
    for k in range(len(rows)):
        since_s += gaps[k]
        if first[k]:
            dry = 1 - np.exp(-np.interp(place[k], pieces, since_s) / tau_s)
            low, high = sorted((place[k - 1], place[k]))
            since_s[(pieces >= low - 1 / PIECES) & (pieces <= high + 1 / PIECES)] = 0
        out[k] = dry
    return Contribution(drive_m=-rows.side[:, drive] * (0.1 + 0.9 * out))


@form()
def compensated_over_middle_of_travel_only(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The control's list ends before the travel does, and its last entry is held on both sides: right in the middle,
    and off by all that the lead changes beyond."""
    place, low, high = scene.rows.centred[:, drive], -rng.uniform(0.1, 0.6), rng.uniform(0.1, 0.6)
    bend, phase = rng.uniform(2, 5), draw_phase(rng)
    left = np.sin(bend * place + phase) - np.sin(bend * np.clip(place, low, high) + phase)
    return Contribution(drive_m=normalised(left))


@form()
def pressed_in_where_it_rests_under_load(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A screw that is too soft: balls press themselves in where the nut rests, more the longer and the more it holds;
    its lead gets worse at these places as the campaign goes on."""
    rows, width, load = scene.rows, rng.uniform(0.06, 0.16), np.abs(load_share(scene, drive)) ** rng.uniform(1, 3)
    pieces, pressed, out = np.linspace(-1, 1, PIECES), np.zeros(PIECES), np.zeros(len(rows))
    rested_s = np.minimum(gaps_s(rows), LONGEST_REST_S)
    for k, place in enumerate(rows.centred[:, drive]):
        pressed += bump(pieces, place, width) * load[k] * rested_s[k]
        out[k] = np.interp(place, pieces, pressed)
    return Contribution(drive_m=-normalised(out))


@form(screws.PERIODIC_M)
def motor_aligned_by_someone_in_a_break(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The motor sits beside the screw's line; in a break someone aligns it, and less is left, of another phase."""
    rows, lead_m = scene.rows, draw_lead(scene, drive, rng)
    after, _, step_s = draw_after_break(rows, rng)
    turn = 2 * np.pi * rows.drives_m[:, drive] / lead_m
    first = np.sin(turn + draw_phase(rng)) + rng.uniform(0.1, 0.5) * np.sin(2 * turn + draw_phase(rng))
    left = rng.uniform(0.05, 0.3) * np.sin(turn + draw_phase(rng))
    return Contribution(drive_m=np.where(after, left, first), period_m=lead_m, step_s=step_s)


@form(screws.PERIODIC_M)
def cage_of_bearing_goes_round_slower(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """One ball of its thrust bearing is too large: the error goes with the cage, which needs more than two turns of
    the screw for one of its own, and slips a little."""
    rows, lead_m = scene.rows, draw_lead(scene, drive, rng)
    period_m = float(np.clip(lead_m / rng.uniform(0.38, 0.46), *screws.LEAD_M))
    slipped = rng.uniform(0.2, 2) * rows.way_m[:, drive] / max(rows.way_m[-1, drive], 1e-9)
    turn = 2 * np.pi * rows.drives_m[:, drive] / period_m + draw_phase(rng) + slipped
    return Contribution(drive_m=np.sin(turn) * (0.5 + 0.5 * np.abs(load_share(scene, drive))), period_m=period_m)


@form()
def signals_learnt_at_another_warmth(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Its signals were adjusted once, at one temperature: right at that, and off one way when it is warmer and the
    other way when it is colder."""
    rows, weather, pitch_m = scene.rows, scene.weather, draw_pitch(scene, drive, rng)
    head_c = weather.lagging_air_c(rng.uniform(5, 20)) + rng.uniform(0.3, 2) * rows.warmth_of_motion(drive, 10)
    away = normalised(head_c - np.quantile(head_c, rng.uniform(0, 1)))
    phase = 2 * np.pi * rows.drives_m[:, drive] / pitch_m
    error = np.sin(phase + draw_phase(rng)) + rng.uniform(0.2, 0.8) * np.sin(2 * phase + draw_phase(rng))
    return of_pitch(away * error / 1.3, pitch_m)


@form()
def poles_magnetised_unequally(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A magnetic scale whose poles are not equally strong: within each period the error is a sine, and from one to
    the next it is larger, smaller or turned round."""
    pitch_m = draw_pitch(scene, drive, rng)
    along = (scene.rows.drives_m[:, drive] + rng.uniform(0, pitch_m)) / pitch_m
    pole = np.floor(along).astype(int)
    strength = np.clip(0.7 + 0.7 * rng.normal(size=int(np.ptp(pole)) + 1), -1, 2)[pole - pole.min()]
    return of_pitch(strength * np.sin(2 * np.pi * along) / 1.5, pitch_m)


@form()
def bed_bends_by_place_and_load_of_other(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A bed that is too thin: the other drive's carriage bends it by where that stands, the more it holds there, and
    this drive's scale is carried along."""
    other = next_drive(scene, drive)
    holds = load_share(scene, other) ** 2
    place = scene.rows.centred[:, other] - rng.uniform(-0.5, 0.5)
    return Contribution(drive_m=normalised(place * (0.1 + holds)))


@form()
def motors_pull_at_each_other_when_level(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The magnets of two linear motors attract one another: nothing while they are far apart, towards the other one
    when that is near, and nothing again when both are level."""
    place_m = scene.rows.commanded_m
    apart = place_m[:, drive] - place_m[:, next_drive(scene, drive)]
    off = (apart - np.quantile(apart, rng.uniform(0.3, 0.7))) / (rng.uniform(0.2, 0.5) * apart.std())
    return Contribution(drive_m=-off * np.exp(0.5 - 0.5 * off**2))


@form(drives.SETTLING_M)
def short_of_torque_on_its_way_up(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The limit of its current is set too low: coming from below with much to hold it closes up only slowly, with
    little to hold at once; from above it is there."""
    rows = scene.rows
    takes_s = rng.uniform(1, 3) * (1 + rng.uniform(2, 5) * load_share(scene, drive) ** 2)
    left = np.exp(-rows.dwell_s / takes_s) * np.sqrt(rows.speed_m_per_s / 0.1)
    return Contribution(drive_m=np.where(rows.side[:, drive] > 0, -left, 0.0) * ~rows.moving)


@form(drives.CREEP_M)
def corrected_at_next_tick_of_slow_loop(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """An outer loop reads its scale every few seconds by its own clock and corrects most of what is left: how long it
    is off after arriving depends on when the next tick comes, not on how long it rests."""
    rows, every_s, first = scene.rows, rng.uniform(6, 25), rng.uniform(0, 1)
    ticks = np.floor(rows.t_s / every_s + first) - np.floor((rows.t_s - rows.dwell_s) / every_s + first)
    visits = int(rows.visit.max()) + 1
    anywhere = (rng.uniform(0.4, 1, visits) * rng.choice([-1.0, 1.0], visits))[rows.visit]
    return Contribution(drive_m=anywhere * rng.uniform(0.05, 0.3) ** np.maximum(ticks, 0) * ~rows.moving)


@form()
def offset_set_with_each_payload(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Whoever mounts a payload calls up its offset, and one axis is in that too: each payload has a zero of its own,
    the same whenever it is mounted."""
    rows, (mounting, first_s) = scene.rows, draw_mountings(scene.rows, rng)
    which = rows.payload if len(np.unique(rows.payload)) > 1 else mounting % 2
    zeros = rng.uniform(0.4, 1, int(which.max()) + 1) * rng.choice([-1, 1])
    zeros[1::2] *= -1
    return Contribution(drive_m=(zeros - zeros[which[0]])[which] / 2, step_s=first_s)


@form()
def counts_one_more_at_each_pass_of_mark(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A damaged reference mark: each time that it passes it fast the counter takes up one count too many, whichever
    way it goes; while it works elsewhere its zero stays."""
    rows, place = scene.rows, scene.rows.centred[:, drive]
    mark, fast = rng.uniform(-0.6, 0.6), np.quantile(rows.speed_m_per_s, rng.uniform(0.2, 0.6))
    passed = (place > mark) != (of_former_visit(rows, place) > mark)
    counts = np.cumsum(new_visit(rows) & passed & (rows.speed_m_per_s >= fast))
    return Contribution(drive_m=draw_sign(rng) * counts / max(int(counts[-1]), 1))


FORMS: dict[str, tuple[Form, ...]] = {
    "screw_thermal_growth": (warmed_by_what_it_lifts, heat_creeps_along_it_from_motor),
    "backlash": (compensated_but_not_after_short_moves, shaken_down_while_neighbour_works),
    "friction_windup": (brake_drags_at_times, dry_where_it_has_not_been_lately),
    "screw_cumulative_error": (compensated_over_middle_of_travel_only, pressed_in_where_it_rests_under_load),
    "screw_periodic_error": (motor_aligned_by_someone_in_a_break, cage_of_bearing_goes_round_slower),
    "encoder_interpolation": (signals_learnt_at_another_warmth, poles_magnetised_unequally),
    "axis_coupling": (bed_bends_by_place_and_load_of_other, motors_pull_at_each_other_when_level),
    "servo_settling": (short_of_torque_on_its_way_up, corrected_at_next_tick_of_slow_loop),
    "drive_scale": (offset_set_with_each_payload, counts_one_more_at_each_pass_of_mark),
}  # fmt: skip
