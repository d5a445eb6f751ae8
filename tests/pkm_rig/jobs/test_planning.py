"""`pkm-rig poses`: what a campaign promises before it is run."""

from __future__ import annotations

import json
import tomllib

import numpy as np
import pytest
from typer.testing import CliRunner

from calibration.base.errors import InputError
from calibration.machine.description import load_machine, shipped_machine
from pkm_rig.cli.entry import app
from pkm_rig.jobs import planning
from pkm_rig.report.plan_text import campaign_section
from pkm_rig.rig.campaign_sections import CampaignSettings
from pkm_rig.rig.config import embedded_rig_path, load_rig
from pkm_rig.rig.schedule import calibration_targets


@pytest.fixture(scope="module")
def found():
    return planning.Planner.of_rig(*load_rig(embedded_rig_path())).plan(12, "I")


def test_the_selected_poses_promise_more_than_a_grid(found):
    sets = found["sets"]
    assert sets["selected"]["poses"] == sets["grid"]["poses"] == 12
    assert sets["selected"]["u_position_m"] < sets["grid"]["u_position_m"] < sets["spread"]["u_position_m"]
    assert found["payloads_kg"] == [0.0, 400.0]
    assert any("platform and base joint along x" in s for s in found["open"])


def test_the_printed_section_is_a_campaign(found):
    section = tomllib.loads(campaign_section(found))["campaign"]
    targets = calibration_targets(load_machine(shipped_machine("planar4")), CampaignSettings(**section))
    np.testing.assert_allclose(targets[:, :2], found["targets"])


def test_the_command_for_another_machine():
    answer = CliRunner().invoke(app, ["poses", "--machine", "rrr4", "--count", "9", "--criterion", "D", "--json"])
    assert answer.exit_code == 0
    plan = json.loads(answer.stdout)
    assert plan["coordinates"] == ["x", "y", "rz"]
    assert len(plan["targets"]) == 9
    assert plan["criterion"] == "D"


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--machine", "rrr9"], "is not shipped"),
        (["--machine", "none.toml"], "check the path"),
        (["--machine", "rrr4", "--rig", "rig.toml"], "not both"),
        (["--machine", "rrr4", "--count", "0"], "choose 1 to 500"),
        (["--machine", "rrr4", "--criterion", "A"], "use I or D"),
    ],
)
def test_bad_requests_are_one_line(arguments, complaint):
    answer = CliRunner().invoke(app, ["poses", *arguments])
    assert isinstance(answer.exception, InputError)
    assert complaint in str(answer.exception)
    assert "\n" not in str(answer.exception)
