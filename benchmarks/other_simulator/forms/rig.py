"""Forms of effects of the rig as a whole: time, coefficients of expansion, payload, tables that are still on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.shapes import draw_instant, draw_sign, level_direction, since
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.tables import corrections_of, newest, oldest

Array = NDArray[np.float64]
Generator = np.random.Generator

DELAYED_M, REFERENCE_M_PER_S = 5e-3, 0.05  # amplitude: the way in the delay at that speed
COEFFICIENT_PER_K, MASS_KG, OFF_M, TABLE_M = 1.35e-5, 130.0, 0.35, 4e-4


def delayed(scene: Scene, delay: Array | float) -> Contribution:
    """Drives that are read by a delay (r,) too late."""
    delays = np.broadcast_to(np.asarray(delay), (len(scene.rows),))[:, None]
    return Contribution(drives_m=-(scene.rows.velocity_m_per_s / REFERENCE_M_PER_S) * delays)


@form(DELAYED_M)
def constant(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Always the same delay."""
    return delayed(scene, draw_sign(rng))


@form(DELAYED_M)
def clock_runs_away(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A clock that runs away."""
    return delayed(scene, 0.2 + 0.8 * scene.rows.elapsed)


@form(DELAYED_M)
def jitter_of_bus(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Another delay at each reading."""
    return delayed(scene, 0.4 + rng.exponential(0.8, len(scene.rows)))


@form(DELAYED_M)
def filter_slower_when_slow(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A filter that is slower at low speed."""
    speed = np.linalg.norm(scene.rows.velocity_m_per_s, axis=1)
    return delayed(scene, 0.4 + 0.6 * np.exp(-speed / 0.08))


@form(DELAYED_M)
def jumps_after_reconnect(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A delay that jumps."""
    step_s = draw_instant(scene.rows, rng, 0.3, 0.7)
    late = delayed(scene, np.where(scene.rows.t_s > step_s, 1.0, 0.1))
    return Contribution(drives_m=late.drives_m, step_s=step_s)


def _coefficients(name: str, first: str, *others: str) -> Form:
    """A wrong coefficient of one group, and others by half as much."""

    def shape(scene: Scene, place: int, rng: Generator) -> Contribution:
        sign = draw_sign(rng)
        halves = {group: sign * float(rng.choice([-0.5, 0.5])) for group in others}
        return Contribution(expansion_per_k={first: float(sign), **halves})

    return form(COEFFICIENT_PER_K, name)(shape)


@form(MASS_KG)
def mass_wrong(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Every payload is heavier."""
    return Contribution(payload_kg=(scene.rows.payload > 0).astype(float))


@form(OFF_M)
def centre_to_the_side(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Every payload hangs to one side."""
    return Contribution(
        payload_centre_m=np.outer(scene.rows.payload > 0, level_direction(scene.machine) * draw_sign(rng))
    )


@form(MASS_KG)
def forgotten_tool_from_a_time(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Something heavy lies on the platform from a moment on."""
    step_s = draw_instant(scene.rows, rng)
    return Contribution(payload_kg=since(scene.rows, step_s), step_s=step_s)


@form(MASS_KG)
def one_payload_of_several(scene: Scene, place: int, rng: Generator) -> Contribution:
    """One payload is heavier."""
    payload = scene.rows.payload
    return Contribution(payload_kg=((payload == payload.max()) & (payload > 0)).astype(float))


@form(MASS_KG)
def mass_and_centre(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Every payload is heavier and hangs 3 mm to one side for each kilogram of it."""
    carried = scene.rows.payload > 0
    aside = level_direction(scene.machine) * draw_sign(rng) * 0.003
    return Contribution(payload_kg=carried.astype(float), payload_centre_m=np.outer(carried, aside))


@form(TABLE_M)
def all_of_a_generation(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The last tables are on."""
    return Contribution(drives_m=corrections_of(newest(scene.tables), scene.rows))


@form(TABLE_M)
def older_generation(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The first tables are on."""
    return Contribution(drives_m=corrections_of(oldest(scene.tables), scene.rows))


@form(TABLE_M)
def one_drive_only(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The last table of one drive is on."""
    drive = rng.integers(len(scene.machine.drives))
    tables = [table for table in newest(scene.tables) if table.drive == drive]
    return Contribution(drives_m=corrections_of(tables, scene.rows))


@form(TABLE_M)
def switched_on_by_a_restart(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The last tables come on at a moment."""
    step_s = draw_instant(scene.rows, rng)
    on = since(scene.rows, step_s)[:, None]
    return Contribution(drives_m=corrections_of(newest(scene.tables), scene.rows) * on, step_s=step_s)


@form(TABLE_M)
def on_until_noticed(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The first tables are on until a moment."""
    step_s = draw_instant(scene.rows, rng)
    on = (scene.rows.t_s < step_s)[:, None]
    return Contribution(drives_m=corrections_of(oldest(scene.tables), scene.rows) * on, step_s=step_s)


FORMS: dict[str, tuple[Form, ...]] = {
    "latency": (constant, clock_runs_away, jitter_of_bus, filter_slower_when_slow, jumps_after_reconnect),
    "expansion_coefficient": (
        _coefficients("struts", "struts"),
        _coefficients("scales", "drives"),
        _coefficients("base", "base"),
        _coefficients("struts_and_platform", "struts", "platform"),
        _coefficients("scales_against_base", "drives", "base"),
    ),
    "payload": (
        mass_wrong, centre_to_the_side, forgotten_tool_from_a_time, one_payload_of_several, mass_and_centre,
    ),
    "tables_left_on": (
        all_of_a_generation, older_generation, one_drive_only, switched_on_by_a_restart, on_until_noticed,
    ),
}  # fmt: skip
