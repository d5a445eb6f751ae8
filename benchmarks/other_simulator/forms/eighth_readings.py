"""Forms of effects of the station, its reflectors and the rig as a whole, of the eighth archive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import draw_mountings, new_visit
from benchmarks.other_simulator.forms.memory import since_change_s
from benchmarks.other_simulator.forms.rig import (
    COEFFICIENT_PER_K,
    DELAYED_M,
    MASS_KG,
    OFF_M,
    REFERENCE_M_PER_S,
    TABLE_M,
)
from benchmarks.other_simulator.forms.shapes import (
    draw_direction,
    draw_phase,
    draw_sign,
    level_direction,
    logistic,
    normalised,
    sight_of,
    since,
    with_platform,
    within,
)
from benchmarks.other_simulator.forms.station import CURVATURE_PER_M, NOT_FOLLOWED
from benchmarks.other_simulator.forms.traces import draw_breaks, draw_stretches, gathered_until
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.station import across_sight
from benchmarks.other_simulator.tables import corrections_of, newest, oldest

Array = NDArray[np.float64]
Generator = np.random.Generator


@form()
def stand_sinks_into_floor(scene: Scene, place: int, rng: Generator) -> Contribution:
    """One foot of its stand sinks into a soft floor, by the logarithm of time: the station leans over and sinks."""
    hours = scene.rows.hours
    sunk = np.log1p(hours / rng.uniform(0.03, 0.2))
    sunk = (sunk / sunk[-1])[:, None]
    towards = rng.uniform(0, 2 * np.pi)
    lean = 0.3 * np.array([np.cos(towards), np.sin(towards), 0])
    height_m = rng.uniform(1.1, 1.6)
    shift = np.array([lean[1] * height_m, -lean[0] * height_m, -rng.uniform(0.1, 0.4)])
    return Contribution(station_rad=sunk * lean, station_m=sunk * shift)


@form()
def initialised_anew_at_checks(scene: Scene, place: int, rng: Generator) -> Contribution:
    """It is initialised anew before each check of the nests: zeros of its circles and of its level that scatter."""
    check = np.maximum(scene.rows.nest_check, 0)
    zeros = rng.normal(size=(int(check.max()) + 1, 3)) * [0.12, 0.12, 0.25]
    zeros[0] = 0.0
    after = scene.rows.t_s[check > 0]
    step_s = float(after[0]) - 1.0 if len(after) else None
    return Contribution(station_rad=zeros[check], step_s=step_s)


@form(CURVATURE_PER_M)
def wall_in_the_sun(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The sun warms a wall beside the line of sight for some hours, and the air along it bends light to one side."""
    sight, distances = sight_of(scene)
    begin = rng.uniform(-0.1, 0.4)
    shone_on = within(scene.rows, begin, begin + rng.uniform(0.3, 0.6))
    warmth = normalised(lagging(scene.rows.t_s, shone_on, rng.uniform(10, 30) * 60))
    aside = draw_sign(rng) * np.exp(draw_sign(rng) * scene.sights_m[:, 0] / rng.uniform(0.6, 1.5))
    return Contribution(sights_m=across_sight(sight, distances) * (normalised(aside) * warmth * distances / 8)[:, None])


