"""What is said of two campaigns whose change, if there is one, the mock plant has carried out in its own way."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from benchmarks.comparison.change import Change, both
from benchmarks.comparison.planar import nominal
from benchmarks.comparison.spatial import Circumstances, SpatialCampaign
from benchmarks.comparison.visible import even, straight
from calibration.comparison.compare import compare
from calibration.comparison.result import Comparison
from calibration.diagnosis.linear_model import usable_rows
from calibration.machine.inverse import nominal_drives
from calibration.recording.recording import Recording
from mock_devices.known_tables import draw_known_tables
from mock_devices.plant.true_machine import TrueMachine, draw_machine
from mock_devices.settings import InstrumentProfile, MockSettings
from tests.calibration.comparison.pairs import LEVELS, MACHINE_SEED, first, recorded
from tests.calibration.diagnosis.campaigns import standing_off

OTHER_INSTRUMENT = InstrumentProfile(angle_sd_rad=4e-6, range_sd_m=2e-4, range_constant_u_m=3e-4)
LEFT, RIGHT = 0, 1
P1, N1 = 0, 5


@pytest.mark.parametrize(
    "circumstances",
    [
        {},
        {"station": 77, "station_position_m": (0.4, 0.1, 3.5), "heading_rad": 0.1},
        {"station": 78, "instrument": OTHER_INSTRUMENT},
        {"shop_c": 4.0, "design": 2},
    ],
    ids=["the same again", "station set up anew", "another instrument", "warmer, another payload"],
)
def test_what_is_no_change_of_the_machine_is_called_nothing(circumstances):
    result = compare(first(), recorded(**({"station": 2} | circumstances)))
    assert result.verdict == "nothing"
    assert result.ranking["nothing"] > 0.9
    assert sum(result.ranking.values()) == pytest.approx(1.0)
    assert not result.changes
    assert not result.machine_changed
    assert result.workspace is None
    assert 0.0 < result.hidden_m < 2e-5


def test_tables_that_are_on_are_no_change():
    tables = draw_known_tables(nominal()[0], np.random.default_rng(4))
    on = recorded(tables=tables, with_tables=True)
    assert np.any(on["compensation"] > 0.0)
    assert compare(first(), on).verdict == "nothing"
    # Were the tables not known to move the drives, they would be taken for one.
    silent = replace(on, columns={**on.columns, "compensation": np.zeros(len(on))})
    assert compare(first(), silent).verdict != "nothing"


CHANGES = {
    "drive_offset": (Change(travel={RIGHT: even(6e-5)}), "right", {"offset": 6e-5}),
    "drive_scale": (Change(travel={LEFT: straight(-7e-5)}), "left", {"scale": -7e-5}),
    "strut": (Change(length_m={2: 8e-5}), "right_upper", {"length": 8e-5}),
    "column": (Change(column_shift_m={LEFT: (1.5e-4, 0.0, 0.0)}), "left", {"shift_x": 1.5e-4}),
    "nest": (Change(smr_m={N1: (8e-5, -6e-5, 0.0)}), "N1", {"shift_x": 8e-5, "shift_y": -6e-5}),
}


@lru_cache(maxsize=len(CHANGES))
def comparison_after(structure: str) -> Comparison:
    return compare(first(), recorded(CHANGES[structure][0]))


@pytest.mark.parametrize("structure", CHANGES)
def test_a_change_is_named_at_its_place_with_its_size(structure):
    _, place, sizes = CHANGES[structure]
    result = comparison_after(structure)
    assert (result.verdict, result.place) == (structure, place)
    assert result.ranking[structure] > 0.8
    (found,) = result.changes
    assert found.place_probability > 0.9
    quantities = {q.name: q for q in found.quantities}
    for name, value in sizes.items():
        assert abs(quantities[name].value - value) < 4.0 * quantities[name].u + 0.03 * abs(value)
        assert 0.0 < quantities[name].u < 0.2 * abs(value)
    assert found.of_machine == result.machine_changed == (structure != "nest")
    assert (found.workspace is None) == (structure == "nest")


def test_a_curve_of_a_screw_is_named_with_its_size():
    def bowed(q):
        return 6e-5 * np.cos(2.0 * np.pi * (q - 0.32) / 1.38)

    result = compare(first(), recorded(Change(travel={RIGHT: bowed})))
    assert (result.verdict, result.place) == ("screw_curve", "right")
    (quantity,) = result.changes[0].quantities
    assert quantity.value == pytest.approx(6e-5 / np.sqrt(2.0), rel=0.15)


def test_the_other_way_round_it_is_the_opposite_change():
    back = compare(recorded(CHANGES["strut"][0]), first()).changes[0]
    there = comparison_after("strut").changes[0]
    assert (there.structure, there.place) == (back.structure, back.place)
    assert back.quantities[0].value == pytest.approx(-there.quantities[0].value, abs=3.0 * there.quantities[0].u)


def test_two_changes_are_both_found():
    result = compare(first(), recorded(both(CHANGES["drive_scale"][0], CHANGES["nest"][0])))
    assert {(c.structure, c.place) for c in result.changes} == {("drive_scale", "left"), ("nest", "N1")}
    assert all(c.place_probability > 0.9 for c in result.changes)


def tool_m(machine: TrueMachine, drives: np.ndarray) -> np.ndarray:
    """The tool point (n, 3) of the plant's machine at the reference temperature."""
    warmth = {e.sensor: machine.file.reference_temperature_c for e in machine.file.expansion.values()}
    points = [machine.tool_point(machine.pose(tuple(q), 0, warmth), warmth) for q in drives.tolist()]
    return np.array([(p.real, p.imag, 0.0) for p in points])


