"""Effects of stated values against the machine's own model with another value: solved again, reading by reading."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from calibration.diagnosis.channels import Channels
from calibration.diagnosis.effect_inputs import inputs_of_readings, inputs_of_recording, periodograms
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.linear_model import LinearModel, linearise_recording
from calibration.diagnosis.search import search_causes
from calibration.diagnosis.twin.twin import Twin
from calibration.effects.api import EffectInputs
from calibration.effects.catalogue import load_catalogue
from calibration.effects.columns import Contributions
from calibration.effects.tables_left_on import PART_TERMS
from calibration.machine.description import PARTS
from calibration.model.model import Model, SystematicUncertainties
from calibration.model.parameters import ParameterSet
from calibration.model.visits import Visits
from calibration.recording.header import KnownTable
from calibration.recording.recording import Recording
from tests.calibration.diagnosis.campaigns import plant, recorded
from tests.calibration.effects.test_context import SWING

CATALOGUE = load_catalogue()
PER_K, KG, SHIFT_M, WEIGHT = 2e-6, 20.0, 3e-5, 0.7
LEVER_M = 0.25
TABLES = tuple(
    KnownTable(
        generation=generation,
        drive=drive,
        own_m=(0.3, 0.7, 1.1, 1.7),
        partner=partner,
        partner_m=(0.3, 1.0, 1.7),
        corrections_m=tuple(
            tuple(1e-4 * np.random.default_rng([generation, drive == "left", k]).standard_normal(3)) for k in range(4)
        ),
    )
    for generation in (2, 5)
    for drive, partner in (("left", "right"), ("right", "left"))
)


@dataclass(frozen=True)
class Rig:
    """A campaign with a swing of the temperature, payloads and known tables, and the model that was fitted to it."""

    linear: LinearModel
    channels: Channels
    inputs: EffectInputs

    def shift_m(self, name: str, channel: str, size: float, place: int = 0, **parameters: float) -> np.ndarray:
        """What the first basis set of an effect that begins at a channel changes (n, 3)."""
        built = CATALOGUE.effect(name).forms(self.inputs, place)
        for basis_set in built.sets:
            column = built.contributions[basis_set.columns[0]]
            if column[0][0] == channel and all(basis_set.parameters.get(k) == v for k, v in parameters.items()):
                return self.of_columns([column], [size])
        raise AssertionError(f"{name} has no basis set at {channel}")

    def of_columns(self, columns: Sequence[Contributions], coefficients: Sequence[float]) -> np.ndarray:
        out = np.zeros((len(self.linear.smr), 3))
        for column, coefficient in zip(columns, coefficients, strict=True):
            for channel, shape in column:
                out += coefficient * self.channels.shift_m(channel) * shape[:, None]
        return out

    def solved_m(self, change: Callable[[Visits], Visits], **values: float) -> np.ndarray:
        """Places (n, 3) of the readings' reflectors by the model with other visits or values of its unknowns."""
        linear = self.linear
        everything = SystematicUncertainties(1.0, 1.0, dict.fromkeys(PARTS, 1.0))
        model = Model(ParameterSet.of(linear.machine), everything)
        start = dict(zip([u.name for u in linear.poses.model.unknowns], linear.values.tolist(), strict=False))
        start |= {name.replace("__", "."): value for name, value in values.items()}
        at = np.array([start.get(u.name, 0.0) for u in model.unknowns])
        poses = model.predict(at, change(linear.poses.visits), linear.poses.equilibrium.coordinates())
        assert np.all(poses.equilibrium.converged)
        out = np.zeros((len(linear.smr), 3))
        for smr in np.unique(linear.smr[linear.visit >= 0]):
            rows = np.flatnonzero(linear.smr == smr)
            out[rows] = poses.reflector_m(int(smr), linear.mounted_m[smr])[linear.visit[rows]]
        return out

    def change_m(self, change: Callable[[Visits], Visits] = lambda visits: visits, **values: float) -> np.ndarray:
        return self.solved_m(change, **values) - self.solved_m(lambda visits: visits)


