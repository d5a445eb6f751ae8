"""The integrated drive: what winds up does so as much as statics say."""

from __future__ import annotations

import numpy as np
import pytest

from mock_devices.axis import DriveFlaws, record_drives


def test_weight_and_play_show_at_rest_as_statics_say():
    weight = DriveFlaws(stiffness_nm_per_rad=1e6, weight_nm=500.0, noise_rad=0.0, white_rad=0.0, torque_side="load")
    loose = DriveFlaws(play_rad=4e-4, weight_nm=500.0, noise_rad=0.0, white_rad=0.0)
    rigid = DriveFlaws(rigid=True, delay_s=2e-3, noise_rad=0.0, white_rad=0.0, torque_side="")
    heavy, hung, late = record_drives([weight, loose, rigid], seed=1, duration_s=1.0)
    assert heavy.second[0] - heavy.motor[0] == pytest.approx(-500.0 / 1e6, rel=1e-3)
    assert heavy.torque[0] == pytest.approx(500.0, abs=3.0)
    assert hung.second[0] - hung.motor[0] == pytest.approx(-2e-4 - 500.0 / 2e7, rel=1e-2)
    assert late.torque is None
    speed = np.gradient(late.motor, late.time_s)
    fast = np.abs(speed) > 0.1
    assert np.median((late.motor - late.second)[fast] / speed[fast]) == pytest.approx(2e-3, rel=0.02)
