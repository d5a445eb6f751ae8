from __future__ import annotations

import pytest

from calibration.identification.calibration import Calibration, calibration_part, identify_recording
from calibration.recording.recording import Recording
from tests.pkm_rig.plant_recording import record


@pytest.fixture(scope="session")
def whole() -> Recording:
    """A short campaign of the plant behind the mock rig."""
    return record(4, calibration_poses=24, nest_every_visits=6)


@pytest.fixture(scope="session")
def recording(whole) -> Recording:
    """What its calibration was measured with."""
    return calibration_part(whole)


@pytest.fixture(scope="session")
def identified(recording) -> Calibration:
    return identify_recording(recording, baselines=False)
