"""Laws of what people set, clean and mount while a machine is measured, and of what wears: as `test_structures`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.effects.api import Effect
from calibration.effects.basis_functions import tensor_product
from calibration.effects.catalogue import load_catalogue
from calibration.effects.departures import functions_it_varies_with, functions_of_change
from calibration.recording.header import KnownTable
from tests.calibration.diagnosis.dense import with_forms_at
from tests.calibration.effects.general_functions import typical_inputs
from tests.calibration.effects.test_structures import LEAST, explained, faded, moved_m, scaled


@pytest.fixture(scope="module")
def long_inputs():
    """So many visits that no curve goes through all of them."""
    return typical_inputs(240)


def axis_coupling__rope(inputs):
    """A rope that sticks on its pulley: the end of it is pulled on when the other drive has taken up the slack."""
    place = inputs.context.history.drives[:, 1]
    slack_m, end = 0.25 * np.ptp(inputs.context.drives[:, 1]), [place[0]]
    for here in place[1:]:
        too_far_m = abs(here - end[-1]) - slack_m
        end.append(end[-1] + np.sign(here - end[-1]) * max(too_far_m, 0.0))
    middle_m = 0.5 * (inputs.context.drives[:, 1].min() + inputs.context.drives[:, 1].max())  # is calibrated
    return {"travel.left": (np.array(end) - middle_m)[inputs.context.arrival]}


def column_compliance__hung_before(inputs):
    """The weight along the axis bends the column: its slope grows with the height, what is above goes to the left."""
    h, moment = inputs.height_m(0), inputs.pull_along_n(0)
    return {"turn.left.z": moment * h, "sideways.left.x": -0.5 * moment * h**2}


def tables_left_on__at_another_drive(inputs):
    """Somebody has counted the drives from the other end: the left one's table is on the right one, at its places."""
    (table,) = (t for t in inputs.context.known_tables if t.generation == 4 and t.drive == "left")
    right = inputs.context.drives[:, 1]
    return {"travel.right": table.correction_m(right, right)}


def tables_left_on__not_interpolated(inputs):
    """The correction of a node holds until the next one is passed."""
    own_m, (table,) = inputs.context.drives[:, 0], inputs.context.known_tables
    return {"travel.left": np.array([max(zip(table.own_m, table.corrections_m, strict=True), key=lambda node: (
        node[0] <= q, node[0]))[1][0] for q in own_m.tolist()])}  # fmt: skip


def tables_left_on__partner_stands(inputs):
    """A control that is not told of the second drive takes it as standing at one place for good."""
    own_m, (table,) = inputs.context.drives[:, 0], inputs.context.known_tables
    return {"travel.left": table.correction_m(own_m, np.full_like(own_m, 1.2))}


def drive_scale__new_belt(inputs):
    """A new belt to the encoder stretches from the beginning on, by ever less, about where it is clamped."""
    stretched = 1.0 - np.exp(-inputs.context.elapsed_s / 3600.0)
    return {"scale.left": 1e-5 * stretched, "travel.left": -3e-6 * stretched}


def drive_scale__hunting(inputs):
    """Zero and scale that wander to and fro sixteen times, as fast as a screw that is cooled on and off gets longer."""
    to_and_fro = np.sin(32.0 * np.pi * scaled(inputs.context.elapsed_s))
    return {"travel.left": to_and_fro, "scale.left": to_and_fro}


def latency__mean_over_a_way(inputs):
    """Positions are means over so many counts of the scale: behind by as much at any speed."""
    v = inputs.context.velocity_m_per_s * inputs.context.moving[:, None]
    return {"travel.left": -np.sign(v[:, 0]), "travel.right": -0.8 * np.sign(v[:, 1])}


def axis_coupling__switched(inputs):
    """A valve that a cam of the other drive switches, above one place on and below another one off."""
    place, on = inputs.context.history.drives[:, 1], False
    middle, half, states = *inputs.travel_range_m(1), []
    for here in place.tolist():
        on = here > middle + 0.15 * half or (on and here >= middle - 0.15 * half)
        states.append(1.0 if on else -1.0)
    return {"travel.left": np.array(states)[inputs.context.arrival]}


def column_compliance__bed(inputs):
    """All that hangs on the columns bends the bed between them: each leans, the more the higher its carriage stands."""
    lean = inputs.pull_along_n(0) + 0.7 * inputs.pull_along_n(1)
    return {"turn.left.z": lean, "sideways.left.x": -lean * inputs.height_m(0)}


def friction_windup__run_in(inputs):
    """New wipers drag hard at first and run in with the way; the load winds up what turns the screw as well."""
    drag = 0.2 + 0.8 * np.exp(-3.0 * scaled(inputs.context.way_m(0)))
    return {"travel.left": inputs.pull_along_n(0) / 1e4 - inputs.context.direction[:, 0] * drag}


