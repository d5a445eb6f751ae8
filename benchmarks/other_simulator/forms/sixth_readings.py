"""Forms of the sixth archive of the station, of reflectors, and of what is stated of the rig as a whole."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms import rig, station
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import draw_mountings
from benchmarks.other_simulator.forms.memory import since_change_s, switched_over
from benchmarks.other_simulator.forms.rig import delayed
from benchmarks.other_simulator.forms.shapes import (
    draw_direction,
    draw_sign,
    level_direction,
    normalised,
    sight_of,
    with_platform,
)
from benchmarks.other_simulator.forms.traces import draw_after_break, draw_breaks, gaps_s
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.station import across_sight
from benchmarks.other_simulator.tables import corrections_of, newest

Array = NDArray[np.float64]
Generator = np.random.Generator


@form()
def switched_off_in_breaks_and_cold_after(scene: Scene, place: int, rng: Generator) -> Contribution:
    """To spare its battery it is switched off in breaks: its head has cooled, and moves back as it warms up again,
    the more so the colder it was."""
    breaks, first_s = draw_breaks(scene.rows, rng)
    colder = np.r_[0, rng.uniform(0.4, 1, int(breaks[-1]))][breaks]
    cold = colder * np.exp(-since_change_s(scene.rows, breaks) / (rng.uniform(8, 35) * 60))
    turn, shift = rng.normal(size=3) * [0.25, 0.25, 0.5], rng.normal(size=3) * [0.3, 0.3, 0.8]
    return Contribution(station_rad=0.5 * np.outer(cold, turn), station_m=0.7 * np.outer(cold, shift), step_s=first_s)


@form()
def wooden_legs_turn_with_moisture(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Legs of wood that is grown in a twist turn its head as they take up and give off moisture, hours in arrear."""
    moisture = lagging(scene.rows.t_s, scene.weather.humidity_percent, rng.uniform(15, 70) * 60)
    course = normalised(moisture - moisture[0])
    axis = np.array([*rng.normal(size=2) * 0.12, draw_sign(rng)])
    lift = 0.2 * rng.uniform(0, 1) * np.outer(course, station.UP)
    return Contribution(station_rad=0.35 * np.outer(course, axis), station_m=lift)


