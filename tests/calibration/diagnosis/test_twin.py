"""The twin: its places against the readings' own predictions and the plant, its data there and back, hostile data."""

from __future__ import annotations

import copy
import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calibration.base.errors import InputError
from calibration.diagnosis.diagnose import diagnose_and_add, diagnose_and_score
from calibration.diagnosis.effect_inputs import inputs_of_recording, periodograms
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.linear_model import linearise_recording
from calibration.diagnosis.twin.joint_fit import JointFit
from calibration.diagnosis.twin.twin import Twin
from calibration.effects.catalogue import load_catalogue
from calibration.effects.context import context_of_recording
from mock_devices.effects import EffectChoice
from tests.calibration.diagnosis.campaigns import PLANAR, example, noise_free_m, plant, recorded, simulated

TEXT = PLANAR.read_text(encoding="utf-8")
NUISANCE = ("range.", "refraction.", "drift.", "reseat.", "reversal.", "temperature.")


@pytest.fixture(scope="module")
def case(strong):
    """Diagnosis and twin of the recording with backlash."""
    return diagnose_and_add(strong)


@pytest.fixture(scope="module")
def twin(case) -> Twin:
    return case[1]


def of_readings(twin: Twin, linear) -> np.ndarray:
    """Places (n, 3) of the readings' own reflectors, machine's frame, at the readings' moments."""
    return twin.places_m(linear.context)[np.arange(len(linear.rows)), linear.smr]


def in_plane(linear, shift: np.ndarray) -> np.ndarray:
    """Station's frame to the plane that the machine moves in, reflectors on the machine."""
    return (shift @ linear.frame.rotation)[linear.visit >= 0][:, :2]


def rms_of_shape(twin: Twin, linear, clean_m: np.ndarray) -> float:
    """RMS distance in the plane from noise-free points, but for a frame and a scale: the station's stay uncertain."""
    places = of_readings(twin, linear)
    apart = in_plane(linear, twin.frame.to_station(places) - clean_m)
    x, y = places[linear.visit >= 0][:, :2].T
    one, zero = np.ones_like(x), np.zeros_like(x)
    free = np.stack([np.stack([one, zero, -y, x], axis=1), np.stack([zero, one, x, y], axis=1)], axis=1).reshape(-1, 4)
    flat = apart.ravel()
    return float(np.sqrt(np.mean((flat - free @ np.linalg.lstsq(free, flat, rcond=None)[0]) ** 2)))


def fitted_m(linear, likelihood, twin) -> np.ndarray:
    """Readings as the linear model has them without noise and wander, given the twin's coefficients: a regression."""
    effect = next(e for e in load_catalogue().effects if e.name == twin.added[0].effect)
    forms = effect.forms(inputs_of_recording(likelihood, periodograms(likelihood)), twin.added[0].place)
    h = likelihood.columns([forms.contributions[c] for c in twin.added[0].columns])
    signal = np.einsum("nwk,k->nw", h, np.array(twin.added[0].coefficients))
    a = linear.columns.reshape(-1, linear.columns.shape[2])
    y = (linear.residual - signal).ravel()
    solution = np.linalg.solve(a.T @ a + np.eye(a.shape[1]), a.T @ y)
    solution[[k for k, name in enumerate(linear.names) if name.startswith(NUISANCE)]] = 0.0
    left = linear.residual - signal - (a @ solution).reshape(linear.residual.shape)
    return linear.position_m - np.linalg.solve(linear.whiten, left[:, :, None])[:, :, 0]


def test_the_twin_is_the_machine_that_the_readings_speak_of(case, strong):
    diagnosis, twin = case
    assert diagnosis.verdict == "backlash"
    assert [a.effect for a in twin.added] == ["backlash"]
    linear = linearise_recording(strong)
    apart = in_plane(
        linear, twin.frame.to_station(of_readings(twin, linear)) - fitted_m(linear, MarginalLikelihood.of(linear), twin)
    )
    assert np.sqrt(np.mean(apart**2)) < 2e-6
    assert np.abs(apart).max() < 8e-6


def test_the_twin_is_nearer_to_the_plant_than_the_model(twin, reversing, strong):
    """Noise-free points of the plant; its station does not drift."""
    linear, clean = linearise_recording(strong), noise_free_m(reversing)
    with_effect, without = (rms_of_shape(t, linear, clean) for t in (twin, replace(twin, added=())))
    assert with_effect < 5e-6
    assert with_effect < 0.4 * without


@pytest.mark.parametrize(
    ("name", "size"), [("screw_cumulative_error", 6e-5), ("screw_periodic_error", 4e-5), ("link_thermal_growth", 5.0)]
)
def test_calibration_and_effect_are_found_together(name, size):
    """Geometry that was fitted without the effect has absorbed part of it: it must not be counted twice."""
    bench = plant(80, EffectChoice(name, size))
    recording = recorded(bench)
    diagnosis, twin = diagnose_and_add(recording)
    assert diagnosis.verdict == name
    assert rms_of_shape(twin, linearise_recording(recording), noise_free_m(bench)) < 6e-6


def test_the_twin_of_a_sound_machine_has_no_effect():
    bench = plant(60)
    recording = recorded(bench)
    _, twin = diagnose_and_add(recording)
    assert not twin.added
    assert rms_of_shape(twin, linearise_recording(recording), noise_free_m(bench)) < 4e-6


def test_a_single_moment_gives_what_all_give(twin, strong):
    """A twin that is served is asked moment by moment."""
    context = context_of_recording(strong)
    everywhere = twin.places_m(context)
    for row in (0, 7, len(context) - 1):
        assert twin.places_m(context, np.array([row]))[0] == pytest.approx(everywhere[row], abs=1e-7)