@pytest.fixture(scope="module")
def recording() -> Recording:
    made = recorded(plant(60, seed=3, temperature_programme=SWING))
    return replace(made, file=made.file.model_copy(update={"known_tables": TABLES}))


@pytest.fixture(scope="module")
def rig(recording) -> Rig:
    linear = linearise_recording(recording)
    channels = Channels(linear)
    onsets = [(0.4 * float(linear.context.elapsed_s.max()), 1.0)]
    return Rig(linear, channels, inputs_of_readings(linear, channels, lambda *_: [], lambda _: onsets))


def check_same(predicted_m: np.ndarray, true_m: np.ndarray, rel: float = 2e-3) -> None:
    assert np.abs(true_m).max() > 1e-8
    np.testing.assert_allclose(predicted_m, true_m, atol=rel * np.abs(true_m).max())


@pytest.mark.parametrize("part", PARTS)
def test_a_part_with_another_coefficient_grows_with_its_own_sensor(rig, part):
    fitted = dict(zip([u.name for u in rig.linear.poses.model.unknowns], rig.linear.values.tolist(), strict=False))
    name = f"expansion.{part}"
    true_m = rig.change_m(**{f"expansion__{part}": fitted.get(name, 0.0) + PER_K})
    # The model takes one temperature a visit, columns that of each reading.
    check_same(rig.shift_m("expansion_coefficient", f"growth.{part}", PER_K), true_m, rel=2e-2)