@form(station.READ_WRONG)
def warmer_air_before_machine_only(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The thermometer stands by the station; the last part of each way leads through air that the machine's own work
    has warmed, so that what stands deeper in it is read shorter, by more than in proportion."""
    rows, (sight, distances) = scene.rows, sight_of(scene)
    tau_min, drives = rng.uniform(8, 30), len(scene.machine.drives)
    warmth = 0.15 + np.mean([rows.warmth_of_motion(drive, tau_min) for drive in range(drives)], 0)
    within = np.maximum(distances - rng.uniform(0.5, 0.75) * distances[rows.off_floor].min(), 0)
    return Contribution(sights_m=-sight * (2 * within * normalised(warmth))[:, None])


@form(station.CURVATURE_PER_M)
def warm_payload_lets_air_rise(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Payloads come warm from an oven: until they have cooled air rises from them, and what is seen through it, the
    upper reflectors of the platform most, is bent up and trembles aside."""
    rows, (sight, distances), (mounting, _) = scene.rows, sight_of(scene), draw_mountings(scene.rows, rng)
    mounted = (mounting > 0) & (rows.payload > 0 if rows.payload.max() > 0 else True)
    warm = mounted * np.exp(-since_change_s(rows, mounting) / (rng.uniform(8, 30) * 60))
    upper = scene.reflectors_m[:, 1] / scene.platform_reach_m
    bent = warm * np.exp(1.5 * upper) * rows.on_platform * distances**2 / 8
    trembles = 0.3 * rng.normal(size=len(rows))
    return Contribution(
        sights_m=np.outer(bent, station.UP) + across_sight(sight, distances) * (bent * trembles)[:, None]
    )


@form()
def put_back_on_burr_and_shaken_down(scene: Scene, smr: int, rng: Generator) -> Contribution:
    """In a break someone takes it out to clean it and puts it back on a burr: moves shake it down to its place again,
    but for a part."""
    rows, way_m = scene.rows, scene.rows.way_m.max(1)
    after, begin_s, step_s = draw_after_break(rows, rng)
    moved_m = np.maximum(way_m - np.interp(begin_s, rows.t_s, way_m), 0)
    stays = rng.uniform(0.05, 0.4)
    off = after * (stays + (1 - stays) * np.exp(-moved_m / max(rng.uniform(0.04, 0.2) * way_m[-1], 1e-9)))
    shift = scene.calm.rotations @ draw_direction(rng)
    return Contribution(points_m=shift * (off * (rows.smr == smr))[:, None], step_s=step_s)


@form()
def hose_catches_it_and_slips_off(scene: Scene, smr: int, rng: Generator) -> Contribution:
    """A hose catches its holder and pulls it aside, further with each way, until it slips off: it springs back, but
    not quite, and is caught again."""
    rows, way_m = scene.rows, scene.rows.way_m.max(1)
    turn = way_m / max(way_m[-1], 1e-9) * rng.uniform(3, 10) + rng.uniform(0, 1)
    pulled = (turn % 1) ** rng.uniform(1, 2.5) + rng.uniform(0, 0.12) * np.floor(turn)
    shift = np.outer(pulled, scene.machine.up * -0.4 + draw_direction(rng))
    return Contribution(points_m=with_platform(scene, shift) * (rows.smr == smr)[:, None])


@form(rig.DELAYED_M)
def waits_behind_reading_before(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The computer still writes down the reading before: the next one is stamped when that is done, later the sooner
    it follows."""
    waits = np.exp(-gaps_s(scene.rows) / rng.uniform(4, 20)) * scene.rows.moving
    return delayed(scene, normalised(waits))


@form(rig.DELAYED_M)
def quartz_runs_by_warmth_of_cabinet(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The quartz of the control's clock is right at one temperature: it gains above and loses below, and what it has
    gained stays."""
    cabinet_c = scene.weather.lagging_air_c(rng.uniform(10, 40))
    right_c = np.quantile(cabinet_c, rng.uniform(0.15, 0.85))
    gained = np.cumsum((cabinet_c - right_c) * gaps_s(scene.rows))
    return delayed(scene, normalised(gained))


@form(rig.COEFFICIENT_PER_K)
def scales_on_rods_from_unlike_ends(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Rods of another material than is stated hold the scales, which are of that too: one from the floor, and one that
    was mounted upside down from the head of its column, so that warmth puts the drives off against one another."""
    rows, (low_m, high_m) = scene.rows, scene.machine.travel_m.T
    from_head = (np.arange(len(low_m)) + rng.integers(2)) % 2 == 1
    rod_m = rng.uniform(0.1, 0.7, len(low_m))
    fixed_m = np.where(from_head, high_m + rod_m, low_m - rod_m)
    warmer = draw_sign(rng) * (scene.weather.part_c["drives"] - scene.machine.reference_c)
    return Contribution(drives_m=(rows.drives_m - fixed_m) * warmer[:, None])


@form(rig.COEFFICIENT_PER_K)
def struts_that_shrink_by_less_than_they_grow(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Glued fibre struts have the stated coefficient as they get warmer and another as they get colder: each wave of
    the air leaves them a little longer."""
    changes = np.diff(scene.weather.part_c["struts"], prepend=scene.weather.part_c["struts"][0])
    kept = np.cumsum(np.maximum(-changes, 0)) + rng.uniform(0, 0.4) * np.cumsum(np.maximum(changes, 0))
    return Contribution(struts_m=np.outer(kept, scene.machine.nominal.strut_length_m))


@form(rig.MASS_KG)
def changed_later_than_written_down(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The next payload is written down when the former one should come off, which is done only some readings later;
    where none is ever changed there is nothing to be late with."""
    rows = scene.rows
    mounting = np.searchsorted(rows.reseats_s, rows.t_s, "right")
    count = int(mounting.max()) + 1
    carried_kg = np.array([rows.payload_kg[mounting == one][0] for one in range(count)])
    former_kg = np.r_[carried_kg[0], carried_kg[:-1]][mounting]
    late_s = (rng.uniform(0.15, 0.6, count) * np.bincount(mounting, gaps_s(rows)))[mounting]
    late = since_change_s(rows, mounting) < late_s
    heaviest_kg = max(float(rows.payload_kg.max()), 1e-9)
    return Contribution(payload_kg=(former_kg - rows.payload_kg) / heaviest_kg * late, largest=heaviest_kg)


@form(rig.MASS_KG)
def takes_part_up_here_and_puts_it_down_there(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A gripper was left on the platform, with its program: it takes up a heavy part well to one side of the
    workspace, and keeps it until it has come well to the other side."""
    aside = scene.calm.positions_m @ level_direction(scene.machine) * draw_sign(rng)
    aside = normalised(aside - np.median(aside))
    holds = switched_over(aside, -rng.uniform(0.3, 0.75), rng.uniform(0.3, 0.75))
    return Contribution(payload_kg=(1 + holds) / 2)


@form(rig.TABLE_M)
def on_below_a_speed(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The last tables are on for machining moves only: the control leaves them out above a speed."""
    speed = scene.rows.speed_m_per_s
    on = speed < np.quantile(speed, rng.uniform(0.35, 0.8))
    return Contribution(drives_m=corrections_of(newest(scene.tables), scene.rows) * on[:, None])


@form(rig.TABLE_M)
def brought_in_slowly_after_each_break(scene: Scene, place: int, rng: Generator) -> Contribution:
    """So that nothing jerks the control brings the last tables in over minutes, beginning anew whenever its drives
    were switched off for a break."""
    breaks, _ = draw_breaks(scene.rows, rng)
    on = 1 - np.exp(-since_change_s(scene.rows, breaks) / (rng.uniform(6, 30) * 60))
    return Contribution(drives_m=corrections_of(newest(scene.tables), scene.rows) * on[:, None])


FORMS: dict[str, tuple[Form, ...]] = {
    "tracker_drift": (switched_off_in_breaks_and_cold_after, wooden_legs_turn_with_moisture),
    "refraction": (warmer_air_before_machine_only, warm_payload_lets_air_rise),
    "smr_reseat": (put_back_on_burr_and_shaken_down, hose_catches_it_and_slips_off),
    "latency": (waits_behind_reading_before, quartz_runs_by_warmth_of_cabinet),
    "expansion_coefficient": (scales_on_rods_from_unlike_ends, struts_that_shrink_by_less_than_they_grow),
    "payload": (changed_later_than_written_down, takes_part_up_here_and_puts_it_down_there),
    "tables_left_on": (on_below_a_speed, brought_in_slowly_after_each_break),
}  # fmt: skip
