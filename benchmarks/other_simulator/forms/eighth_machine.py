"""Forms of effects of columns, foundation and guides, of the eighth archive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.columns import GROWTH_M, sideways_n
from benchmarks.other_simulator.forms.drives import next_drive
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import draw_cycles, draw_mountings, new_visit
from benchmarks.other_simulator.forms.memory import since_change_s
from benchmarks.other_simulator.forms.shapes import (
    across,
    along,
    column_height,
    draw_sign,
    logistic,
    normalised,
    turned,
    within,
)
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.state import Equilibrium

Array = NDArray[np.float64]
Generator = np.random.Generator


@form(GROWTH_M)
def cabinet_on_its_back_as_well(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A cabinet on its back warms that side whenever its cooler rests; the column bends away from it and grows."""
    rows, machine, height = scene.rows, scene.machine, column_height(scene.rows, drive)
    warmth, away = draw_cycles(rows, (35, 90), (20, 45), rng), draw_sign(rng)
    return Contribution(
        carriage_m=across(machine, drive, away * warmth * height**2) + along(machine, drive, 0.3 * warmth * height),
        carriage_rad=turned(machine, drive, -2 * away * warmth * height),
    )


@form(GROWTH_M)
def warm_air_under_roof(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Warm air gathers under the roof while the heating runs: only what stands in it grows, above the sensor."""
    rows, begin = scene.rows, rng.uniform(-0.2, 0.3)
    heated = within(rows, begin, begin + rng.uniform(0.4, 0.7))
    warmth = normalised(lagging(rows.t_s, heated, rng.uniform(20, 50) * 60))
    in_it = np.maximum(column_height(rows, drive) - rng.uniform(0.4, 0.7), 0)
    return Contribution(carriage_m=along(scene.machine, drive, warmth * in_it / max(in_it.max(), 1e-9)))


@form()
def beds_in_at_each_change(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Its wedges bed in a little more each time that a payload is mounted, within some minutes, and stay there."""
    rows = scene.rows
    mounting, first_s = draw_mountings(rows, rng)
    tau_s, last = rng.uniform(2, 12) * 60, int(mounting.max())
    shares = rng.uniform(0.5, 1, last + 1) * 0.8 ** np.arange(last + 1)
    before = np.cumsum(shares) - shares  # of the mountings before, which have come to rest
    here = shares[mounting] * (1 - np.exp(-since_change_s(rows, mounting) / tau_s)) * (mounting > 0)
    sink = -normalised(before[mounting] - shares[0] * (mounting > 0) + here)
    aside = rng.uniform(-0.6, 0.6) * sink
    return Contribution(
        carriage_m=along(scene.machine, drive, sink) + across(scene.machine, drive, aside), step_s=first_s
    )


@form()
def walks_on_its_anchors(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Its anchors are loose, and the foot walks aside a little with the jolts of moves, the more the faster."""
    rows, machine = scene.rows, scene.machine
    jolt = rows.speed_m_per_s**2 * new_visit(rows) * (rng.random(len(rows)) < rng.uniform(0.15, 0.6))
    walked = np.cumsum(jolt)
    walked = draw_sign(rng) * walked / max(walked[-1], 1e-9)
    return Contribution(
        carriage_m=across(machine, drive, walked) - along(machine, drive, rng.uniform(0, 0.3) * np.abs(walked))
    )


@form()
def tied_by_crossbeam(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A crossbeam ties its head to the next column, which pulls it along when that one is pressed aside."""
    machine, other = scene.machine, next_drive(scene, drive)
    own_height, other_height = column_height(scene.rows, drive), column_height(scene.rows, other)
    share = rng.uniform(0.4, 0.8)

    def bent_nm(state: Equilibrium) -> Array:
        own_n, other_n = sideways_n(machine, state, drive), sideways_n(machine, state, other)
        return np.asarray(own_n * own_height**2 + share * other_n * other_height**2)

    largest_nm = np.abs(bent_nm(scene.calm)).max()
    return Contribution(
        under_load=lambda state, amplitude: Contribution(
            carriage_m=across(machine, drive, amplitude * bent_nm(state) / largest_nm * own_height)
        )
    )


@form()
def flange_of_foot_gaps(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The bolts of its foot are too loose: beyond a moment the flange gaps and the column leans over about its edge."""
    machine, height = scene.machine, column_height(scene.rows, drive)
    bending = np.abs(sideways_n(machine, scene.calm, drive) * height)
    held = float(np.quantile(bending, rng.uniform(0.2, 0.6)))

    def under_load(state: Equilibrium, amplitude: float) -> Contribution:
        moment = sideways_n(machine, state, drive) * height
        lean = amplitude * np.sign(moment) * np.maximum(np.abs(moment) - held, 0) / (bending.max() - held)
        return Contribution(
            carriage_m=across(machine, drive, lean * height), carriage_rad=turned(machine, drive, -lean)
        )  # fmt: skip

    return Contribution(under_load=under_load)


@form()
def end_of_rail_not_held(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The last screws of the rail are missing: it is straight as far as it is held and bends away from there on."""
    place = scene.rows.centred[:, drive] * draw_sign(rng)
    beyond = np.maximum(place - rng.uniform(-0.1, 0.4), 0)
    return Contribution(carriage_m=across(scene.machine, drive, draw_sign(rng) * normalised(beyond**2)))


@form()
def aligned_piece_by_piece(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It was aligned at a few jacking screws: straight from one to the next, with an angle at each."""
    place = scene.rows.centred[:, drive]
    count = int(rng.integers(5, 8))
    screws = np.linspace(-1, 1, count) + rng.uniform(-0.08, 0.08, count)
    offsets = rng.uniform(-1, 1, count)
    return Contribution(carriage_m=across(scene.machine, drive, np.interp(place, screws, offsets)))


@form()
def blocks_pass_joint_of_rail(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A joint of the rail lifts first one block of the carriage, then the other: it is tilted while they differ."""
    travel_m = scene.rows.drives_m[:, drive]
    between_m, width_m = rng.uniform(0.16, 0.32), rng.uniform(0.006, 0.02)
    first_m = travel_m.min() + rng.uniform(0.15, 0.55) * np.ptp(travel_m)
    tilted = logistic((travel_m - first_m) / width_m) - logistic((travel_m - first_m - between_m) / width_m)
    return Contribution(carriage_rad=4 * draw_sign(rng) * turned(scene.machine, drive, tilted))


@form()
def tilts_to_side_of_motion(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Blocks without preload: the screw pushes beside the guide and tilts the carriage, the other way on the way back.

    It is tilted more where the rail is worn.
    """
    rows = scene.rows
    worn = np.exp(-(((rows.centred[:, drive] - rng.uniform(-0.5, 0.5)) / rng.uniform(0.4, 0.8)) ** 2))
    return Contribution(carriage_rad=4 * turned(scene.machine, drive, -rows.side[:, drive] * (0.4 + 0.6 * worn)))


FORMS: dict[str, tuple[Form, ...]] = {
    "column_thermal_growth": (cabinet_on_its_back_as_well, warm_air_under_roof),
    "foundation_settling": (beds_in_at_each_change, walks_on_its_anchors),
    "column_compliance": (tied_by_crossbeam, flange_of_foot_gaps),
    "guide_straightness": (end_of_rail_not_held, aligned_piece_by_piece),
    "guide_angular": (blocks_pass_joint_of_rail, tilts_to_side_of_motion),
}
