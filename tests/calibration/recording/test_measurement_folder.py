"""Measurement folders: they round-trip, any content is a machine or one line, and what a fit of them says holds."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calibration.base.errors import InputError
from calibration.identification.estimators import identify
from calibration.identification.leave_one_out import leave_one_out
from calibration.machine.description import load_machine, shipped_machine
from calibration.machine.inverse import rigid_drives
from calibration.model.model import Model
from calibration.model.parameters import ParameterSet
from calibration.model.visits import Visits
from calibration.recording.delta_printer import machine_with_measurements
from calibration.recording.klipper import parse_printer
from calibration.recording.measurement_folder import MeasuredMachine, read_measurements, write_measurements
from calibration.recording.measurement_header import ColumnEntry, DistancesEntry, MeasurementFile
from tests.calibration.delta_reference import own_printer, printer_cfg

COLUMNS = ("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad")


def printer(delta, rows):
    return machine_with_measurements(parse_printer(printer_cfg(delta, rows), "printer.cfg"), "own", "made for a test")


@pytest.fixture(scope="module")
def own():
    return printer(*own_printer())


@pytest.fixture(scope="module")
def folder(own, tmp_path_factory):
    path = tmp_path_factory.mktemp("measured") / "own"
    write_measurements(own, path)
    return path


@pytest.fixture
def copy(folder, tmp_path):
    return shutil.copytree(folder, tmp_path / "copy")


def hexapod(seed):
    """A hexapod with its true errors: its full pose was measured, and distances of its tool to a ball on the base."""
    machine = load_machine(shipped_machine("stewart6"))
    rng = np.random.default_rng(seed)
    model = Model(ParameterSet.of(machine, ("strut_length", "base_joint")))
    low, high = machine.workspace.T
    target = rng.uniform(low, high, (12, 6))
    visits = Visits.at_reference_temperature(machine, rigid_drives(machine, machine.nominal, target), target)
    visits = replace(visits, temperatures_c={name: np.full(12, 20.5) for name in visits.temperatures_c})
    truth = model.parameters.sigma * rng.normal(0.0, 1.0, len(model))
    poses = model.predict(truth, visits)
    seen = np.concatenate([poses.tool_m(), poses.equilibrium.coordinates()[:, 3:]], axis=1)
    seen[:10] += rng.normal(0.0, 1e-5, (10, 6))
    seen[10:] = np.nan
    centre = np.array([0.3, -0.2, 0.1])
    first = np.array([10, 11, 3, 0])
    distance = np.linalg.norm(poses.tool_m()[first] - centre, axis=1) + rng.normal(0.0, 1e-5, 4)
    file = MeasurementFile(
        format=1,
        name="hexapod",
        unknowns=("strut_length", "base_joint"),
        columns={name: ColumnEntry(sd=1e-5) for name in COLUMNS},
        distances=DistancesEntry(sd_m=1e-5, centre_m=tuple(centre), centre_u_m=1e-3),
    )
    pairs = first[:, None].astype(float)
    return MeasuredMachine(file, machine, visits, 3.0 * np.arange(12.0), seen, pairs, distance), truth


@pytest.mark.parametrize("which", ["delta", "hexapod"])
def test_folders_round_trip(which, own, tmp_path):
    one = own if which == "delta" else hexapod(1)[0]
    write_measurements(one, tmp_path / "f")
    two = read_measurements(tmp_path / "f")
    assert one.file == two.file
    assert one.machine.text == two.machine.text
    for name in ("number", "coordinates", "pairs", "distance_m"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name), err_msg=name)
    for name in ("drives", "target_m", "payload_kg"):
        np.testing.assert_array_equal(getattr(one.visits, name), getattr(two.visits, name), err_msg=name)
    assert one.visits.temperatures_c.keys() == two.visits.temperatures_c.keys()
    for sensor, t in one.visits.temperatures_c.items():
        np.testing.assert_array_equal(t, two.visits.temperatures_c[sensor])
    with pytest.raises(InputError, match="exists already"):
        write_measurements(one, tmp_path / "f")


def test_text_of_any_kind_comes_back_from_the_header(own, tmp_path):
    source = 'a "b" \\ \n\t\x00\x7f ]] = # \u2028'
    write_measurements(replace(own, file=own.file.model_copy(update={"source": source})), tmp_path / "f")
    assert read_measurements(tmp_path / "f").file.source == source


def test_targets_and_temperatures_may_be_left_out(copy, own):
    lines = (copy / "coordinates.csv").read_text(encoding="utf-8").splitlines()
    keep = [i for i, name in enumerate(lines[0].split(",")) if "target" not in name and "temperature" not in name]
    short = "\n".join(",".join(line.split(",")[i] for i in keep) for line in lines)
    (copy / "coordinates.csv").write_text(short, encoding="utf-8")
    measured_machine = read_measurements(copy)
    one, two = (identify(Model(m.parameters()), m.visits, m.readings()) for m in (own, measured_machine))
    np.testing.assert_allclose(one.unknowns, two.unknowns, atol=1e-9)


def edit(path, old, new):
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


@pytest.mark.parametrize(
    ("file", "old", "new", "complaint"),
    [
        ("measurements.toml", "format = 1", "format = 2", "format"),
        ("measurements.toml", "format = 1", "format = 1\nplugin = 'x.py'", "unknown key 'plugin'"),
        ("measurements.toml", 'name = "own"', 'name = "../x"', "name"),
        ("measurements.toml", "sd = 3e-05", "sd = 0.0", "sd"),
        ("measurements.toml", "sd = 3e-05", "sd = inf", "sd"),
        ("measurements.toml", "columns.z_m", "columns.height_m", "columns"),
        ("measurements.toml", '"strut_length", "base', '"magic", "base', "unknowns"),
        (
            "measurements.toml",
            '["strut_length", "base_joint", "axis_tilt", "drive_scale"]',
            '["pivot"]',
            "no such param",
        ),
        ("measurements.toml", '"base_joint.a.x"', '"base_joint.q.x"', "unknown parameter 'base_joint.q.x'"),
        ("measurements.toml", "[distances]", "[lengths]", "unknown key 'lengths'"),
        ("machine.toml", "branch = -1", "branch = 3", "branch"),
        ("coordinates.csv", "b_actual_m", "bb_actual_m", "no column 'b_actual_m'"),
        ("coordinates.csv", "b_actual_m", "a_actual_m", "occurs twice"),
        ("coordinates.csv", "struts_temperature_c", "mood", "unknown column 'mood'"),
        ("coordinates.csv", "target_x_m", "drives_temperature_c", "occurs twice"),
        ("coordinates.csv", "\n0,", "\n1,", "a visit's number occurs twice"),
        ("coordinates.csv", "\n0,", "\n0.5,", "not a count"),
        ("coordinates.csv", "\n0,", "\nnan,", "not finite"),
        ("coordinates.csv", "\n0,", "\n,", "not a number"),
        ("coordinates.csv", "\n0,", "\n0,0,", "cells, the header"),
        ("coordinates.csv", "\n0,0.", "\n0,1", "outside its travel; use metres"),
        ("coordinates.csv", ",0.0005\n", ",0.5\n", "far outside the workspace"),
        ("coordinates.csv", ",0.0005\n", ",inf\n", "not finite"),
        ("distances.csv", "first", "from", "no column 'first'"),
        ("distances.csv", "\n13,", "\n77,", "there is no visit 77"),
        ("distances.csv", "\n13,19", "\n19,19", "to itself"),
        ("distances.csv", ",0.08", ",84", "no distance within the workspace"),
        ("distances.csv", ",0.08", ",-0.08", "no distance within the workspace"),
    ],
)
def test_what_is_wrong_is_named_in_one_line(copy, file, old, new, complaint):
    edit(copy / file, old, new)
    with pytest.raises(InputError, match=complaint) as caught:
        read_measurements(copy)
    assert "\n" not in str(caught.value)


def test_missing_and_stray_files_are_named(copy):
    (copy / "distances.csv").rename(copy / "d.csv")
    with pytest.raises(InputError, match=r"distances\.csv: .*check the path"):
        read_measurements(copy)
    (copy / "d.csv").rename(copy / "distances.csv")
    text = (copy / "measurements.toml").read_text(encoding="utf-8")
    start, end = text.index("[distances]"), text.index("[former]")
    (copy / "measurements.toml").write_text(text[:start] + text[end:], encoding="utf-8")
    with pytest.raises(InputError, match=r"has no \[distances\]"):
        read_measurements(copy)
    (copy / "coordinates.csv").write_text(
        (copy / "coordinates.csv").read_text(encoding="utf-8").splitlines()[0], encoding="utf-8"
    )
    with pytest.raises(InputError, match="no rows"):
        read_measurements(copy)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    name=st.sampled_from(["coordinates.csv", "distances.csv", "measurements.toml"]),
    data=st.binary(max_size=30),
    at=st.integers(0, 4000),
)
def test_any_bytes_give_a_machine_or_one_line(folder, tmp_path, name, data, at):
    broken = tmp_path / "broken"
    shutil.copytree(folder, broken, dirs_exist_ok=True)
    whole = (folder / name).read_bytes()
    (broken / name).write_bytes(whole[:at] + data + whole[at + len(data) :])
    assert "\n" not in complaint_about(broken)


def complaint_about(path):
    """The one line about a folder, empty if it is a machine; any other exception fails the test."""
    try:
        read_measurements(path)
    except InputError as error:
        return str(error)
    return ""


def test_a_hexapod_measured_by_pose_and_ball_bar_is_identified():
    measured, truth = hexapod(2)
    fit = identify(Model(measured.parameters()), measured.visits, measured.readings())
    assert fit.chi2_per_dof == pytest.approx(1.0, abs=0.6)
    error = fit.theta - truth
    n = len(truth)
    assert np.mean(np.linalg.solve(fit.covariance[:n, :n], error) * error) == pytest.approx(1.0, abs=0.8)


@pytest.mark.parametrize("which", ["delta", "hexapod"])
def test_leave_one_out_is_what_refits_without_the_reading_say(which, own):
    measured = own if which == "delta" else hexapod(3)[0]
    model, readings = Model(measured.parameters()), measured.readings()
    fit = identify(model, measured.visits, readings)
    left_out = leave_one_out(fit)
    for which_one, instrument in enumerate(readings):
        for row in range(0, len(instrument), 3):
            others = np.delete(np.arange(len(instrument)), row)
            part = [r.take(others) if k == which_one else r for k, r in enumerate(readings)]
            refit = identify(model, measured.visits, part)
            alone = instrument.take(np.array([row]))
            visits = alone.visit_indices()
            poses = refit.predict(measured.visits.take(visits[0]))
            own_unknowns = refit.unknowns[refit.layout.instrument_slices[which_one]]
            local = np.arange(visits.size).reshape(visits.shape)
            compared = alone.compare(poses, local, own_unknowns)
            np.testing.assert_allclose(left_out[which_one].error[row], compared.residual[0], rtol=5e-3, atol=5e-3)
            by_model = np.concatenate([compared.by_model, compared.by_own], axis=2)[0]
            own_slice = refit.layout.instrument_slices[which_one]
            columns = np.r_[np.arange(len(model)), np.arange(own_slice.start, own_slice.stop)]
            u = np.sqrt(np.diag(by_model @ refit.covariance[np.ix_(columns, columns)] @ by_model.T))
            np.testing.assert_allclose(left_out[which_one].u[row], u, rtol=2e-2)
        assert np.all(
            np.sum(left_out[which_one].error ** 2, axis=1) > np.sum(left_out[which_one].residual ** 2, axis=1)
        )


def test_the_order_of_the_rows_does_not_matter(own):
    """Numbers of visits are names: any order of the rows gives the same."""
    order = np.random.default_rng(0).permutation(len(own.visits))
    place = np.argsort(order)
    mixed = replace(
        own,
        visits=own.visits.take(order),
        number=own.number[order],
        coordinates=own.coordinates[order],
        pairs=place[own.pairs.astype(int)].astype(float),
    )
    one, two = (identify(Model(m.parameters()), m.visits, m.readings()) for m in (own, mixed))
    np.testing.assert_allclose(one.unknowns, two.unknowns, atol=1e-9)


SAID = {
    "t_rig_s": 60.0, "dwell_s": 2.0, "speed_m_per_s": 0.1, "payload_mass_kg": 5.0, "payload_com_x_m": 0.01,
    "payload_com_y_m": 0.0, "payload_com_z_m": 0.02, "force_x_n": 1.0, "force_y_n": 2.0, "force_z_n": -30.0,
    "force_point_x_m": 0.0, "force_point_y_m": 0.1, "force_point_z_m": 0.0, "a_direction": 1.0, "b_direction": -1.0,
    "c_direction": 1.0, "a_torque_ratio": 0.1, "b_torque_ratio": 0.2, "c_torque_ratio": -0.3,
}  # fmt: skip


def test_what_is_said_of_visits_round_trips_and_loads_the_machine(own, tmp_path):
    count = len(own.visits)
    said = {name: np.full(count, value) for name, value in SAID.items()}
    write_measurements(replace(own, conditions=said), tmp_path / "said")
    again = read_measurements(tmp_path / "said")
    assert {name: column.tolist() for name, column in again.conditions.items()} == {
        name: [value] * count for name, value in SAID.items()
    }
    assert again.visits.payload_kg.tolist() == [5.0] * count
    assert again.visits.payload_com_m[0].tolist() == [0.01, 0.0, 0.02]
    ((force, point),) = again.visits.forces
    assert (force[-1].tolist(), point[-1].tolist()) == ([1.0, 2.0, -30.0], [0.0, 0.1, 0.0])
    assert set(again.sensors) == set(own.visits.temperatures_c)
    plain = read_measurements(folder_of(own, tmp_path / "plain"))
    assert plain.conditions == {}
    assert plain.visits.forces == ()
    assert not plain.visits.payload_kg.any()


def folder_of(measured, path):
    write_measurements(measured, path)
    return path


@pytest.mark.parametrize(
    ("left_out", "changed", "message"),
    [
        (("c_direction",), {}, "of the columns a_direction, b_direction, c_direction some are missing"),
        (("payload_mass_kg",), {}, "column 'payload_com_x_m' without 'payload_mass_kg'"),
        (("force_x_n", "force_y_n", "force_z_n"), {}, "column 'force_point_x_m' without 'force_x_n'"),
        (("force_z_n",), {}, "of the columns force_x_n, force_y_n, force_z_n some are missing"),
        ((), {"b_direction": 0.5}, "line 2, column 'b_direction': 0.5; the side is 1"),
        ((), {"dwell_s": -1.0}, "line 2, column 'dwell_s': -1; it must not be negative"),
        ((), {"force_x_n": 1e12}, "line 2, column 'force_x_n': 1e.12; it must not be negative, nor beyond 1e9"),
    ],
)
def test_what_cannot_be_said_of_a_visit_is_refused(own, tmp_path, left_out, changed, message):
    said = {n: np.full(len(own.visits), v) for n, v in {**SAID, **changed}.items() if n not in left_out}
    write_measurements(replace(own, conditions=said), tmp_path / "said")
    with pytest.raises(InputError, match=message):
        read_measurements(tmp_path / "said")
