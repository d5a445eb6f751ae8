"""Forms of effects of the station, its reflectors and the rig as a whole, of the ninth archive."""

from __future__ import annotations

from dataclasses import replace

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
    TABLE_M,
    delayed,
)
from benchmarks.other_simulator.forms.shapes import (
    draw_direction,
    draw_instant,
    draw_sign,
    level_direction,
    normalised,
    sight_of,
    since,
    with_platform,
)
from benchmarks.other_simulator.forms.station import CURVATURE_PER_M, NOT_FOLLOWED, UP
from benchmarks.other_simulator.forms.traces import draw_stretches, draw_there_for_a_while, following
from benchmarks.other_simulator.machine import GROUPS
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.station import across_sight
from benchmarks.other_simulator.tables import corrections_of, newest

Array = NDArray[np.float64]
Generator = np.random.Generator

PER_FAHRENHEIT = 1.8  # what a coefficient by kelvin is of that by degree Fahrenheit
AVERAGED_M = 2e-3  # half of the way, at most
CREEP_M_PER_S = 1e-3  # below this speed a position is averaged over time after all


@form()
def cart_parked_next_to_it(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Someone parks a loaded cart beside it and fetches it later: the floor gives way to that side, at once and a
    little more while the cart stands there, and comes up again as it went."""
    rows = scene.rows
    there, first_s = draw_there_for_a_while(rows, rng)
    slow = lagging(rows.t_s, there, rng.uniform(5, 25) * 60)
    share, towards, height_m = rng.uniform(0.5, 0.8), rng.uniform(0, 2 * np.pi), rng.uniform(1.1, 1.6)
    given = (share * there + (1 - share) * slow)[:, None]
    lean = 0.3 * np.array([np.cos(towards), np.sin(towards), 0])
    shift = np.array([lean[1] * height_m, -lean[0] * height_m, -rng.uniform(0.1, 0.3)])
    return Contribution(station_rad=given * lean, station_m=given * shift, step_s=first_s)


@form()
def its_base_slips_as_its_head_slews(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The clamp between its base and its stand is not tight: each jerk of its head, as it slews from one reflector to
    another far aside, turns the base on by a little, more one way round than the other."""
    sight, _ = sight_of(scene)
    azimuth = np.arctan2(sight[:, 0], sight[:, 1])
    slew = np.diff(azimuth, prepend=azimuth[0])
    one_way = rng.uniform(0.2, 0.6)
    slips = np.where(slew > 0, 1.0, one_way) * np.maximum(np.abs(slew) - 0.05, 0) * rng.uniform(0.4, 1, len(slew))
    turned = draw_sign(rng) * normalised(np.cumsum(slips))
    return Contribution(station_rad=0.3 * np.outer(turned, UP))


@form(NOT_FOLLOWED * 2)
def shielding_gas_gathers_in_hall(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Welders work in the next bay: their shielding gas, which is denser to light than air, gathers in the hall while
    they do and is aired out much faster; the station knows of temperature, pressure and moisture only."""
    sight, distances = sight_of(scene)
    works = draw_stretches(scene.rows, (2, 4), (0.12, 0.3), rng)
    tau_s = np.where(works > 0, rng.uniform(20, 60), rng.uniform(4, 12)) * 60
    gas = normalised(following(scene.rows.t_s, works, tau_s))
    return Contribution(sights_m=sight * (distances * gas)[:, None])


@form(CURVATURE_PER_M)
def air_boils_over_warm_floor(scene: Scene, place: int, rng: Generator) -> Contribution:
    """While the floor is warmer than the air this boils: what is seen through it jumps to and fro, up and aside, by
    another amount in each reading, the more the further away and the lower."""
    sight, distances = sight_of(scene)
    warmer = scene.weather.part_c["base"] - scene.weather.lagging_air_c(5)
    warmer = np.maximum(warmer - np.quantile(warmer, rng.uniform(0.1, 0.4)), 0)
    height_m = scene.sights_m[:, 2] - scene.sights_m[:, 2].min()
    strength = normalised(warmer) * np.exp(-height_m / rng.uniform(0.8, 2)) * distances**1.5 / 8
    aside, above = rng.normal(size=(2, len(distances)))
    return Contribution(
        sights_m=0.7 * across_sight(sight, distances) * (strength * aside)[:, None]
        + np.outer(strength * (above + 0.5), UP)
    )


def _of_reflector(scene: Scene, smr: int, shift: Array) -> Array:
    """Shifts (r, 3) in the platform's frame, of one reflector alone, in the machine frame (r, 3)."""
    return np.asarray(with_platform(scene, shift) * (scene.rows.smr == smr)[:, None])


@form()
def tips_between_two_seats(scene: Scene, smr: int, rng: Generator) -> Contribution:
    """A burr in its nest gives it two places to lie in: some jolts tip it over from the one into the other, later ones
    tip it back, and it is never between them."""
    rows = scene.rows
    fast = rows.speed_m_per_s > np.quantile(rows.speed_m_per_s, rng.uniform(0, 0.5))
    tips = new_visit(rows) * fast * (rng.random(len(rows)) < rng.uniform(0.03, 0.15))
    seat = np.cumsum(tips) % 2
    return Contribution(points_m=_of_reflector(scene, smr, np.outer(seat, draw_direction(rng))))


@form()
def plastic_post_recovers_after_knock(scene: Scene, smr: int, rng: Generator) -> Contribution:
    """It stands on a post of plastic; someone knocks that aside, and it comes back by more than half within an hour,
    at rest as well as in motion."""
    rows, step_s = scene.rows, draw_instant(scene.rows, rng, 0.15, 0.6)
    stays, tau_s = rng.uniform(0.2, 0.45), rng.uniform(8, 35) * 60
    aside = since(rows, step_s) * (stays + (1 - stays) * np.exp(-np.maximum(rows.t_s - step_s, 0) / tau_s))
    return Contribution(points_m=_of_reflector(scene, smr, np.outer(aside, draw_direction(rng))), step_s=step_s)


@form(DELAYED_M)
def filter_set_with_each_payload(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Whoever mounts a payload calls up its parameters, and the filter that positions pass on their way out is one of
    them: with each payload they come by another delay, the same whenever that is carried."""
    payload = scene.rows.payload
    delays = rng.permutation(np.linspace(rng.uniform(0, 0.3), 1, int(payload.max()) + 1))
    return delayed(scene, draw_sign(rng) * delays[payload])


@form(AVERAGED_M)
def averaged_over_a_fixed_way(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The control's positions are means over the last so many counts of each scale, not over a time: a slow drive is
    read by more of a second too late than a fast one, and all are behind by nearly the same way."""
    velocity = scene.rows.velocity_m_per_s
    counts = rng.uniform(0.7, 1, velocity.shape[1])
    behind = velocity / (np.abs(velocity) + CREEP_M_PER_S) * counts
    return Contribution(drives_m=-behind)


@form(COEFFICIENT_PER_K)
def entered_by_degree_fahrenheit(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The coefficients came from an American handbook, by degree Fahrenheit, and were entered as if by kelvin: true
    ones are larger, each by the same share of itself."""
    stated = scene.machine.expansion_per_k
    most = max(stated[group] for group in GROUPS)
    return Contribution(
        expansion_per_k={group: stated[group] / most for group in GROUPS}, largest=(PER_FAHRENHEIT - 1) * most
    )


@form(COEFFICIENT_PER_K)
def each_strut_wound_otherwise(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Struts of wound fibre, of which each was wound at an angle of its own: each has a coefficient of its own about
    what is stated, some more and some less."""
    machine = scene.machine
    off_k = scene.weather.part_c["struts"] - machine.reference_c
    of_each = rng.normal(size=len(machine.struts))
    return Contribution(struts_m=np.outer(off_k, machine.nominal.strut_length_m * of_each / np.abs(of_each).max()))


@form(MASS_KG)
def fixture_stays_on_without_payload(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The fixture that holds the payloads was weighed with each of them, and stays on when there is none: what is then
    stated to be nothing hangs to one side of the platform."""
    machine = scene.machine
    bare = (scene.rows.payload == 0).astype(float)
    aside = level_direction(machine) * draw_sign(rng) * rng.uniform(0.001, 0.004)  # for each kilogram
    return Contribution(payload_kg=bare, payload_centre_m=np.outer(bare, aside))


@form(OFF_M)
def paste_creeps_downhill(scene: Scene, place: int, rng: Generator) -> Contribution:
    """What is carried is a tub of stiff paste, mounted askew: from each mounting on it creeps to the lower side, within
    some tens of minutes, and is stirred level before the next one."""
    rows = scene.rows
    mounting, _ = draw_mountings(rows, rng)
    crept = 1 - np.exp(-since_change_s(rows, mounting) / (rng.uniform(8, 40) * 60))
    aside = draw_sign(rng) * crept * (rows.payload > 0)
    return Contribution(payload_centre_m=np.outer(aside, level_direction(scene.machine)))


@form(TABLE_M)
def held_from_node_to_node(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The last tables are on, in a control that does not interpolate: the correction of a node holds until the next
    one is passed, and then jumps."""
    rows, drives_m = scene.rows, np.zeros_like(scene.rows.drives_m)
    for table in newest(scene.tables):
        own_m = np.clip(rows.commanded_m[:, table.drive], table.own_m[0], table.own_m[-1])
        node = np.searchsorted(table.own_m, own_m, "right") - 1
        partner = np.zeros(len(rows), dtype=np.intp)
        if table.partner is not None:
            at_m = np.clip(rows.commanded_m[:, table.partner], table.partner_m[0], table.partner_m[-1])
            partner = np.searchsorted(table.partner_m, at_m, "right") - 1
        drives_m[:, table.drive] += table.corrections[node, partner]
    return Contribution(drives_m=drives_m)


@form(TABLE_M)
def partner_taken_as_standing_still(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The last tables are on and depend on two drives, but the control is not told of the second one: it takes that as
    standing at one place for good."""
    tables = newest(scene.tables)
    if all(table.partner is None for table in tables):  # there is nothing to be told
        return Contribution()
    share = rng.random()
    fixed = []
    for table in tables:
        column = int(share * table.corrections.shape[1])
        fixed.append(replace(table, partner=None, corrections=table.corrections[:, column : column + 1]))
    return Contribution(drives_m=corrections_of(fixed, scene.rows))


FORMS: dict[str, tuple[Form, ...]] = {
    "tracker_drift": (cart_parked_next_to_it, its_base_slips_as_its_head_slews),
    "refraction": (shielding_gas_gathers_in_hall, air_boils_over_warm_floor),
    "smr_reseat": (tips_between_two_seats, plastic_post_recovers_after_knock),
    "latency": (filter_set_with_each_payload, averaged_over_a_fixed_way),
    "expansion_coefficient": (entered_by_degree_fahrenheit, each_strut_wound_otherwise),
    "payload": (fixture_stays_on_without_payload, paste_creeps_downhill),
    "tables_left_on": (held_from_node_to_node, partner_taken_as_standing_still),
}