def test_a_payload_is_heavier_in_proportion_or_by_what_was_not_counted(rig):
    built, largest_kg = CATALOGUE.effect("payload").forms(rig.inputs, 0), float(rig.inputs.context.payload_kg.max())
    by_mass = [
        built.contributions[s.columns[0]]
        for s in built.sets
        if built.contributions[s.columns[0]][0][0] == "payload.mass"
    ]

    def heavier(kg: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        return rig.change_m(lambda v: replace(v, payload_kg=v.payload_kg + kg(v.payload_kg)))

    check_same(rig.of_columns(by_mass[:1], [KG]), heavier(lambda kg: KG * kg / largest_kg))
    not_counted = next(c for c in by_mass if np.ptp(c[0][1][rig.inputs.context.payload_kg > 0.0]) == 0.0)
    check_same(rig.of_columns([not_counted], [KG]), heavier(lambda kg: np.where(kg > 0.0, KG, 0.0)))


def test_a_centre_beside_the_stated_one_turns_the_platform_as_its_moment_does(rig):
    built, largest_kg = CATALOGUE.effect("payload").forms(rig.inputs, 0), float(rig.inputs.context.payload_kg.max())
    along_x = [c for c in built.contributions if c[0][0] == "payload.x"]
    shift = np.array([1.0, 0.0, 0.0])
    moved = rig.change_m(lambda v: replace(v, payload_com_m=v.payload_com_m + KG * LEVER_M / largest_kg * shift))
    check_same(rig.of_columns(along_x[:1], [KG]), moved)

    def by_moment(visits: Visits) -> Visits:
        metres = KG * LEVER_M / np.maximum(visits.payload_kg, 1e-3)
        return replace(visits, payload_com_m=visits.payload_com_m + metres[:, None] * shift)

    check_same(rig.of_columns(along_x[1:2], [KG]), rig.change_m(by_moment))


def test_a_centre_that_slips_lies_elsewhere_from_then_on_whenever_it_is_mounted(rig):
    """Two moments, asked along each axis of the centre; before and after them each has a centre of its own."""
    context, asked = rig.inputs.context, {}
    moments = (1000.0, 2500.0)

    def strength_onsets(name, column):
        asked[name] = column[0][0]
        return [(moments[len(asked) % 2], 0.25)]

    built = CATALOGUE.effect("payload").forms(replace(rig.inputs, strength_onsets=strength_onsets), 0)
    of_centre = {name: channel for name, channel in asked.items() if ".slipped." in name}
    assert sorted(of_centre.values()) == ["payload.x", "payload.y"]
    kg = context.payload_kg
    mounted = np.where(kg > 0.0, 1.0, 0.0) * LEVER_M / np.maximum(kg, 1e-3)
    for moment in moments:
        slipped = [s for s in built.sets if s.parameters.get("onset_s") == moment and len(s.columns) == 4]
        assert len(slipped) == 1
        (before_x, before_y, after_x, after_y) = (built.contributions[c][0] for c in slipped[0].columns)
        assert [before_x[0], before_y[0], after_x[0], after_y[0]] == ["payload.x", "payload.y"] * 2
        np.testing.assert_allclose(before_x[1], mounted * (context.elapsed_s < moment))
        assert slipped[0].spells == 2
        np.testing.assert_allclose(after_y[1], mounted * (context.elapsed_s >= moment))
        assert {built.named[c] for c in slipped[0].columns} == {"slipped"}


def test_a_table_of_which_a_transfer_has_left_a_part_is_told_by_its_own_basis_set(rig):
    """Each drive's table up to a place of its travel: nearly all of it, at once in all drives."""
    built, context = CATALOGUE.effect("tables_left_on").forms(rig.inputs, 0), rig.inputs.context
    drives = rig.inputs.machine.drive_names
    for generation in context.table_generations:
        corrections = context.table_corrections_m(generation, drives, context.drives)
        left = []
        for basis_set in built.sets:
            error = total = 0.0
            for a, name in enumerate(drives):
                q = context.drives[:, a]
                truth = corrections[:, a] * (q < np.quantile(q, 0.6))
                of_drive = [dict(built.contributions[c]).get(f"travel.{name}") for c in basis_set.columns]
                if columns := [shape for shape in of_drive if shape is not None and np.any(shape)]:
                    x = np.stack(columns, axis=1) / np.linalg.norm(columns, axis=1)
                    truth_left = truth - x @ np.linalg.lstsq(x, truth, rcond=None)[0]
                else:
                    truth_left = truth
                error, total = error + float(np.sum(truth_left**2)), total + float(np.sum(truth**2))
            left.append((error / total, len(basis_set.columns)))
        best, count = min(left)
        assert best < 0.1
        assert count == sum(PART_TERMS + 1 for column in corrections.T if np.any(column))


def test_a_strut_that_is_softer_makes_more_of_a_payload_beside_its_centre(rig):
    """What the struts' forces by a payload do at another stiffness, beyond what they do at the fitted one."""
    strut, softer = rig.linear.machine.strut_names[1], 0.1
    largest_kg, away = float(rig.inputs.context.payload_kg.max()), np.eye(3)[0] * 0.4

    def beside(visits: Visits) -> Visits:
        return replace(visits, payload_com_m=visits.payload_com_m + away)

    unknowns = [u.name for u in rig.linear.poses.model.unknowns]
    fitted = float(rig.linear.values[unknowns.index(f"ln_stiffness.{strut}")])
    stiff = {f"ln_stiffness__{strut}": fitted - softer}
    cross_m = rig.change_m(beside, **stiff) - rig.change_m(lambda visits: visits, **stiff) - rig.change_m(beside)
    built = CATALOGUE.effect("payload").forms(rig.inputs, 0)
    own = [c for s in built.sets for c in s.columns if built.contributions[c][0][0] == f"length.{strut}"]
    of_shift = next(built.contributions[c] for c in own if built.named[c] == "shifted")
    size_kg = away[0] * largest_kg / LEVER_M
    check_same(rig.of_columns([of_shift], [size_kg * (np.exp(softer) - 1.0)]), cross_m, rel=0.1)


def test_a_table_that_is_on_adds_its_corrections_to_the_commands(rig):
    """Generation 5 in both drives, and in one alone."""
    names, (left, right) = rig.linear.machine.drive_names, TABLES[2:]
    assert {table.generation for table in TABLES[2:]} == {5}

    def corrected(drives: np.ndarray, both: bool) -> np.ndarray:
        added = [left.correction_m(drives[:, 0], drives[:, 1]), right.correction_m(drives[:, 1], drives[:, 0])]
        return drives + WEIGHT * np.column_stack([added[0], both * added[1]])

    assert names == ("left", "right")
    both_m = rig.change_m(lambda v: replace(v, drives=corrected(v.drives, True)))
    check_same(rig.shift_m("tables_left_on", "table.5", WEIGHT), both_m, rel=1e-2)
    built = CATALOGUE.effect("tables_left_on").forms(rig.inputs, 0)
    alone = [c for c, form in zip(built.contributions, built.named, strict=True) if form == "one_drive"]
    alone = [c for c in alone if c[0][0] == "travel.left"]
    left_m = rig.change_m(lambda v: replace(v, drives=corrected(v.drives, False)))
    check_same(rig.of_columns(alone[1:], [WEIGHT]), left_m, rel=1e-2)


def test_a_table_may_be_switched_on_or_off_in_the_middle(rig):
    built, t = CATALOGUE.effect("tables_left_on").forms(rig.inputs, 0), rig.inputs.context.elapsed_s
    onset_s = 0.4 * float(t.max())
    switched = [built.contributions[s.columns[0]][0] for s in built.sets if s.parameters.get("onset_s") == onset_s]
    whole = [shape for channel, shape in switched if channel.startswith("table.")]
    assert {channel for channel, _ in switched} == {"table.2", "table.5"}
    late, early = (t >= onset_s).astype(float), (t < onset_s).astype(float)
    assert all(np.array_equal(shape, wanted) for shape, wanted in zip(whole, (late, early) * 2, strict=True))
    without_time = replace(rig.inputs, context=replace(rig.inputs.context, breaks_s=(1.0,)))
    assert not any(s.parameters for s in CATALOGUE.effect("tables_left_on").forms(without_time, 0).sets)


def test_each_direction_may_have_the_table_of_another_generation(rig):
    """Interpolated by another library, forwards from one generation and backwards from the other."""
    built, context = CATALOGUE.effect("tables_left_on").forms(rig.inputs, 0), rig.inputs.context
    drives = rig.linear.machine.drive_names

    def interpolated(generation: int, drive: int) -> np.ndarray:
        (table,) = (t for t in TABLES if t.generation == generation and t.drive == drives[drive])
        grid = RegularGridInterpolator(
            (table.own_m, table.partner_m), np.array(table.corrections_m), bounds_error=False
        )
        own, partner = (
            np.clip(context.drives[:, d], nodes[0], nodes[-1])
            for d, nodes in ((drive, table.own_m), (1 - drive, table.partner_m))
        )
        return np.asarray(grid(np.stack([own, partner], axis=1)))

    found = [dict(built.contributions[k]) for k, name in enumerate(built.named) if name == "by_direction"]
    assert len(found) == 2
    for forwards, backwards in ((2, 5), (5, 2)):
        wanted = {
            f"travel.{name}": np.where(
                context.direction[:, d] < 0.0, interpolated(backwards, d), interpolated(forwards, d)
            )
            for d, name in enumerate(drives)
        }
        alike = [
            columns
            for columns in found
            if all(np.allclose(columns[c], wanted[c], rtol=0.0, atol=1e-12) for c in wanted)
        ]
        assert len(alike) == 1
    (shares,) = (s.columns for s in built.sets if len(s.columns) == 8)  # 2 generations, drives and directions
    parts = [built.contributions[c][0] for c in shares]
    for d, name in enumerate(drives):
        own = [shape for channel, shape in parts if channel == f"travel.{name}"]
        whole = sum(interpolated(generation, d) for generation in (2, 5))
        assert np.allclose(np.sum(own, axis=0), whole, rtol=0.0, atol=1e-12)
        assert all(len(set(context.direction[shape != 0.0, d] < 0.0)) == 1 for shape in own)
    assert np.any(context.direction < 0.0)
    assert np.any(context.direction > 0.0)


@pytest.mark.parametrize("moved_m", [-0.18, 0.05, 0.11])
def test_a_zero_that_was_moved_leaves_a_table_beside_its_place(rig, moved_m):
    """What it then corrects is within one basis set, though no column was computed for this very distance."""
    built, context = CATALOGUE.effect("tables_left_on").forms(rig.inputs, 0), rig.inputs.context
    left = next(t for t in TABLES if t.generation == 5 and t.drive == "left")
    grid = RegularGridInterpolator((left.own_m, left.partner_m), np.array(left.corrections_m))
    own = np.clip(context.drives[:, 0] + moved_m, left.own_m[0], left.own_m[-1])
    wanted = grid(np.stack([own, np.clip(context.drives[:, 1], left.partner_m[0], left.partner_m[-1])], axis=1))

    def left_over(columns: tuple[int, ...]) -> float:
        part = np.stack([dict(built.contributions[c]).get("travel.left", 0.0 * wanted) for c in columns], axis=1)
        return float(np.linalg.norm(wanted - part @ np.linalg.lstsq(part, wanted, rcond=None)[0]))

    beside = [s.columns for s in built.sets if len(s.columns) < 0.2 * len(wanted)]
    assert min(left_over(columns) for columns in beside) < 0.2 * np.linalg.norm(wanted)


def test_a_table_without_corrections_makes_no_empty_basis_set(rig):
    without = tuple(t.model_copy(update={"corrections_m": ((0.0,) * 3,) * 4}) for t in TABLES)
    context = replace(rig.inputs.context, known_tables=without)
    built = CATALOGUE.effect("tables_left_on").forms(replace(rig.inputs, context=context), 0)
    assert built.sets
    assert all(basis_set.columns for basis_set in built.sets)


@pytest.mark.parametrize("drive", ["left", "right"])
def test_a_scale_that_changes_moves_the_end_of_the_travel_by_its_size_from_the_moment_on(rig, drive):
    machine, context = rig.linear.machine, rig.linear.context
    a, onset_s = machine.drive_names.index(drive), 0.4 * float(context.elapsed_s.max())
    middle, half = machine.travel[a].mean(), 0.5 * np.ptp(machine.travel[a])

    def scaled(visits: Visits) -> Visits:
        drives = visits.drives.copy()
        drives[:, a] += SHIFT_M * (drives[:, a] - middle) / half
        return replace(visits, drives=drives)

    after = (context.elapsed_s >= onset_s)[:, None]
    check_same(rig.shift_m("drive_scale", f"scale.{drive}", SHIFT_M, a, onset_s=onset_s), after * rig.change_m(scaled))
    zero_m = rig.change_m(lambda v: replace(v, drives=v.drives + SHIFT_M * np.eye(2)[a]))
    check_same(rig.shift_m("drive_scale", f"travel.{drive}", SHIFT_M, a, onset_s=onset_s), after * zero_m)


def test_a_drive_may_be_homed_at_each_payload_exchange_and_step_several_times(rig):
    context, machine = rig.linear.context, rig.linear.machine
    onsets = {"travel.left": (200.0, 400.0), "scale.left": (300.0, 500.0, 700.0)}
    inputs = replace(rig.inputs, onsets=lambda channels: [(onset, 0.1) for onset in onsets[channels[0]]])
    built = CATALOGUE.effect("drive_scale").forms(inputs, 0)

    def steps(channel: str, form: str) -> np.ndarray:
        columns = (c for c, named in zip(built.contributions, built.named, strict=True) if named == form)
        return np.array([shape for ((at, shape),) in columns if at == channel])

    numbers = np.arange(1, int(context.exchanges.max()) + 1)
    assert len(numbers) > 1
    assert np.array_equal(steps("travel.left", "exchanges"), context.exchanges >= numbers[:, None])
    several = steps("scale.left", "") * 0.5 * np.ptp(machine.travel[0])  # with each of two sets
    for onset in onsets["scale.left"]:
        assert any(np.allclose(shape, context.elapsed_s >= onset) for shape in several)
    assert len(steps("travel.left", "zero")) == len(onsets["travel.left"])


def with_scale(rig: Rig) -> np.ndarray:
    """The right drive's scale and zero from a third of the campaign on."""
    context, travel = rig.linear.context, rig.linear.machine.travel[1]
    share = (rig.linear.poses.visits.drives[:, 1] - travel.mean()) / (0.5 * np.ptp(travel))
    shift = np.column_stack([np.zeros(len(share)), 1e-4 * share + 2e-5])
    after = context.elapsed_s >= context.elapsed_s.max() / 3.0
    return after[:, None] * rig.change_m(lambda v: replace(v, drives=v.drives + shift))


def with_table(rig: Rig) -> np.ndarray:
    context, drives = rig.linear.context, rig.linear.poses.visits.drives
    corrections = context.table_corrections_m(2, rig.linear.machine.drive_names, drives)
    after = context.elapsed_s >= context.elapsed_s.max() / 3.0
    return after[:, None] * rig.change_m(lambda v: replace(v, drives=v.drives + corrections))


PLANTED: dict[str, tuple[float, str, Callable[[Rig], np.ndarray]]] = {
    "expansion_coefficient": (8e-6, "", lambda rig: 8e-6 / PER_K * rig.change_m(expansion__struts=PER_K)),
    "payload": (400.0, "", lambda rig: rig.change_m(
        lambda v: replace(v, payload_com_m=v.payload_com_m + 400.0 * LEVER_M / v.payload_kg.max() * np.eye(3)[0])
    )),
    "tables_left_on": (1.0, "", with_table),
    "drive_scale": (1e-4, "right", with_scale),
}  # fmt: skip


@pytest.mark.parametrize("name", PLANTED)
def test_it_is_found_with_its_size_before_what_it_is_confounded_with_and_a_twin_does_the_same(rig, name):
    size, place, planted = PLANTED[name]
    linear, shift_m = rig.linear, planted(rig)
    moved = replace(
        linear,
        residual=linear.residual + linear.whiten_shift(shift_m),
        position_m=linear.position_m + shift_m @ linear.frame.rotation.T,
    )
    likelihood = MarginalLikelihood.of(moved)
    inputs = inputs_of_recording(likelihood, periodograms(likelihood))
    effect = CATALOGUE.effect(name)
    others = [CATALOGUE.effect(other) for other in effect.confounded]
    found = search_causes(likelihood, inputs, [effect, *(e for e in others if not e.curves(inputs, 0))])
    (cause,) = found.causes
    assert (cause.effect.name, cause.place) == (name, place)
    u = float(np.sqrt(cause.best.covariance[0, 0]))
    assert cause.best.coefficients[0] == pytest.approx(size, abs=3.0 * u + 0.01 * size)
    assert u < 0.1 * size
    made = Twin.from_diagnosis(likelihood, found.causes, inputs)
    twin = Twin.from_data(linear.machine.text, json.loads(json.dumps(made.to_data())))
    rows = np.flatnonzero(linear.visit >= 0)[::7]
    alone = replace(twin, added=()).readings_m(linear.context, rows, linear.smr[rows])
    got = twin.readings_m(linear.context, rows, linear.smr[rows]) - alone
    check_same(got, rig.of_columns(cause.contributions, twin.added[0].coefficients)[rows], rel=1e-2)
