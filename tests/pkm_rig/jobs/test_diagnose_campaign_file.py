"""From a candidate of a diagnosis to what a rig measures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from calibration.base.errors import InputError
from pkm_rig.cli.entry import app
from pkm_rig.jobs.calibrate import calibrate
from pkm_rig.jobs.campaign_file import campaign_text, remarks_on_unwritable, write_campaign_files
from pkm_rig.jobs.measure import measure
from pkm_rig.rig.schedule import calibration_blocks
from pkm_rig.rig.visits_file import with_visits
from pkm_rig.store.store import Store
from tests.pkm_rig.conftest import mock_and_rig, short_rig_file, silent
from tests.pkm_rig.diagnosis_example import example, planned


@pytest.fixture
def candidate_file(tmp_path):
    """The campaign file of the example's candidate, a rig file with these visits, and its machine."""
    file, machine = short_rig_file(seed=4)
    files = write_campaign_files(list(example().next_measurement), machine, file.payloads, "earlier", tmp_path)
    return files, file, machine


def test_only_candidates_with_visits_become_files_and_old_ones_go(candidate_file, tmp_path):
    files, file, machine = candidate_file
    assert files["an SMR on the slider"] is None
    assert files["other dwell"] == str(tmp_path / "next-1-other-dwell.toml")
    write_campaign_files([], machine, file.payloads, "earlier", tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_candidate_that_no_campaign_file_may_hold_loses_neither_the_others_nor_the_diagnosis(tmp_path):
    file, machine = short_rig_file(seed=4)
    first, *others = example().next_measurement
    too_fast = replace(first, name="too fast", visits=tuple(replace(v, speed_m_per_s=3.0) for v in first.visits))
    candidates = [too_fast, first, *others]
    files = write_campaign_files(candidates, machine, file.payloads, "earlier", tmp_path)
    assert files["too fast"] is None
    assert files["other dwell"] == str(tmp_path / "next-2-other-dwell.toml")
    (said,) = remarks_on_unwritable(candidates, machine)
    assert said.startswith("no campaign file for 'too fast': speed_m_per_s = 3.0: ")
    assert "less than or equal to 2" in said
    assert "\n" not in said


def test_a_campaign_file_says_what_it_is_for(candidate_file):
    _, file, machine = candidate_file
    text = campaign_text(example().next_measurement[0], machine, file.payloads, "earlier")
    assert "# tells apart: backlash, friction_windup; 0.40 bit expected in 40 min" in text
    assert "# payloads: 0: none, 0 kg; 2: plates 400 kg, 400 kg" in text


def test_visits_are_planned_as_they_are_given(candidate_file):
    files, file, machine = candidate_file
    chosen = with_visits(file, Path(files["other dwell"]), machine)
    blocks = calibration_blocks(machine, chosen.campaign)
    assert [block.payload for block in blocks] == [0, 2]
    visits = [visit for block in blocks for visit in block.visits]
    assert [v.direction for v in visits] == [v.direction for v in planned()]
    assert [v.dwell_s for v in visits] == [v.dwell_s for v in planned()]
    assert {v.speed_m_per_s for v in visits} == {0.25}
    assert [(v.pose, v.pass_) for v in visits] == [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)]
    tool = np.array([v.target_m[:3] for v in visits]) + machine.tool_point_m
    np.testing.assert_allclose(tool[:, :2], [v.target_m[:2] for v in planned()], atol=1e-9)


