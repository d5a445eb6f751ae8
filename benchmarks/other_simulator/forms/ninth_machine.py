"""Forms of effects of columns, foundation and guides, of the ninth archive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.columns import GROWTH_M, sideways_n
from benchmarks.other_simulator.forms.drives import next_drive
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.shapes import (
    across,
    along,
    column_height,
    draw_sign,
    logistic,
    normalised,
    turned,
    warming_up,
)
from benchmarks.other_simulator.forms.traces import draw_stretches
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.state import Equilibrium

Array = NDArray[np.float64]
Generator = np.random.Generator

KELVIN_OF_CREEP = (1.0, 3.0)  # by which resin has to be warmer to creep e times as fast


@form(GROWTH_M)
def draws_like_a_chimney(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A hollow column that is open below and above: while it is warmer than the air that rises through it, and cools
    it from its foot up; while it is colder nothing draws."""
    rows, weather = scene.rows, scene.weather
    warmer = np.maximum(weather.part_c["drives"] - weather.lagging_air_c(5), 0)
    cooled = normalised(lagging(rows.t_s, warmer, rng.uniform(10, 40) * 60))
    reach = 1 - np.exp(-column_height(rows, drive) / rng.uniform(0.3, 0.8))
    return Contribution(carriage_m=along(scene.machine, drive, -cooled * reach))