def test_the_map_over_the_workspace_is_that_of_the_plant():
    result = comparison_after("strut")
    file, machine = nominal()
    before = draw_machine(file, MockSettings(seed=MACHINE_SEED))
    struts = [replace(s, length_m=s.length_m + 8e-5 * (i == 2)) for i, s in enumerate(before.file.struts)]
    after = replace(before, file=replace(before.file, struts=tuple(struts)))
    assert len(result.workspace.tool_m) == 121
    target = np.zeros((121, 6))
    grid = np.meshgrid(np.linspace(-0.35, 0.35, 11), np.linspace(-0.3, 0.3, 11), indexing="ij")
    target[:, 0], target[:, 1] = (axis.ravel() for axis in grid)
    drives = nominal_drives(machine, target)
    shift = tool_m(after, drives) - tool_m(before, drives)
    assert np.sqrt(np.mean(np.sum((result.workspace.shift_m - shift) ** 2, axis=1))) < 0.12 * result.workspace.rms_m
    rms = float(np.sqrt(np.mean(np.sum(shift**2, axis=1))))
    assert abs(result.workspace.rms_m - rms) < 4.0 * result.workspace.u_rms_m
    assert result.workspace.rms_m < result.workspace.max_m
    assert result.workspace.rest_rms_m < result.workspace.rms_m


def test_what_no_structure_does_is_unknown():
    after = recorded()
    # The left drive goes by the place of the right one: none of the structures does.
    off = 8e-5 * np.sin(9.0 * after["right_actual_m"]) * np.cos(7.0 * after["left_actual_m"])
    columns = {**after.columns, "left_actual_m": after["left_actual_m"] - off}
    result = compare(first(), replace(after, columns=columns))
    assert result.verdict == "unknown"
    assert not result.changes
    assert result.machine_changed


def test_a_leg_that_counts_from_another_zero_is_not_told_from_a_longer_strut():
    def campaign(seed: int, change: Change) -> Recording:
        return SpatialCampaign("stewart6", 3, Circumstances(seed, seed, seed), LEVELS, change).recording(f"c{seed}")

    result = compare(campaign(1, Change()), campaign(2, Change(length_m={1: 2.5e-4})))
    names = {(result.verdict, result.place), *result.equivalent}
    assert {("drive_offset", "leg2"), ("strut", "strut2")} <= names
    assert all(place in ("leg2", "strut2") for _, place in names)


def test_a_reflector_that_was_mounted_elsewhere_is_left_out_and_said():
    after = recorded()
    moved = after.machine.smrs[P1]
    smrs = (replace(moved, position_m=moved.position_m + 1e-3), *after.machine.smrs[1:])
    result = compare(first(), replace(after, machine=replace(after.machine, smrs=smrs)))
    assert any("not compared: P1" in remark for remark in result.remarks)
    assert result.verdict == "nothing"


