"""Calibrated geometry of a recording: what it leaves of the tool's error at each payload is told, and decides."""

from __future__ import annotations

import pytest

from pkm_rig.errors import CampaignRefused
from pkm_rig.jobs.control_files import Choice
from pkm_rig.jobs.kinematics_files import write_kinematics_files
from tests.pkm_rig.spatial_recording import record


def test_geometry_that_removes_too_little_is_written_only_on_demand(tmp_path):
    recording, said = record("delta6", 3, poses=12), []
    with pytest.raises(CampaignRefused, match=r"on delta6 at payload 1 it would remove \d+% of the tool's predicted"):
        write_kinematics_files(recording, 1, tmp_path, Choice("lineardeltakins"), said.append)
    assert list(tmp_path.iterdir()) == []
    choice = Choice("lineardeltakins", accept_loss=True)
    result = write_kinematics_files(recording, 1, tmp_path, choice, said.append)
    position_m = result["tool_position_rms_m"]
    assert list(position_m) == list(result["tool_rotation_rms_rad"]) == ["0", "20", "40"]
    own = position_m["20"]
    assert 0.5 * own["before"] < own["after"] < own["before"]
    assert f"position {own['before'] * 1e6:.1f} um without, {own['after'] * 1e6:.2f} um with it" in said[-1]
    assert result["tool_rotation_rms_rad"]["20"] is None  # none is commanded
    assert result["files"] == ["joints.ini", "lineardeltakins.hal"]
