"""Klipper's calibration block: what is read of it, and that any text gives a description or one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calibration.base.errors import InputError
from calibration.recording.delta_printer import machine_with_measurements
from calibration.recording.klipper import parse_printer, read_printer
from tests.calibration.delta_reference import STORED, misses, own_printer, printer_cfg

CFG = Path(__file__).parents[2] / "data" / "printer.cfg"


@pytest.fixture
def text():
    return CFG.read_text(encoding="utf-8")


def parse(text):
    return parse_printer(text, "printer.cfg")


def test_the_file_of_our_own_making_is_what_its_generator_writes(text):
    assert text == printer_cfg(*own_printer())


def test_stored_parameters_and_readings_are_read(text):
    printer = read_printer(CFG)
    _, rows = own_printer()
    assert printer.radius_m == pytest.approx(STORED.radius / 1e3, abs=1e-9)
    np.testing.assert_allclose([np.degrees(t.angle_rad) for t in printer.towers], STORED.angle, atol=1e-9)
    np.testing.assert_allclose([t.arm_m for t in printer.towers], STORED.arm / 1e3, atol=1e-12)
    np.testing.assert_allclose([t.endstop_m for t in printer.towers], STORED.endstop / 1e3, atol=1e-12)
    np.testing.assert_allclose(printer.step_m, 12.5e-6, rtol=1e-12)
    assert printer.probed_radius_m == 0.1
    np.testing.assert_allclose(printer.height_m, [h / 1e3 for h, _ in rows.heights])
    np.testing.assert_array_equal(printer.height_steps, [p for _, p in rows.heights])
    np.testing.assert_allclose(printer.distance_m, [d / 1e3 for d, _, _ in rows.distances])
    np.testing.assert_array_equal(printer.first_steps, [p for _, p, _ in rows.distances])
    np.testing.assert_array_equal(printer.second_steps, [q for _, _, q in rows.distances])


def test_the_nominal_machine_predicts_what_the_classical_forward_kinematics_does():
    delta, rows = own_printer()
    measured = machine_with_measurements(parse(printer_cfg(delta, rows)), "own", "test")
    heights = len(rows.heights)
    expected = misses(delta, rows)
    tool = measured.visits.target_m[:, :3] * 1e3
    np.testing.assert_allclose(tool[:heights, 2] - [h for h, _ in rows.heights], expected[:heights], atol=1e-6)
    first, second = measured.pairs.astype(int).T
    between = np.linalg.norm(tool[first] - tool[second], axis=1)
    np.testing.assert_allclose(between - [d for d, _, _ in rows.distances], expected[heights:], atol=1e-6)


def test_the_quantities_are_derivatives_of_the_owners_parameters(text):
    """Move each joint a little: radius, angles and endstops follow as the circle through three points says."""
    printer = parse(text)
    measured = machine_with_measurements(printer, "own", "test")
    nominal = measured.machine.nominal
    rng = np.random.default_rng(3)
    places = rng.normal(0.0, 1e-6, (3, 3))
    arms = rng.normal(0.0, 1e-6, 3)
    moved = nominal.base_joint_m + places
    a, b, c = moved[:, :2]
    # Centre of the circle through three points, and the turn that puts the third at 90 degrees.
    rows = 2.0 * np.array([b - a, c - a])
    centre = np.linalg.solve(rows, [b @ b - a @ a, c @ c - a @ a])
    radius = np.linalg.norm(a - centre)
    angle = np.arctan2(*(moved[:, :2] - centre).T[::-1])
    angle -= angle[2] - np.pi / 2.0
    endstop = moved[:, 2] - np.sqrt((nominal.length_m + arms) ** 2 - radius**2)
    expected = {"delta_radius": radius}
    for i, name in enumerate("abc"):
        expected[f"stepper_{name} position_endstop"] = endstop[i]
        expected[f"stepper_{name} angle"] = np.mod(angle[i], 2.0 * np.pi)
        expected[f"stepper_{name} arm_length"] = (nominal.length_m + arms)[i]
    values = {f"base_joint.{n}.{axis}": places[i, k] for i, n in enumerate("abc") for k, axis in enumerate("xyz")}
    values |= {f"strut_length.{n}": arms[i] for i, n in enumerate("abc")}
    assert len(measured.file.quantities) == measured.file.former.parameters == 9
    for quantity in measured.file.quantities:
        value = quantity.nominal + sum(weight * values[name] for name, weight in quantity.of.items())
        assert value == pytest.approx(expected[quantity.name], abs=5e-10), quantity.name


def replaced(text, *pairs):
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    return text


@pytest.mark.parametrize(
    ("pairs", "step_um"),
    [
        ([], (12.5, 12.5, 12.5)),
        ([("rotation_distance: 40", "rotation_distance: 40\ngear_ratio: 57:11, 2:1")], [12.5 * 11 / 114] * 3),
        ([("rotation_distance: 40", "step_distance: .01")], (10.0, 10.0, 10.0)),
        ([("full_steps_per_rotation: 200", "")], (12.5, 12.5, 12.5)),
        ([("microsteps: 16", ""), ("[delta_calibrate]\nr", "[tmc2209 stepper_b]\nmicrosteps = 64\n[x]\nr")], None),
        (
            [("[stepper_b]\nstep_pin: P1\nmicrosteps: 16", "[stepper_b]\nMICROSTEPS = 64 ; finer\n# microsteps: 16")],
            (12.5, 3.125, 12.5),
        ),
    ],
)
def test_the_step_distance_comes_of_belt_gear_and_microsteps(text, pairs, step_um):
    changed = replaced(text, *pairs)
    if step_um is None:  # microsteps are said of one tower only
        with pytest.raises(InputError, match=r"\[stepper_a\] microsteps is missing"):
            parse(changed)
    else:
        np.testing.assert_allclose(parse(changed).step_m * 1e6, step_um)


def test_microsteps_of_the_driver_serve_where_the_stepper_has_none(text):
    changed = replaced(text, ("microsteps: 16", ""))
    changed = "".join(f"[tmc2209 stepper_{k}]\nmicrosteps: 32\n" for k in "abc") + changed
    np.testing.assert_allclose(parse(changed).step_m, 6.25e-6)


def test_towers_take_from_the_first_what_is_not_said_of_them():
    lines = ["[printer]", "delta_radius=140", "[stepper_a]", "arm_length=300", "position_endstop=290"]
    for k in "abc":
        lines += [f"[stepper_{k}]", "microsteps=16", "rotation_distance=40"]
    lines += ["[delta_calibrate]", "height0=1", "height0_pos=1,2,3", "manual_height0=2", "manual_height0_pos=4,5,6"]
    printer = parse("\n".join(lines))
    assert [t.arm_m for t in printer.towers] == [0.3, 0.3, 0.3]
    assert [t.endstop_m for t in printer.towers] == [0.29, 0.29, 0.29]
    np.testing.assert_allclose(np.degrees([t.angle_rad for t in printer.towers]), [210.0, 330.0, 90.0])
    np.testing.assert_array_equal(printer.height_steps, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(printer.height_m, [1e-3, 2e-3])
    assert printer.distance_m.shape == (0,)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("kinematics: delta", "kinematics: corexy", "kinematics is 'corexy'"),
        ("#*# height0 = 0.5", "#*# height0 = nan", "out of range"),
        ("#*# height0 = 0.5", "#*# height0 = 1e300", "out of range"),
        ("#*# height0 = 0.5", "#*# height0 = half", "'half' is not a number"),
        ("#*# height0_pos = ", "#*# height0_pos = 4,", "height0_pos is not three numbers"),
        ("#*# height0_pos = ", "#*# height0_at = ", "height0_pos is missing"),
        ("#*# distance0_pos2 = ", "#*# distance0_at = ", "distance0_pos2 is missing"),
        ("#*# distance0 = ", "#*# distance0 = -", "distance0 is not a positive length"),
        ("#*# delta_radius = 1", "#*# delta_radius = 9", "arm_length is not longer than delta_radius"),
        ("#*# angle = 210.", "#*# angle = 330.", "towers a and b are within 20 degrees"),
        ("microsteps: 16", "microsteps: 0", "microsteps is not positive"),
        ("microsteps: 16", "gear_ratio: 3", "microsteps is missing"),
        ("rotation_distance: 40", "rotation_distance: 40\ngear_ratio: 57/11", "gear_ratio is not a ratio"),
        ("rotation_distance: 40", "rotation_distance: 40\ngear_ratio: 1:0", "gear_ratio is not a ratio"),
        ("rotation_distance: 40", "", "rotation_distance is missing"),
        ("#*# height", "#*# depth", "run DELTA_CALIBRATE"),
    ],
)
def test_what_is_wrong_is_named_in_one_line(text, old, new, complaint):
    assert old in text
    with pytest.raises(InputError, match=complaint) as caught:
        parse(text.replace(old, new))
    assert "\n" not in str(caught.value)


def test_included_files_are_not_read_but_named_as_a_reason(text):
    with pytest.raises(InputError, match=r"rotation_distance is missing \(files that it includes are not read"):
        parse("[include steppers.cfg]\n" + text.replace("rotation_distance: 40", ""))


def test_too_many_readings_are_refused(text):
    more = "".join(f"#*# height{i} = 1\n#*# height{i}_pos = 1,2,3\n" for i in range(20, 1100))
    with pytest.raises(InputError, match="more than 1000 readings"):
        parse(text + more)


def complaint_about(text):
    """The one line about a text, empty if it is a printer; any other exception fails the test."""
    try:
        machine_with_measurements(parse(text), "any", "any")
    except InputError as error:
        return str(error)
    return ""


PIECES = st.sampled_from([
    *(f"[stepper_{k}]\n" for k in "abc"), "[printer]\n", "#*# [delta_calibrate]\n", "delta_radius", "arm_length: ",
    "300\n", "angle=", "microsteps = 16\n", "rotation_distance: ", "gear_ratio: ", "1:2,", "nan", "1e999", "-", "\n",
    "height0 = ", "#*# ", "height0_pos = 1,2,3\n", "distance0_pos1", "position_endstop: 290\n", "0", "\x00", " ",
    "[include", "\u0660",
])  # fmt: skip


@settings(max_examples=150)
@given(st.one_of(st.text(max_size=200), st.lists(PIECES, max_size=40).map("".join)))
def test_any_text_gives_a_printer_or_one_line(text):
    assert "\n" not in complaint_about(text)


@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(new=st.text(max_size=12) | st.integers().map(str) | st.floats().map(str), data=st.data())
def test_any_change_to_a_good_file_gives_a_printer_or_one_line(text, new, data):
    at = data.draw(st.integers(0, len(text)))
    length = data.draw(st.integers(0, 12))
    assert "\n" not in complaint_about(text[:at] + new + text[at + length :])


def test_bytes_that_are_no_text_and_large_files_are_refused(tmp_path):
    path = tmp_path / "printer.cfg"
    path.write_bytes(b"[printer]\n\xff\xfe")
    with pytest.raises(InputError, match="not UTF-8"):
        read_printer(path)
    path.write_bytes(b"#" * 1_100_000)
    with pytest.raises(InputError, match="larger than"):
        read_printer(path)