def test_rough_readings_count_for_less_and_are_remarked():
    after = recorded()
    rng = np.random.default_rng(3)
    shaken = {c: after[c] + 3e-5 * rng.standard_normal(len(after)) for c in ("x_m", "y_m")}
    row = int(np.flatnonzero(after["phase"] == "calibration")[40])
    shaken["x_m"][row] += 5e-3
    result = compare(first(), replace(after, columns={**after.columns, **shaken}))
    assert result.verdict == "nothing"
    assert result.scatter[1] > 2.0
    assert any(remark.startswith("after: 1 of its readings") for remark in result.remarks)
    assert any("after" in remark and "scatter" in remark for remark in result.remarks)


@pytest.mark.parametrize("scale", [0.0, 2.5e-4])
def test_a_machine_that_does_not_repeat_is_compared_as_one(scale):
    def campaign(seed: int, change: Change) -> Recording:
        made = SpatialCampaign("stewart6", 3, Circumstances(seed, seed, seed), LEVELS, change).recording(f"c{seed}")
        return standing_off(made, 1e-5, seed)

    change = Change(travel={1: lambda q: scale * q}) if scale else Change()
    result = compare(campaign(1, Change()), campaign(2, change))
    assert result.verdict == ("drive_scale" if scale else "nothing")
    assert any("does not repeat better than" in remark for remark in result.remarks)
    for quantity in (quantity for found in result.changes for quantity in found.quantities):
        assert abs(quantity.value - scale) < 2.5 * quantity.u


def with_two_visits_elsewhere(recording: Recording, visits: tuple[int, int], by_m: float) -> Recording:
    """The first drive is read elsewhere at two visits than it was at."""
    name = f"{recording.machine.drive_names[0]}_actual_m"
    off = by_m * np.isin(recording["visit"], visits)
    return replace(recording, columns={**recording.columns, name: recording[name] + off})


@pytest.mark.parametrize(("structure", "by_m"), [("", 3e-4), ("drive_scale", 1e-4)])
def test_what_is_elsewhere_at_two_visits_is_no_change(structure, by_m):
    change, place, sizes = CHANGES[structure] if structure else (None, "", {})
    after = with_two_visits_elsewhere(recorded(change), (21, 47), by_m)
    result = compare(first(), after)
    assert (result.verdict, result.place) == (structure or "nothing", place)
    assert len(result.changes) == bool(structure)
    for found in result.changes:
        (quantity,) = found.quantities
        assert abs(quantity.value - sizes["scale"]) < 4.0 * quantity.u
    (said,) = [remark for remark in result.remarks if "elsewhere" in remark]
    assert said.startswith("after: at visits 21, 47 alone something is elsewhere, most likely travel.left by up to ")
    assert float(said.split("up to ")[1].split(" um")[0]) == pytest.approx(1e6 * by_m, rel=0.15)
    # One reading of this campaign is wrong as well, and is none of those ten.
    assert any(remark.startswith("after: 1 of its readings") for remark in result.remarks)
    assert result.readings[1] == len(usable_rows(after)) - 11


def test_nor_is_what_was_so_before():
    before = with_two_visits_elsewhere(first(), (21, 47), 3e-4)
    result = compare(before, recorded())
    assert result.verdict == "nothing"
    assert any(remark.startswith("before: at visits 21, 47 alone") for remark in result.remarks)


@pytest.mark.parametrize("period_m", [1.38, 0.02])
def test_a_law_is_not_what_is_elsewhere_at_few_visits(period_m):
    def bowed(q):
        return 1e-4 * np.cos(2.0 * np.pi * (q - 0.32) / period_m)

    after = recorded(Change(travel={RIGHT: bowed}))
    result = compare(first(), after)
    assert not any("elsewhere" in remark for remark in result.remarks)


def test_where_too_few_visits_are_left_all_stay():
    after = recorded()
    at_pose = after["phase"] != "nests"
    first_twenty = np.unique(after["visit"][at_pose])[:20]
    after = after.take(np.flatnonzero(np.isin(after["visit"], first_twenty) | ~at_pose))
    off = int(first_twenty[7])
    result = compare(first(), with_two_visits_elsewhere(after, (off, off), 1e-4))
    assert not any("elsewhere" in remark for remark in result.remarks)
    assert result.readings[1] >= len(usable_rows(after)) - 2