@form(GROWTH_M)
def coolant_runs_down_one_face(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Coolant runs down one face of it while the pump is on: cold from the night at first, later warmer than the
    column, as its tank warms up. It bends and grows with that."""
    rows, machine, height = scene.rows, scene.machine, column_height(scene.rows, drive)
    runs = draw_stretches(rows, (3, 6), (0.12, 0.3), rng)
    tank = -1 + rng.uniform(1.5, 2.2) * warming_up(rows, rng.uniform(0.6, 2))
    warmth, side = normalised(lagging(rows.t_s, runs * tank, rng.uniform(6, 18) * 60)), draw_sign(rng)
    return Contribution(
        carriage_m=across(machine, drive, side * warmth * height**2) + along(machine, drive, 0.4 * warmth * height),
        carriage_rad=turned(machine, drive, -2 * side * warmth * height),
    )


@form()
def slab_curls_at_its_joint(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It stands beside a joint of the floor's slab, whose edge curls up while its upper side is colder than the ground
    and lies down while that is warmer: the foot rises, sinks and tilts with it."""
    rows, machine, weather = scene.rows, scene.machine, scene.weather
    above = weather.lagging_air_c(rng.uniform(15, 45)) - weather.part_c["base"]
    curl = -normalised(above - above[0])
    tilt = draw_sign(rng) * rng.uniform(0.2, 0.6) * curl
    return Contribution(
        carriage_m=along(machine, drive, curl) + across(machine, drive, tilt * column_height(rows, drive)),
        carriage_rad=turned(machine, drive, -tilt),
    )


@form()
def resin_below_its_foot_creeps_when_warm(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The resin that its foot was set in has not hardened wholly: it creeps under the weight, in warm hours and under
    a payload much faster than otherwise, and never back."""
    rows, machine = scene.rows, scene.machine
    floor_c = scene.weather.lagging_air_c(rng.uniform(30, 90))
    pressed = (machine.moving_mass_kg + rows.payload_kg) / machine.moving_mass_kg
    rate = pressed * np.exp((floor_c - floor_c.min()) / rng.uniform(*KELVIN_OF_CREEP))
    sunk = np.cumsum(rate * np.diff(rows.t_s, prepend=rows.t_s[0]))
    sink = -normalised(sunk)
    return Contribution(carriage_m=along(machine, drive, sink) + across(machine, drive, rng.uniform(-0.4, 0.4) * sink))


@form()
def braced_to_the_wall_below_a_height(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A brace to the wall holds it at some height: it stands fast below that, and bends freely above it."""
    machine, height = scene.machine, column_height(scene.rows, drive)
    free = np.maximum(height - np.quantile(height, rng.uniform(0.1, 0.5)), 0)
    largest = max(float(np.abs(sideways_n(machine, scene.calm, drive) * free).max()), 1e-6)

    def under_load(state: Equilibrium, amplitude: float) -> Contribution:
        bent = amplitude * sideways_n(machine, state, drive) * free / largest
        return Contribution(
            carriage_m=across(machine, drive, bent * (0.5 + free)), carriage_rad=turned(machine, drive, -1.5 * bent)
        )

    return Contribution(under_load=under_load)


@form()
def bed_sags_between_columns(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The bed that carries all columns is too thin and sags under what hangs on them together: each leans in, the
    more the higher its carriage stands."""
    machine, height = scene.machine, column_height(scene.rows, drive)
    other, share = next_drive(scene, drive), rng.uniform(0.5, 1)
    foot = machine.nominal.base_joint_m[machine.drive_of_strut == drive].mean(0)
    inwards = -1.0 if foot @ machine.sideways[drive] > 0 else 1.0

    def weight_n(state: Equilibrium) -> Array:
        down = -state.carriage_force_n @ machine.up
        return np.asarray(down[:, drive] + share * down[:, other])

    largest_n = max(float(np.abs(weight_n(scene.calm)).max()), 1e-6)

    def under_load(state: Equilibrium, amplitude: float) -> Contribution:
        lean = inwards * amplitude * weight_n(state) / largest_n
        return Contribution(
            carriage_m=across(machine, drive, lean * height), carriage_rad=turned(machine, drive, -lean)
        )  # fmt: skip

    return Contribution(under_load=under_load)


@form()
def bulges_between_its_supports(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The beam that carries the rail lies on a few supports, which are not evenly spaced, and hangs through to one
    side in each span, far more in a long one than in a short one."""
    place, count = scene.rows.centred[:, drive], int(rng.integers(4, 7))
    supports = np.linspace(-1.15, 1.15, count) + rng.uniform(-0.15, 0.15, count) * [0, *[1] * (count - 2), 0]
    span = np.clip(np.searchsorted(supports, place, "right") - 1, 0, count - 2)
    length = supports[span + 1] - supports[span]
    share = (place - supports[span]) / length
    hangs = (16 * share**2 * (1 - share) ** 2) * length**4
    return Contribution(carriage_m=across(scene.machine, drive, draw_sign(rng) * normalised(hangs)))


@form()
def magnet_plates_pull_unequally(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A linear motor pulls its carriage aside with many times its weight; its magnet plates were set with unequal
    gaps, so that the carriage is led off otherwise by each plate, and passes over smoothly between two."""
    travel_m = scene.rows.drives_m[:, drive]
    plate_m, over_m = rng.uniform(0.12, 0.3), rng.uniform(0.015, 0.04)
    edge_m, shift = travel_m.min() + rng.uniform(0, 1) * plate_m, np.zeros(len(travel_m))
    while edge_m < travel_m.max():
        shift += rng.normal() * logistic((travel_m - edge_m) / over_m)
        edge_m += plate_m
    line = np.polyval(np.polyfit(travel_m, shift, 1), travel_m)
    return Contribution(carriage_m=across(scene.machine, drive, normalised(shift - line)))


@form()
def flat_on_one_roller(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """One of the carriage's rollers stood under load for years and has a flat: once in its turn the carriage noses
    over for a short piece, and not elsewhere."""
    around_m, share = rng.uniform(0.12, 0.3), rng.uniform(0.1, 0.2)
    turn = scene.rows.drives_m[:, drive] / around_m + rng.uniform(0, 1)
    off = (turn + 0.5) % 1 - 0.5
    return Contribution(carriage_rad=4 * draw_sign(rng) * turned(scene.machine, drive, np.exp(-((off / share) ** 2))))


@form()
def rail_worn_at_its_turning_points(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Oil fails where the carriage turns round: the rail is worn towards both ends, so that the upper block drops at
    the upper end and the lower one at the lower end; midway it runs true."""
    place = scene.rows.centred[:, drive]
    upper = np.maximum(place - rng.uniform(0.1, 0.4), 0) ** 1.5
    lower = np.maximum(-place - rng.uniform(0.1, 0.4), 0) ** 1.5
    angle = normalised(upper) - rng.uniform(0.5, 1) * normalised(lower)
    return Contribution(carriage_rad=4 * draw_sign(rng) * turned(scene.machine, drive, angle))


FORMS: dict[str, tuple[Form, ...]] = {
    "column_thermal_growth": (draws_like_a_chimney, coolant_runs_down_one_face),
    "foundation_settling": (slab_curls_at_its_joint, resin_below_its_foot_creeps_when_warm),
    "column_compliance": (braced_to_the_wall_below_a_height, bed_sags_between_columns),
    "guide_straightness": (bulges_between_its_supports, magnet_plates_pull_unequally),
    "guide_angular": (flat_on_one_roller, rail_worn_at_its_turning_points),
}