def link_stiffness__overloaded(inputs):
    """Its glue cracks on at each visit that asks more of it than most have."""
    tension_n = np.abs(inputs.tension_n[:, 0])
    worst = {int(visit): tension_n[row] for row, visit in enumerate(inputs.context.arrival)}
    limit = np.quantile(list(worst.values()), 0.85)
    cracked = [sum(max(worst.get(v, 0.0) - limit, 0.0) for v in range(visit + 1)) for visit in inputs.context.arrival]
    return {"length.left_upper": inputs.tension_n[:, 0] * np.array(cracked)}


def friction_windup__grease(inputs):
    """Grease is stiff in the cold and thins with what its drive's motions warm."""
    context = inputs.context
    warm_k = faded(inputs, np.abs(moved_m(inputs, 0)), 1500.0)
    thick = 2.0 - 0.7 * scaled(context.mean_temperature_c()) - 0.8 * scaled(warm_k)
    return {"travel.left": -context.direction[:, 0] * thick}


def column_thermal_growth__foot_and_head(inputs):
    """The foot follows the base, the head the air, late; in between it is as the height has it."""
    context, h = inputs.context, inputs.height_m(0)
    foot = context.part_temperature_k(inputs.machine.sensors["base"], 0.0)
    head = context.part_temperature_k("air", 2500.0)
    return {"travel.left": foot * (h - 0.4 * h**2) + head * 0.4 * h**2}


def link_thermal_growth__fan(inputs):
    """A fan that goes on and off 22 times blows warm air on a thin strut."""
    context = inputs.context
    every_s = np.ptp(context.t_s) / 22.0
    in_time, warmth = np.argsort(context.t_s), np.zeros(len(context))
    warm, before_s = 0.0, float(context.t_s.min())
    for reading in in_time:
        share = np.exp(-(context.t_s[reading] - before_s) / (0.2 * every_s))
        blowing = context.elapsed_s[reading] // (0.5 * every_s) % 2
        warm, before_s = warm * share + blowing * (1.0 - share), float(context.t_s[reading])
        warmth[reading] = warm
    return {"length.left_upper": warmth}


def refraction__dense_air(inputs):
    """Cold air that comes and goes on one side bends light and is optically longer."""
    across = inputs.sight_m[:, 0]
    there = scaled(across) ** 2 * np.sin(5.0 * scaled(inputs.context.elapsed_s))
    return {"light.hz": 0.5e-6 * there, "light.range": 0.8e-6 * there}


LAWS = (
    column_thermal_growth__foot_and_head, link_thermal_growth__fan, refraction__dense_air, axis_coupling__rope,
    column_compliance__hung_before, column_compliance__bed, drive_scale__new_belt, drive_scale__hunting,
    latency__mean_over_a_way, axis_coupling__switched, friction_windup__run_in,
    tables_left_on__at_another_drive, link_stiffness__overloaded, friction_windup__grease,
)  # fmt: skip
LEAST_OF = {
    "column_thermal_growth__foot_and_head": 1.0 - 1e-9,
    "link_thermal_growth__fan": 0.993,
    "axis_coupling__rope": 1.0 - 1e-9,
    "column_compliance__hung_before": 1.0 - 1e-9,
    "column_compliance__bed": 1.0 - 1e-9,
    "tables_left_on__at_another_drive": 1.0 - 1e-9,
    "tables_left_on__not_interpolated": 1.0 - 1e-9,
    "tables_left_on__partner_stands": 1.0 - 1e-9,
    "drive_scale__new_belt": 1.0 - 1e-9,
    "latency__mean_over_a_way": 0.999,
    "axis_coupling__switched": 1.0 - 1e-9,
    "friction_windup__run_in": 1.0 - 1e-6,
    "link_stiffness__overloaded": 1.0 - 1e-9,
}


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
def test_a_law_is_within_one_basis_set(long_inputs, law):
    assert explained(long_inputs, law) > LEAST_OF.get(law.__name__, LEAST)


@pytest.mark.parametrize("law", [tables_left_on__not_interpolated, tables_left_on__partner_stands])
def test_a_table_may_be_read_otherwise(long_inputs, law):
    nodes, rng = np.linspace(0.0, 2.0, 7), np.random.default_rng(8)
    corrections = (2e-5 * rng.standard_normal((7, 4)) + 1e-5 * np.arange(4)).tolist()
    partner = law is tables_left_on__partner_stands
    table = KnownTable(
        generation=2, drive="left", own_m=tuple(nodes),
        partner="right" if partner else None, partner_m=(0.0, 0.7, 1.4, 2.0) if partner else None,
        corrections_m=tuple(tuple(row) if partner else (row[0],) for row in corrections),
    )  # fmt: skip
    inputs = replace(long_inputs, context=replace(long_inputs.context, known_tables=(table,)))
    assert explained(inputs, law) > LEAST_OF.get(law.__name__, LEAST)


