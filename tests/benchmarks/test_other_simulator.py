"""The second simulator of campaigns: the same seed the same bytes, in the format, with right sizes and forces."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.independent.pack import write_case
from benchmarks.independent.recordings import ARCHIVE, FILES, copy_recordings, names_of
from benchmarks.other_simulator.__main__ import main
from benchmarks.other_simulator.archives import cases_of
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.effects import bring_to_size, draw_effect
from benchmarks.other_simulator.equilibrium import points_m, settle
from benchmarks.other_simulator.forms.catalogue import ARCHIVES, EFFECTS, FORMS, OUTSIDE, names_of_forms
from benchmarks.other_simulator.machine import PARAMETERS
from benchmarks.other_simulator.making import _fact, make_case
from benchmarks.other_simulator.rig import draw_rig
from benchmarks.other_simulator.sizes import Size, Sizes
from calibration.recording.folder import read_folder

# Standard deviation of a reading and amplitude: play of a strut, a column that gives way, a strut that softens.
AS_FIRST_MADE = [
    ("first", "rec098", 7.828697196354448e-06, 0.00017255799439806944),
    ("second", "rec378", 7.2059803968860555e-06, 0.00010324935284192289),
    ("space", "rec602", 9.6136233162678e-06, 2.6),
]


@pytest.fixture(scope="module")
def rig():
    return draw_rig("planar4", "randomised", np.random.default_rng(4))


# --- archives


def test_archives_are_mixed_even_and_all_but_that_in_space_have_their_own_forms():
    cases = [case for archive in ARCHIVES for case in cases_of(archive)]
    assert [len(cases_of(archive)) for archive in ARCHIVES] == [120, 120, 60, 120, 120, 120, 120, 120, 120, 120, 120]
    numbers = [int(case.name.removeprefix("rec")) for case in cases]
    assert len(set(numbers)) == len(numbers)
    assert all(number % 2 == 0 for number in numbers)
    for case in cases:
        assert all(form in names_of_forms(effect, case.archive) for effect, form in case.effects)
    for effect in (*EFFECTS, OUTSIDE):
        own = [names_of_forms(effect, archive) for archive in ARCHIVES if archive != "space"]
        assert sorted(name for names in own for name in names) == sorted(FORMS[effect])
        assert all(own)
        assert names_of_forms(effect, "space") == own[0] + own[1]


@pytest.mark.parametrize("base", ["planar4", "delta6", "stewart6"])
def test_a_recording_is_the_same_each_time_and_in_the_format(tmp_path, base):
    archive = "first" if base == "planar4" else "space"
    case = next(case for case in cases_of(archive) if case.base == base and case.kind == "null")
    for folder in (tmp_path / "one", tmp_path / "other"):
        make_case(case, folder)
    one, other = tmp_path / "one" / case.name, tmp_path / "other" / case.name
    for file in (*FILES, "entry.json", "arrays.npz"):
        assert (one / file).read_bytes() == (other / file).read_bytes()
    recording = read_folder(one)
    with np.load(one / "arrays.npz") as arrays:
        assert arrays["clean_m"].shape == recording.positions_m.shape
        noise = recording.positions_m - arrays["clean_m"]
        stated = np.linalg.inv(np.linalg.cholesky(recording.covariances_m2))
        white = np.einsum("rij,rj->ri", stated, noise)
    white = white[np.abs(white).max(axis=1) < 6.0]  # some have outliers
    for third in np.array_split(white, 3):  # drift and errors of ranges are read, and not noise
        assert np.mean(third**2) == pytest.approx(1.0, abs=0.2)
        assert np.abs(np.mean(third, axis=0)).max() < 5.0 / np.sqrt(len(third))
    assert json.loads((one / "entry.json").read_text())["effects"] == []


@pytest.mark.parametrize(("archive", "name", "sigma_m", "amplitude"), AS_FIRST_MADE)
def test_draws_are_those_that_archives_were_made_of(tmp_path, archive, name, sigma_m, amplitude):
    (case,) = (case for case in cases_of(archive) if case.name == name)
    make_case(case, tmp_path)
    entry = json.loads((tmp_path / name / "entry.json").read_text())
    (effect,) = entry["effects"]
    assert (entry["sigma_m"], effect["size"]) == pytest.approx((sigma_m, amplitude))
    assert effect["places"]


# --- physics


@pytest.mark.parametrize(("base", "free"), [("planar4", [0, 1, 5]), ("delta6", range(6)), ("stewart6", range(6))])
def test_the_platform_is_balanced(base, free):
    rig = draw_rig(base, "randomised", np.random.default_rng(5))
    seen, state = rig.simulate([(Contribution(force_n=np.full((len(rig.rows), 3), 30.0)), None, 1.0)])
    machine, gravity = rig.machine, rig.machine.gravity_m_per_s2
    growth = state.growth["platform"][:, None]
    total = np.zeros((len(seen), 6))
    total[:, :3] = 30.0
    loads = [(machine.moving_mass_kg * gravity, machine.centre_of_mass_m)]
    for k in range(len(seen)):
        carried = [(rig.rows.payload_kg[k] * gravity, rig.rows.payload_centre_m[k])]
        joints = [
            (-state.tension_n[k, s] * state.directions[k, s], growth[k] * rig.geometry.platform_joint_m[s])
            for s in range(len(machine.struts))
        ]
        for force, place in loads + carried + joints:
            total[k] += np.concatenate([force, np.cross(state.rotations[k] @ place, force)])
    assert np.abs(total[:, list(free)]).max() < 0.1
    assert np.abs(state.tension_n).max() > 100.0


def test_effects_of_zero_size_change_nothing_and_all_forms_change_something(rig):
    rng, parts = np.random.default_rng(6), []
    for effect, forms in FORMS.items():
        for form in forms:
            drawn = draw_effect(rig, effect, form, rng)
            parts += drawn.sized(0.0)
            contribution = drawn.parts[0][0]
            values = [value for value in vars(contribution).values() if isinstance(value, np.ndarray)]
            changes = contribution.under_load or contribution.expansion_per_k or any(np.any(value) for value in values)
            assert changes, (effect, form)
    seen, _ = rig.simulate(parts)
    np.testing.assert_allclose(seen, rig.scene.sights_m, rtol=0.0, atol=1e-10)


# --- sizes


def test_sizes_are_those_of_an_independent_fit(rig):
    effect = draw_effect(rig, "guide_straightness", "bow", np.random.default_rng(7))
    amplitude, size = bring_to_size(rig, Sizes(rig), effect, 3.0)
    assert size.visible_length == pytest.approx(3.0, rel=0.1)
    seen, _ = rig.simulate(effect.sized(amplitude))
    change, rows, station = seen - rig.scene.sights_m, rig.rows, rig.station

    distances = np.linalg.norm(rig.scene.sights_m, axis=1)
    level = np.linalg.norm(rig.scene.sights_m[:, :2], axis=1)
    variances = station.range_sd_m**2 + station.angle_sd_rad**2 * (distances**2 + level**2)
    sigma = np.sqrt(variances[rows.on_platform].mean() / 3.0)
    assert rig.sigma_m == pytest.approx(sigma, rel=1e-9)

    columns = []
    for name in PARAMETERS:
        for index in zip(*np.nonzero(rig.machine.may_err(name)), strict=True):
            step = 1e-2 if name == "ln_stiffness" else 2e-6
            ends = []
            for sign in (-1.0, 1.0):
                geometry = rig.geometry.changed(name, index, sign * step)
                state, _ = settle(rig.machine, geometry, rig.conditions, rig.calm, start=rig.start)
                points = points_m(rig.machine, geometry, rows.smr, state, rig.calm)
                ends.append(station.sees(points, geometry, rig.calm))
            columns.append((ends[1] - ends[0]).ravel() / (2.0 * step) * rig.machine.tolerances.get(name, 1e-2))
    jacobian = np.stack(columns, 1)
    weights = np.linalg.inv(np.linalg.cholesky(rig.covariances_m2))
    by_reading = np.einsum("rij,rjp->rip", weights, jacobian.reshape(*change.shape, -1))
    white = np.concatenate([by_reading.reshape(jacobian.shape), np.eye(jacobian.shape[1])])  # with the tolerances
    data = np.concatenate([np.einsum("rij,rj->ri", weights, change).ravel(), np.zeros(jacobian.shape[1])])
    residual = change - (jacobian @ np.linalg.lstsq(white, data, rcond=None)[0]).reshape(change.shape)

    def rms(values, group):
        in_plane = values[group] @ station.axes[:, :2]
        return np.sqrt(np.mean((in_plane / (station.angle_sd_rad * distances[group, None])) ** 2))

    def rms_length(values, group):
        return np.sqrt((values[group] ** 2).sum(1).mean()) / sigma

    groups = [rows.smr == smr for smr in range(len(rig.machine.reflectors)) if rig.machine.carriers[smr] >= 0]
    groups.append(rows.on_platform)
    assert size.raw == pytest.approx(max(rms(change, group) for group in groups), rel=1e-6)
    assert size.visible == pytest.approx(max(rms(residual, group) for group in groups), rel=1e-3)
    assert size.raw_length == pytest.approx(max(rms_length(change, group) for group in groups), rel=1e-6)
    assert size.visible_length == pytest.approx(max(rms_length(residual, group) for group in groups), rel=1e-3)
    assert size.raw_platform == pytest.approx(rms(change, rows.on_platform), rel=1e-6)
    assert size.visible_platform == pytest.approx(rms(residual, rows.on_platform), rel=1e-3)


@pytest.mark.parametrize(("name", "form", "has_place"), [("latency", None, False), ("backlash", "constant", True)])
def test_what_belongs_to_the_rig_has_no_place(rig, name, form, has_place):
    effect = draw_effect(rig, name, form or names_of_forms(name, "first")[0], np.random.default_rng(9))
    assert bool(_fact(effect, 1e-3, Size(1.0, 1.0, 1.0, 1.0, 1.0, 1.0))["places"]) is has_place


def test_play_moves_a_sliders_reflector_by_half_its_width(rig):
    effect = draw_effect(rig, "backlash", "constant", np.random.default_rng(8))
    effect = replace(effect, parts=[(effect.parts[0][0], 0, 1.0)])
    seen, _ = rig.simulate(effect.sized(2e-5))
    on_slider = rig.machine.carriers[rig.rows.smr] == 0
    moved = (seen - rig.scene.sights_m)[on_slider] @ rig.station.axes
    np.testing.assert_allclose(moved[:, 1], -1e-5 * rig.rows.side[on_slider, 0], rtol=1e-3)


# --- the command


def test_what_is_resumed_equals_the_whole(tmp_path, capsys):
    whole, resumed = tmp_path / "whole", tmp_path / "resumed"
    assert main(["--archive", "first", "--out", str(whole), "--n", "2"]) == 0
    assert main(["--archive", "first", "--out", str(resumed), "--n", "1"]) == 0
    (made,) = (resumed / "cases").glob("*/rec002")
    (made.parent / "rec004.part").mkdir()  # as a run leaves it that was killed
    (made / "readings.csv").touch()
    before = (made / "readings.csv").stat().st_mtime_ns
    assert main(["--archive", "first", "--out", str(resumed), "--n", "2"]) == 0
    assert (made / "readings.csv").stat().st_mtime_ns == before
    assert (whole / ARCHIVE).read_bytes() == (resumed / ARCHIVE).read_bytes()
    assert capsys.readouterr().out.splitlines()[-1] == str(resumed / ARCHIVE)
    assert names_of(whole / ARCHIVE, even=True) == ["rec002", "rec004"]
    assert names_of(whole / ARCHIVE, even=False) == []
    copy_recordings(whole / ARCHIVE, ["rec002", "rec004"], tmp_path / "copies")
    assert read_folder(tmp_path / "copies" / "rec004").file.campaign == "rec004"


def test_a_recording_that_another_process_has_written_meanwhile_stays(tmp_path):
    """As one does that outlives its killed parent while the same command goes on."""
    arrays = {"clean_m": np.zeros((1, 3)), "platform": np.ones(1, dtype=bool)}
    for content in (b"first", b"second"):
        write_case(tmp_path / "rec002", {"readings.csv": content}, {"kind": "null"}, arrays)
    assert [path.name for path in tmp_path.iterdir()] == ["rec002"]
    assert (tmp_path / "rec002" / "readings.csv").read_bytes() == b"first"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--archive", "unheard-of", "--out", "x"], "unheard-of"),
        (["--archive", "first"], "--out"),
        (["--archive", "space", "--out", "x", "--n", "61"], "archive space has 60 recordings"),
        (["--archive", "space", "--out", "x", "--n", "-1"], "--n must not be negative"),
        (["--archive", "space", "--out", "FILE", "--n", "1"], "FILE"),
    ],
)
def test_bad_input_is_one_line(tmp_path, monkeypatch, capsys, arguments, says):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "FILE").touch()
    assert main(arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("other_simulator: ")
    assert says in line
    assert [path.name for path in tmp_path.iterdir()] == ["FILE"]