def test_what_a_visit_leaves_out_is_the_campaigns(tmp_path):
    file, machine = short_rig_file()
    path = tmp_path / "visits.toml"
    path.write_text("[campaign]\nvisits = [{target = [0.0, 0.1]}, {target = [0.1, 0.0]}]\n")
    visit = calibration_blocks(machine, with_visits(file, path, machine).campaign)[0].visits[0]
    assert visit.direction == (1, 1)
    assert (visit.speed_m_per_s, visit.dwell_s) == (file.campaign.speeds_m_per_s[0], file.campaign.dwells_s[0])


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[campaign]\nvisits = []", "'campaign.visits'"),
        ("[campaign]\nvisits = [{target = [0.0, 0.0], payload = 7}]", "payload 7 is not in the rig file"),
        ("[campaign]\nvisits = [{target = [0.0, nan]}]", "finite number"),
        ("[campaign]\nvisits = [{target = [0.0, 0.0], direction = [0, 1]}]", "direction"),
        ("[campaign]\nvisits = [{target = [0.0, 0.0], dwell_s = 1e9}]", "dwell_s"),
        ("[campaign]\nseed = 3\nvisits = [{target = [0.0, 0.0]}]", "unknown key 'campaign.seed'"),
        ("[campaign]\nvisits = [{target = [0.0, 0.0]}]", "give 2 or more"),
        ("[campaign]\nvisits = [{target = [0.0]}, {target = [0.0]}]", "visit 1 has 1 numbers"),
        ("[campaign]\nvisits = [{target = [0.0, 0.0]}, {target = [0.0, 9.0]}]", "visit 2 lies outside the workspace"),
        (
            "[campaign]\nvisits = [{target = [0.0, 0.0], direction = [1]}, {target = [0.0, 0.0]}]",
            "1 sides for 2 drives",
        ),
        ("nonsense", "not TOML"),
    ],
)
def test_an_unfit_campaign_file_is_one_line(tmp_path, text, complaint):
    file, machine = short_rig_file()
    path = tmp_path / "visits.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=complaint) as caught:
        calibration_blocks(machine, with_visits(file, path, machine).campaign)
    assert "\n" not in str(caught.value)


def test_a_visit_outside_the_workspace_is_said_before_any_device_is_touched(tmp_path):
    """The example rig's devices are not there: nobody serves them."""
    path = tmp_path / "visits.toml"
    path.write_text("[campaign]\nvisits = [{target = [0.0, 0.0]}, {target = [0.0, 9.0]}]")
    rig = str(Path(__file__).parents[3] / "examples" / "mock-rig.toml")
    result = CliRunner().invoke(app, ["measure", "--rig", rig, "--campaign", str(path), "--out", str(tmp_path)])
    assert isinstance(result.exception, InputError)
    assert "visit 2 lies outside the workspace" in str(result.exception)


def test_visits_are_measured_and_added_to_a_campaign(candidate_file, tmp_path):
    files, file, machine = candidate_file
    path = tmp_path / "first.toml"
    path.write_text("[campaign]\nvisits = [{target = [0.0, 0.1]}, {target = [0.1, 0.0], payload = 1}]\n")
    store = Store(tmp_path / "store.sqlite")
    with mock_and_rig(with_visits(file, path, machine), machine) as (_, rig):
        campaign = measure(rig, store, silent, silent)
        first = store.recording(campaign).rows("calibration")
        rig.file = with_visits(rig.file, Path(files["other dwell"]), machine)
        measure(rig, store, silent, silent, resume=campaign)
        both = store.recording(campaign).rows("calibration")
        measure(rig, store, silent, silent, resume=campaign)  # all of it is there
        assert len(store.recording(campaign).rows("calibration")) == len(both)
        rig.file = file
        with pytest.raises(InputError, match="another rig file or campaign file"):
            measure(rig, store, silent, silent, resume=campaign)
        rig.file = with_visits(file, Path(files["other dwell"]), machine)
        rig.file = rig.file.model_copy(update={"payloads": rig.file.payloads[:2]})
        with pytest.raises(InputError, match="another rig file"):
            measure(rig, store, silent, silent, resume=campaign)
        rig.file = file.model_copy(update={"campaign": rig.file.campaign})
        with pytest.raises(InputError, match="none is made three times"):
            calibrate(rig, store, silent, silent)
    added = both["sequence"] > first["sequence"].max()
    assert np.count_nonzero(~added) == len(first) == 2 * 5
    assert np.count_nonzero(added) == 6 * 5
    assert sorted(set(both["pose"][added])) == [2.0, 3.0, 4.0]
    last = added & (both["pose"] == 3.0)
    assert set(both["left_direction"][last]) == {-1.0}
    assert set(both["right_direction"][last]) == {1.0}
    assert np.all(both["dwell_s"][last] >= 60.0)
    assert set(both["payload_mass_kg"][added]) == {0.0, 400.0}
    store.close()