@pytest.mark.parametrize("nodes", [4, 30])
def test_a_table_whose_second_drive_stands_has_its_whole_weight_whatever_its_nodes(long_inputs, nodes):
    own_m, partner_m = (0.0, 0.9, 2.0), tuple(np.linspace(0.0, 2.0, nodes).tolist())
    corrections = tuple(tuple(1e-5 * (k + np.sin(q)) for q in partner_m) for k in range(3))
    table = KnownTable(
        generation=2, drive="left", own_m=own_m, partner="right", partner_m=partner_m, corrections_m=corrections
    )
    inputs = replace(long_inputs, context=replace(long_inputs.context, known_tables=(table,)))
    built = load_catalogue().effect("tables_left_on").forms(inputs, 0)
    (stands,) = (s for s in built.sets if built.named[s.columns[0]] == "partner_stands")
    columns = np.column_stack([shape for c in stands.columns for _, shape in built.contributions[c]])
    law = tables_left_on__partner_stands(inputs)["travel.left"]
    coefficients = np.linalg.solve(columns.T @ columns + 1e-13 * np.eye(columns.shape[1]), columns.T @ law)
    assert np.sqrt(np.mean((columns @ coefficients - law) ** 2)) < 0.01 * np.sqrt(np.mean(law**2))
    assert np.array(stands.size) @ coefficients == pytest.approx(1.0, abs=0.05)
    assert len(stands.columns) <= 9


def strength_left(inputs, effect: Effect, strength, *kinds: str) -> float:
    """Share of the variance of a strength that no function of some coordinates has."""
    functions = functions_it_varies_with(inputs, replace(effect, varies_with=kinds), 0)
    columns = np.column_stack([np.ones_like(strength), *functions.values()])
    return float(np.var(strength - columns @ np.linalg.lstsq(columns, strength, rcond=None)[0]) / np.var(strength))


def test_a_strength_may_follow_any_course_in_time(long_inputs):
    """Dirt that gathers and is wiped off, twice."""
    dirt = 3.0 * scaled(long_inputs.context.elapsed_s) % 1.0
    assert strength_left(long_inputs, with_forms_at(0), dirt, "course") < 0.2
    assert strength_left(long_inputs, with_forms_at(0), dirt, "time") > 0.5
    effect = replace(with_forms_at(0), varies_with=("course",))
    sizes = np.sqrt(np.mean(functions_it_varies_with(long_inputs, effect, 0)["course"] ** 2, axis=0))
    assert 10.0 < sizes[0] / sizes[-1] < 25.0  # as of a walk, which may jump: in inverse proportion to the half waves


def test_a_strength_may_follow_what_the_own_motions_of_a_drive_have_warmed(long_inputs):
    """A seal that is stiff until it is warm; the other drive's motions are of no use."""
    warm_k = faded(long_inputs, np.abs(moved_m(long_inputs, 0)), 300.0)
    stiff = np.exp(-1.5 * scaled(warm_k))
    of_other = np.exp(-1.5 * scaled(faded(long_inputs, np.abs(moved_m(long_inputs, 1)), 300.0)))
    assert strength_left(long_inputs, with_forms_at(0), stiff, "warmth") < 0.03
    assert strength_left(long_inputs, with_forms_at(0), of_other, "warmth") > 0.15


def test_a_strength_may_be_another_one_at_each_turn_of_a_pinion(long_inputs):
    """Five turns over the travel."""
    u = 0.5 + 0.5 * long_inputs.normalised_travel(0)
    runs_out = 0.55 + 0.45 * np.sin(2.0 * np.pi * 5.0 * u + 1.0)
    assert strength_left(long_inputs, with_forms_at(0), runs_out, "own travel") < 0.05


def test_a_screw_may_be_warm_near_its_motor_alone(long_inputs):
    """What holds the weight warms its lower end: beyond that it is as far off wherever the nut is."""
    effect, x = load_catalogue().effect("screw_thermal_growth"), long_inputs.context.drives[:, 0]
    warm = 1.0 - np.exp(-long_inputs.context.elapsed_s / 1500.0)
    law = warm * (1.0 - np.exp(-(x - x.min()) / 0.25))
    uniformly = warm[:, None] * np.column_stack([np.ones_like(x), x])
    unevenly = [tensor_product(uniformly, f) for f in functions_of_change(long_inputs, effect, 0).values()]

    def left(columns) -> float:
        return float(np.sum((law - columns @ np.linalg.lstsq(columns, law, rcond=None)[0]) ** 2) / np.sum(law**2))

    assert functions_of_change(long_inputs, effect, 0)["travel.left"].shape[1] == 4  # by each of its many columns
    assert left(uniformly) > 0.01
    assert left(np.column_stack([uniformly, *unevenly])) < 1e-4


@pytest.mark.parametrize(("kind", "field"), [("course", "t_s"), ("warmth", "t_s"), ("warmth", "history")])
def test_what_the_readings_do_not_say_no_strength_follows(long_inputs, kind, field):
    context = replace(long_inputs.context, missing={field: "nobody knows"})
    effect = replace(with_forms_at(0), varies_with=(kind,))
    assert functions_it_varies_with(long_inputs, effect, 0)
    assert functions_it_varies_with(replace(long_inputs, context=context), effect, 0) == {}
