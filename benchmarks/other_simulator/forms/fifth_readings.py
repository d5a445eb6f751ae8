"""Forms of the fifth archive of the station, of reflectors, and of what is stated of the rig as a whole."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms import rig, station
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import draw_mountings, new_visit
from benchmarks.other_simulator.forms.memory import since_change_s, switched_over
from benchmarks.other_simulator.forms.rig import delayed
from benchmarks.other_simulator.forms.shapes import draw_sign, level_direction, normalised, sight_of
from benchmarks.other_simulator.forms.traces import draw_breaks, draw_stretches, gaps_s, last_told
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.tables import corrections_of, newest

Array = NDArray[np.float64]
Generator = np.random.Generator

WARMER_K = 2.0  # than the reference, at which a coefficient that is not constant is off by its amplitude


@form()
def floor_gives_way_under_operator(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A thin floor: while the operator stands beside the station it leans to there, and is back when he sits down."""
    rows = scene.rows
    beside = draw_stretches(rows, (4, 9), (0.02, 0.12), rng)
    leaning = normalised(lagging(rows.t_s, beside, rng.uniform(5, 60)))
    azimuth = rng.uniform(0, 6.3)
    axis = np.array([np.cos(azimuth), -np.sin(azimuth), rng.uniform(-0.4, 0.4)])
    aside = np.array([np.sin(azimuth), np.cos(azimuth), -0.4])
    return Contribution(station_rad=0.25 * np.outer(leaning, axis), station_m=0.5 * np.outer(leaning, aside))


@form()
def oriented_anew_at_each_check(scene: Scene, place: int, rng: Generator) -> Contribution:
    """At each check of the nests it is set to them anew, by a single reading of each: its frame is another until the
    next check."""
    checks = scene.rows.nest_check
    turns = rng.normal(size=(int(checks.max()) + 1, 3)) * [0.06, 0.06, 0.3]
    shifts = rng.normal(size=(int(checks.max()) + 1, 3)) * 0.4
    turns[0], shifts[0] = 0, 0
    second = int(np.argmax(checks > checks[0]))
    step_s = float(scene.rows.t_s[second - 1] + scene.rows.t_s[second]) / 2 if second else None
    return Contribution(station_rad=turns[checks], station_m=shifts[checks], step_s=step_s)


