from __future__ import annotations

import pytest

from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.linear_model import LinearModel, linearise_recording
from calibration.recording.recording import Recording
from mock_devices.effects import EffectChoice
from mock_devices.recordings.maker import SimulatedCampaign
from mock_devices.settings import DisturbanceLevels
from tests.calibration.diagnosis.campaigns import plant, recorded

BACKLASH_M = 6.0e-5


@pytest.fixture(scope="session")
def reversing() -> SimulatedCampaign:
    """A plant whose right drive has backlash."""
    return plant(100, EffectChoice("backlash", BACKLASH_M, "right"))


@pytest.fixture(scope="session")
def strong(reversing) -> Recording:
    return recorded(reversing)


@pytest.fixture(scope="session")
def wandering() -> Recording:
    """Forty visits of a rig with some of every declared nuisance, and a little backlash."""
    levels = DisturbanceLevels(drift_m=5e-6, reseat_m=2e-6, reversal_m=1e-6, temperature_k=0.02)
    return recorded(plant(40, EffectChoice("backlash", 2.0e-5), nuisance=levels))


@pytest.fixture(scope="session")
def small(wandering) -> LinearModel:
    """Its baseline with every direction kept, so that dense computations must agree to rounding."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("calibration.diagnosis.linearised_readings.NEGLIGIBLE_INFORMATION", 1e-9)
        return linearise_recording(wandering)


@pytest.fixture
def likelihood(small) -> MarginalLikelihood:
    return MarginalLikelihood.of(small)