def test_the_joint_fit_begins_where_the_diagnosis_is_linear(small, likelihood):
    """There the nonlinear model leaves the same residuals as the linear one, and has the same derivatives."""
    fit = JointFit(likelihood, ())
    begin = fit._at_linear_model
    again = fit._linearise(begin.z, begin.poses)
    np.testing.assert_allclose(again.residual, begin.residual, atol=1e-3)
    np.testing.assert_allclose(again.columns, small.columns, atol=1e-3 * np.abs(small.columns).max())
    assert np.abs(begin.residual[small.visit >= 0]).max() < 6.0


def test_a_place_that_is_not_finite_is_refused(twin, strong):
    """A coefficient may be finite and the place not: no such place is served."""
    (effect,) = twin.added
    endless = replace(twin, added=(replace(effect, coefficients=(np.inf,) * len(effect.coefficients)),))
    with pytest.raises(InputError, match="not a finite number"):
        endless.places_m(context_of_recording(strong), np.array([0]))


def test_data_there_and_back(twin, strong):
    data = json.loads(json.dumps(twin.to_data(), allow_nan=False))
    again = Twin.from_data(TEXT, data)
    context = context_of_recording(strong)
    assert np.array_equal(again.places_m(context), twin.places_m(context))
    assert json.dumps(again.to_data()) == json.dumps(twin.to_data())
    assert Twin.from_data(TEXT, data | {"breaks_s": [120.5]}).to_data()["breaks_s"] == [120.5]
    former = {key: value for key, value in data.items() if key != "breaks_s"}
    assert Twin.from_data(TEXT, former).to_data() == twin.to_data()


def test_an_effect_that_is_not_known_is_named(twin):
    data = copy.deepcopy(twin.to_data())
    data["added"][0]["effect"] = "stiction"
    with pytest.raises(InputError, match="stiction"):
        Twin.from_data(TEXT, data)
    with pytest.raises(InputError, match="backlash"):
        Twin.from_data(TEXT, twin.to_data(), load_catalogue(without=("backlash",)))


def test_a_twin_with_an_effect_of_ones_own_needs_its_file(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(example(), encoding="utf-8")
    recording = simulated("planar4", 60, lambda a: -1e-4 * a.travelled_m * np.array([1.0, 0.0]))
    catalogue = load_catalogue([path])
    diagnosis, twin = diagnose_and_add(recording, catalogue)
    data = json.loads(json.dumps(twin.to_data()))
    with pytest.raises(InputError, match=f"{diagnosis.verdict}.*--effects"):
        Twin.from_data(TEXT, data)
    context, rows = context_of_recording(recording), np.arange(20)
    again = Twin.from_data(TEXT, data, load_catalogue([path]))
    assert np.array_equal(again.places_m(context, rows), twin.places_m(context, rows))


def test_the_score_is_that_of_readings_that_were_withheld(strong, case):
    diagnosis, _, score = diagnose_and_score(strong)
    assert score.figures.shrink == pytest.approx(diagnosis.gap.shrink, abs=0.05)
    assert score.figures.before_m == pytest.approx(case[0].gap.before_m, rel=0.05)
    assert score.readings == len(diagnosis.withheld.rows)
    assert 0.8 < score.after_sigma < 1.2 < score.before_sigma


def test_the_data_of_another_machine_are_refused(twin):
    other = PLANAR.with_name("delta8.toml").read_text(encoding="utf-8")
    with pytest.raises(InputError):
        Twin.from_data(other, twin.to_data())


@pytest.fixture(scope="module")
def little():
    """Data of a small twin, and moments to try it at."""
    recording = recorded(plant(24, EffectChoice("backlash", 2e-4), seed=2))
    diagnosis, twin = diagnose_and_add(recording)
    assert diagnosis.effects
    return twin.to_data(), context_of_recording(recording)


def paths(node, path=()):
    """Every place in the data, long lists by their first entries."""
    yield path
    if isinstance(node, dict):
        for key, value in node.items():
            yield from paths(value, (*path, key))
    elif isinstance(node, list):
        for index, value in enumerate(node[:2]):
            yield from paths(value, (*path, index))


BAD = st.sampled_from([
    None, True, "x", "1e5", "", [], {}, [[]], [None], [1.0], {"a": 1}, 0, -1, 1, 7, 2.5, 1000000, 10**400, 1e300,
    -1e300, 1e-300, float("nan"), float("inf"), -float("inf"), [[1.0, 2.0], [3.0]], "\n",
])  # fmt: skip


@settings(max_examples=120, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(pick=st.integers(0, 10**6), value=BAD, kind=st.sampled_from(["set", "set", "delete", "twice"]))
def test_hostile_data_are_refused_in_one_line(little, pick, value, kind):
    """Whatever is changed: one line at reading or at use, or a finite answer; no other exception, no warning."""
    data, context = little
    data = json.loads(json.dumps(data))
    places = [p for p in paths(data) if p]
    *way, last = places[pick % len(places)]
    node = data
    for key in way:
        node = node[key]
    if kind == "delete":
        del node[last]
    elif kind == "twice" and isinstance(node, list):
        node.append(node[last])
    else:
        node[last] = value
    line = ""
    try:
        result = Twin.from_data(TEXT, data).places_m(context, np.arange(2))
    except InputError as error:
        result, line = np.zeros(1), str(error)
    assert np.all(np.isfinite(result))
    assert "\n" not in line
    assert len(line) < 1000


@pytest.mark.parametrize("data", [{}, {"format": 1}, {"format": 99}, [], "x", None, 3, {"format": 1, "added": {}}])
def test_what_is_no_twin_at_all_is_refused(data):
    with pytest.raises(InputError) as caught:
        Twin.from_data(TEXT, data)
    assert "\n" not in str(caught.value)
