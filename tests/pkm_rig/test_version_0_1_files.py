"""Files that version 0.1.0 wrote go on working: its store, recording folder, rig file and a user's effect file."""

from __future__ import annotations

import gzip
import json
from pathlib import Path

import numpy as np
import pytest

from calibration.diagnosis.diagnose import diagnose
from calibration.effects.catalogue import load_catalogue
from calibration.identification.calibration import calibration_part, identify_recording
from calibration.recording.folder import read_folder
from calibration.recording.recording import Recording
from calibration.reduction.nest_checks import drop_unclosed_readings
from pkm_rig.jobs.acceptance import stored_outcome
from pkm_rig.rig.config import load_rig
from pkm_rig.store.place import STORE_NAME
from pkm_rig.store.store import open_store

DATA = Path(__file__).parents[1] / "data" / "version_0_1"
EXPECTED = json.loads((DATA / "expected.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def folder() -> Recording:
    return read_folder(DATA / "recording")


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """A folder of results with the store in it."""
    (tmp_path / STORE_NAME).write_bytes(gzip.decompress((DATA / "store.db.gz").read_bytes()))
    return tmp_path


def test_the_recording_folder_is_identified_as_it_was(folder: Recording) -> None:
    fit = identify_recording(folder, baselines=False).fit
    names = [parameter.name for parameter in fit.model.parameters.parameters]
    assert names == list(EXPECTED["parameters"])
    u = np.array([p["u"] for p in EXPECTED["parameters"].values()])
    value = np.array([p["value"] for p in EXPECTED["parameters"].values()])
    # A thousandth of the uncertainty: another computer's linear algebra may round otherwise.
    np.testing.assert_array_less(np.abs(fit.theta - value), 1e-3 * u)
    np.testing.assert_allclose(fit.theta_u, u, rtol=1e-3)


def test_the_store_holds_the_same_readings_and_its_outcome(folder: Recording, out: Path) -> None:
    with open_store(out) as store:
        ((campaign, _, rig, readings, last, *_),) = store.campaigns()
        assert (campaign, rig, readings, last) == (EXPECTED["campaign"], "embedded-mock", 667, "refused")
        recording = store.recording(campaign)
        outcome = stored_outcome(store, campaign)
    assert recording.columns.keys() == folder.columns.keys()
    for name, column in recording.columns.items():
        np.testing.assert_array_equal(column, folder[name], err_msg=name)
    assert not outcome.accepted
    assert len(outcome.verified) == 2


def test_the_rig_file_is_read() -> None:
    file, machine = load_rig(DATA / "rig.toml")
    assert machine.name == "planar4"
    assert file.campaign.calibration_poses == 12
    assert file.mock is not None
    assert file.mock.seed == 5


def test_the_effect_file_joins_the_catalogue_and_takes_part_in_a_diagnosis(folder: Recording) -> None:
    catalogue = load_catalogue((DATA / "effect.py",))
    diagnosis = diagnose(drop_unclosed_readings(calibration_part(folder)), catalogue)
    assert diagnosis.verdict == EXPECTED["verdict"]
    ranking = {name: diagnosis.ranking[name] for name in EXPECTED["ranking"]}  # the catalogue has grown since
    assert ranking == pytest.approx(EXPECTED["ranking"], abs=1e-3)
    assert "roller_creep" in diagnosis.ranking
