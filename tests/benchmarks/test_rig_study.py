"""The pure parts of the rig study; the study itself is `make rig-study`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks import rig_measured
from benchmarks.results_file import MixedSettingsError, ResultsFile
from benchmarks.rig_bound import Bound, rms
from benchmarks.rig_measured import Rig, measured_targets
from benchmarks.rig_settings import STUDIES
from benchmarks.rig_table import ratio, within
from benchmarks.rig_truth import Payload, ReferencePlant, deviations, draw_errors, generator, plant_of
from calibration.identification.estimators import identify
from calibration.instruments.tool_coordinates import ToolCoordinates
from calibration.model.model import Model, SystematicUncertainties
from calibration.model.parameters import ParameterSet
from tests.calibration.reference_model import ReferenceModel

PLANAR = replace(STUDIES[0], poses=16, held_out=20)


def test_results_survive_a_stop_in_the_middle_of_a_line(tmp_path):
    file = ResultsFile(tmp_path / "rows.jsonl", {"noise": 1.0})
    assert file.rows() == []
    file.append({"seed": 1})
    file.append({"seed": 2})
    with file.path.open("a") as stream:
        stream.write('{"seed": 3, "err')
    assert [row["seed"] for row in file.rows()] == [1, 2]
    file.append({"seed": 3})
    assert [row["seed"] for row in file.rows()] == [1, 2, 3]


def test_results_of_other_settings_and_numbers_that_are_none_are_refused(tmp_path):
    file = ResultsFile(tmp_path / "rows.jsonl", {"noise": 1.0})
    file.rows()
    with pytest.raises(ValueError, match="JSON compliant"):
        file.append({"error": float("nan")})
    assert file.rows() == []
    with pytest.raises(MixedSettingsError, match="other settings"):
        replace(file, settings={"noise": 2.0}).rows()


def test_ratio_and_its_standard_error():
    rng = np.random.default_rng(3)
    bound = np.tile([2.0, 5.0], (200, 1))
    error = bound * np.sqrt(np.mean(rng.standard_normal((200, 2, 12)) ** 2, axis=2))
    value, spread = ratio(error, bound)
    assert np.all(np.abs(value - 1.0) < 4.0 * spread)
    np.testing.assert_allclose(spread, 1.0 / np.sqrt(2 * 200 * 12), rtol=0.2)
    assert within(0.95, (0.95, 1.05))
    assert not within(0.949, (0.95, 1.05))


def test_both_sources_of_truth_agree():
    errors = draw_errors(PLANAR.path, 5)
    rig = Rig.from_seed(PLANAR, 5)
    visits = rig.visits(measured_targets(rig.machine, 16), 400.0)
    payload = Payload(400.0, PLANAR.payload_com_m)
    reference = ReferencePlant(ReferenceModel(PLANAR.path.read_text(encoding="utf-8")))
    poses = [p.tool(errors, visits.drives, visits.target_m, payload) for p in (plant_of(PLANAR.path), reference)]
    np.testing.assert_allclose(poses[0], poses[1], atol=1e-12)


def test_the_bound_is_the_covariance_of_a_fit_where_it_is_linearised():
    rig = Rig.from_seed(PLANAR, 6)
    model = Model(ParameterSet.of(rig.machine), SystematicUncertainties(1e-3, 2e-3))
    target = measured_targets(rig.machine, 16)
    visits = rig.visits(target, 0.0).concatenate(rig.visits(target, 400.0))
    value = rig.measured(rig.truth(visits, {}), generator("noise", 6))
    readings = ToolCoordinates.of(visits, rig.coordinates, value, rig.sigma)
    fit = identify(model, visits, [readings])
    sigma = fit.layout.sigma
    bound = Bound.of(model, fit.unknowns, visits, readings).covariance / np.outer(sigma, sigma)
    np.testing.assert_allclose(bound, fit.covariance / np.outer(sigma, sigma), atol=1e-6)


def test_a_prior_that_is_narrower_than_the_draw_is_refused(monkeypatch):
    wider = {name: 1.01 * size for name, size in deviations(PLANAR.path).items()}
    monkeypatch.setattr(rig_measured, "deviations", lambda _path: wider)
    with pytest.raises(AssertionError, match="narrower"):
        Rig.from_seed(PLANAR, 1)


def test_rms_is_of_distance_and_angle():
    assert rms(np.array([[3e-6, 4e-6, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 2e-6]])) == pytest.approx(
        [np.sqrt(12.5), np.sqrt(2.0)]
    )