@form(NOT_FOLLOWED * 2)
def cold_air_along_floor(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A gate is opened at times: cold air lies along the floor and shortens the ways of light through it.

    The station's own sensor is above; what is seen low down has more of its way in the cold.
    """
    sight, distances = sight_of(scene)
    opened = draw_stretches(scene.rows, (2, 5), (0.08, 0.25), rng)
    cold = normalised(lagging(scene.rows.t_s, opened, rng.uniform(4, 15) * 60))
    height_m = scene.sights_m[:, 2]
    top_m = np.quantile(height_m, rng.uniform(0.3, 0.6))
    share = logistic((top_m - height_m) / rng.uniform(0.05, 0.2))
    return Contribution(sights_m=sight * (distances * cold * share)[:, None])


def _of_reflector(scene: Scene, smr: int, shift: Array) -> Array:
    """Shifts (r, 3) in the platform's frame, of one reflector alone, in the machine frame (r, 3)."""
    return np.asarray(with_platform(scene, shift) * (scene.rows.smr == smr)[:, None])


@form()
def dirt_at_each_seating(scene: Scene, smr: int, rng: Generator) -> Contribution:
    """It is taken out of its nest in each break, and there is other dirt below it each time that it is put back."""
    breaks, first_s = draw_breaks(scene.rows, rng)
    seats = np.stack([draw_direction(rng) * rng.uniform(0.5, 1) for _ in range(int(breaks.max()) + 1)])
    seats[0] = 0.0
    return Contribution(points_m=_of_reflector(scene, smr, seats[breaks]), step_s=first_s)


@form()
def works_out_until_pressed_back(scene: Scene, smr: int, rng: Generator) -> Contribution:
    """Its magnet is weak: each jolt of a fast approach moves it on a little, until somebody presses it back."""
    rows = scene.rows
    breaks, _ = draw_breaks(rows, rng)
    jolts = rows.speed_m_per_s ** rng.uniform(0.7, 1.5) * new_visit(rows)
    out = normalised(gathered_until(rows, jolts, breaks))
    return Contribution(points_m=_of_reflector(scene, smr, np.outer(out, draw_direction(rng))))


@form(DELAYED_M)
def drives_read_one_after_other_as_well(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Drives are asked one after the other: each next one is read later, in an order that is the bus's own."""
    velocity = scene.rows.velocity_m_per_s
    order = rng.permutation(velocity.shape[1])
    late = rng.uniform(0, 0.25) + order / max(order.max(), 1)
    return Contribution(drives_m=-velocity / REFERENCE_M_PER_S * late)


@form(DELAYED_M)
def beat_of_two_cycles(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Station and control have cycles that are not quite the same: the delay grows by a cycle and begins again."""
    turn = scene.rows.hours * 60 / rng.uniform(8, 45) + draw_phase(rng)
    late = rng.uniform(-0.2, 0.2) + turn % 1
    return Contribution(drives_m=-scene.rows.velocity_m_per_s / REFERENCE_M_PER_S * late[:, None])


@form(COEFFICIENT_PER_K)
def spare_strut_of_other_material_as_well(scene: Scene, place: int, rng: Generator) -> Contribution:
    """One strut is a spare part, of carbon fibre or aluminium: it follows the same sensor by another coefficient."""
    machine = scene.machine
    off_k = scene.weather.part_c["struts"] - machine.reference_c
    struts_m = np.zeros_like(scene.calm.tension_n)
    strut = int(rng.integers(struts_m.shape[1]))
    struts_m[:, strut] = draw_sign(rng) * machine.nominal.strut_length_m[strut] * off_k
    return Contribution(struts_m=struts_m)


@form(COEFFICIENT_PER_K)
def one_scale_of_glass_ceramic(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The scale of one drive is of glass or glass ceramic, and grows less than the steel that is stated for all."""
    drives_m = np.zeros_like(scene.rows.drives_m)
    drive = int(rng.integers(drives_m.shape[1]))
    off_k = scene.weather.part_c["drives"] - scene.machine.reference_c
    drives_m[:, drive] = -scene.rows.drives_m[:, drive] * off_k
    return Contribution(drives_m=drives_m, largest=scene.machine.expansion_per_k["drives"])


@form(MASS_KG)
def tank_runs_empty(scene: Scene, place: int, rng: Generator) -> Contribution:
    """What is carried is a tank that was filled too well when it was mounted, and runs empty while it is there."""
    rows = scene.rows
    mounting, _ = draw_mountings(rows, rng)
    here_h = since_change_s(rows, mounting) / 3600
    left = np.maximum(1 - here_h / rng.uniform(0.5, 1.5), rng.uniform(-0.5, 0))
    return Contribution(payload_kg=left * (rows.payload > 0))


@form(OFF_M)
def slides_on_its_fixture(scene: Scene, place: int, rng: Generator) -> Contribution:
    """What is carried slides aside on its fixture at a moment, and from then on is mounted where it came to lie."""
    rows = scene.rows
    carried = np.flatnonzero(rows.payload > 0)
    step_s = None
    moved = np.zeros(len(rows))
    if len(carried) > 1:
        at = carried[int(rng.uniform(0.2, 0.7) * len(carried))]
        step_s = float(rows.t_s[at]) - 0.5
        moved = since(rows, step_s) * (rows.payload > 0)
    return Contribution(
        payload_centre_m=np.outer(moved, level_direction(scene.machine) * draw_sign(rng)), step_s=step_s
    )


@form(TABLE_M)
def generations_mixed(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Some drives have their last tables on, others their first, after a backup was put back in part."""
    last, first = newest(scene.tables), oldest(scene.tables)
    if last[0].generation == first[0].generation:  # there is nothing to be mixed
        return Contribution()
    of_last = int(rng.integers(len(scene.machine.drives)))
    tables = [table for table in last if table.drive == of_last]
    tables += [table for table in first if table.drive != of_last]
    return Contribution(drives_m=corrections_of(tables, scene.rows))


@form(TABLE_M)
def only_a_part_of_the_nodes(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A transfer broke off: the last tables are on up to a place of the travel, and beyond it are zeros."""
    rows, upwards = scene.rows, draw_sign(rng)
    reached = upwards * rows.centred < rng.uniform(-0.1, 0.5)
    return Contribution(drives_m=corrections_of(newest(scene.tables), rows) * reached)


FORMS: dict[str, tuple[Form, ...]] = {
    "tracker_drift": (stand_sinks_into_floor, initialised_anew_at_checks),
    "refraction": (wall_in_the_sun, cold_air_along_floor),
    "smr_reseat": (dirt_at_each_seating, works_out_until_pressed_back),
    "latency": (drives_read_one_after_other_as_well, beat_of_two_cycles),
    "expansion_coefficient": (spare_strut_of_other_material_as_well, one_scale_of_glass_ceramic),
    "payload": (tank_runs_empty, slides_on_its_fixture),
    "tables_left_on": (generations_mixed, only_a_part_of_the_nodes),
}