@form(station.READ_WRONG)
def air_typed_in_now_and_then(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The operator reads a thermometer now and then and types in what it shows: distances are those of that air until
    he does so again, and once he has typed in a wrong figure."""
    sight, distances = sight_of(scene)
    air_c, every_min, first = scene.weather.air_c, rng.uniform(20, 70), rng.uniform(0, 1)
    turn = np.floor(scene.rows.hours * 60 / every_min + first).astype(int)
    mistyped = (turn == rng.integers(turn[-1] + 1)) * draw_sign(rng) * rng.uniform(0.5, 1.5)
    off = air_c - last_told(scene.rows, air_c, every_min, first) - mistyped
    return Contribution(sights_m=sight * (distances * normalised(off))[:, None])


@form(station.CURVATURE_PER_M)
def platform_stirs_layers_of_air(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Layers of air form while the machine rests, and bend the light upwards, more above; long fast ways stir them."""
    rows, (_, distances) = scene.rows, sight_of(scene)
    height, tau_s, mixes_m = scene.sights_m[:, 2], rng.uniform(120, 700), rng.uniform(1, 6)
    ways_m = np.diff(rows.way_m.max(1), prepend=rows.way_m[0].max()) * np.sqrt(rows.speed_m_per_s / 0.1)
    layered = np.zeros(len(rows))
    for k, (passed_s, way_m) in enumerate(zip(gaps_s(rows), ways_m, strict=True)):
        grown = 1 - (1 - layered[max(k - 1, 0)]) * np.exp(-passed_s / tau_s)
        layered[k] = grown * np.exp(-way_m / mixes_m)
    bent = normalised(layered) * (1 + 1.5 * normalised(height - np.median(height)))
    return Contribution(sights_m=np.outer(bent * distances**2 / 8, station.UP))


@form()
def turned_in_its_nest_in_breaks(scene: Scene, smr: int, rng: Generator) -> Contribution:
    """Its centre is not that of its ball; in breaks someone turns it towards the station, never quite as before: the
    centre goes round on a circle."""
    rows = scene.rows
    breaks, first_s = draw_breaks(rows, rng)
    angle = np.r_[0, rng.uniform(0.8, 5.5, int(breaks[-1]))].cumsum()[breaks]
    ring = np.stack([np.cos(angle) - 1, np.sin(angle), 0 * angle], 1)
    tilt = rng.normal(size=3) * [0.3, 0.3, 1]
    ring = ring - np.outer(ring @ tilt, tilt) / (1 + tilt @ tilt)
    shift = np.einsum("rij,rj->ri", scene.calm.rotations, ring)
    return Contribution(points_m=shift * (rows.smr == smr)[:, None], step_s=first_s)


@form()
def pushed_to_and_fro_at_ends(scene: Scene, smr: int, rng: Generator) -> Contribution:
    """Its holder is loose and touches something well to one side of the workspace, and something else well to the
    other: it lies as the last of them has pushed it."""
    level = level_direction(scene.machine)
    aside = normalised(scene.calm.positions_m @ level - np.median(scene.calm.positions_m @ level))
    lies = switched_over(aside, -rng.uniform(0.5, 0.85), rng.uniform(0.5, 0.85))
    shift = -0.5 * np.outer(lies, level + rng.normal(size=3) * [0.4, 0.4, 0.2])
    return Contribution(points_m=shift * (scene.rows.smr == smr)[:, None])


@form(rig.DELAYED_M)
def computer_busy_for_a_while(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Somebody opens other programs on the computer that gathers the readings: it stamps them later while they run,
    and each time another much."""
    late = draw_stretches(scene.rows, (2, 6), (0.06, 0.25), rng)
    begun = np.cumsum(np.diff(late, prepend=0.0) > 0)
    return delayed(scene, 0.05 + late * rng.uniform(0.3, 1, int(begun[-1]) + 1)[begun])


@form(rig.DELAYED_M)
def takes_longer_where_light_is_weak(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A station that measures until it has got light enough: longer for what is far away, and for reflectors that face
    elsewhere."""
    _, distances = sight_of(scene)
    faces = rng.exponential(1.0, len(scene.machine.reflectors))[scene.rows.smr]
    weak = (distances / np.median(distances)) ** 4 * (0.4 + faces)
    return delayed(scene, weak / np.quantile(weak, 0.95))


@form(rig.COEFFICIENT_PER_K)
def struts_of_one_end_replaced_after_crash(scene: Scene, place: int, rng: Generator) -> Contribution:
    """After a crash all struts of one drive were replaced by those of another make, and the joints of the platform's
    end that was bent with them: both expand by more than is stated, or by less."""
    machine, part_c = scene.machine, scene.weather.part_c
    replaced = machine.drive_of_strut == rng.integers(len(machine.drives))
    sign, share = draw_sign(rng), rng.uniform(0.5, 1)
    warmer_k, ends_k = (sign * (part_c[group] - machine.reference_c) for group in ("struts", "platform"))
    joints_m = machine.nominal.platform_joint_m * replaced[:, None]
    return Contribution(
        struts_m=np.outer(warmer_k, machine.nominal.strut_length_m * replaced),
        joints_m=share * ends_k[:, None, None] * joints_m,
    )


@form(rig.COEFFICIENT_PER_K)
def coefficient_that_grows_with_warmth(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A material whose coefficient is as stated at the reference only, and rises with each degree above it: struts
    grow by the square of their warmth."""
    machine = scene.machine
    warmer = scene.weather.part_c["struts"] - machine.reference_c
    growth = draw_sign(rng) * warmer**2 / WARMER_K
    return Contribution(struts_m=np.outer(growth, machine.nominal.strut_length_m))


@form(rig.OFF_M)
def turned_round_at_some_mountings(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Payloads are lopsided and fit both ways round: whoever mounts one does not look which way it was before."""
    rows, (mounting, _) = scene.rows, draw_mountings(scene.rows, rng)
    ways = rng.choice([-1.0, 1.0], int(mounting.max()) + 1)
    ways[1::2] = -ways[: len(ways[1::2]) * 2 : 2]  # one of each two neighbours, so that there are both
    lopsided = rng.uniform(0.5, 1, len(rows.payloads))[rows.payload] * (rows.payload > 0)
    return Contribution(payload_centre_m=np.outer(ways[mounting] * lopsided, level_direction(scene.machine)))


@form(rig.MASS_KG)
def sling_of_crane_still_carries_part(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Each payload comes on the crane's sling, which nobody takes off at first: it carries a part, the more the lower
    the platform is, until somebody sees it."""
    rows, (mounting, _) = scene.rows, draw_mountings(scene.rows, rng)
    height = scene.calm.positions_m @ scene.machine.up
    taut = 0.3 + 0.7 * (height.max() - height) / max(float(np.ptp(height)), 1e-9)
    until_s = (rng.uniform(0.25, 0.7, int(mounting.max()) + 1) * np.bincount(mounting, gaps_s(rows)))[mounting]
    on = (since_change_s(rows, mounting) < until_s) & (rows.payload > 0)
    heaviest_kg = max(float(rows.payload_kg.max()), 1e-9)
    return Contribution(payload_kg=-rows.payload_kg / heaviest_kg * taut * on, largest=0.9 * heaviest_kg)


@form(rig.TABLE_M)
def tables_of_drives_interchanged(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The last tables are on, and each is at the next drive: someone has counted the drives from the other end."""
    count = len(scene.machine.drives)
    moved = [
        replace(
            one, drive=(one.drive + 1) % count, partner=None if one.partner is None else (one.partner + 1) % count
        )
        for one in newest(scene.tables)
    ]  # fmt: skip
    return Contribution(drives_m=corrections_of(moved, scene.rows))


@form(rig.TABLE_M)
def on_in_some_programs(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The operator runs the campaign in pieces by two programs, of which one switches the last tables on and the other
    one off."""
    rows = scene.rows
    begun = np.cumsum(new_visit(rows) & (rng.random(len(rows)) < 1 / rng.uniform(20, 70)))
    on = (begun + rng.integers(2)) % 2
    return Contribution(drives_m=corrections_of(newest(scene.tables), rows) * on[:, None])


FORMS: dict[str, tuple[Form, ...]] = {
    "tracker_drift": (floor_gives_way_under_operator, oriented_anew_at_each_check),
    "refraction": (air_typed_in_now_and_then, platform_stirs_layers_of_air),
    "smr_reseat": (turned_in_its_nest_in_breaks, pushed_to_and_fro_at_ends),
    "latency": (computer_busy_for_a_while, takes_longer_where_light_is_weak),
    "expansion_coefficient": (struts_of_one_end_replaced_after_crash, coefficient_that_grows_with_warmth),
    "payload": (turned_round_at_some_mountings, sling_of_crane_still_carries_part),
    "tables_left_on": (tables_of_drives_interchanged, on_in_some_programs),
}  # fmt: skip
